"""What `faultgauge demo --json` prints is JSON whatever its figures are; the runs are stand-ins."""

import json
from types import SimpleNamespace

from faultgauge.cli.demo import demo
from faultgauge.plants import model as models
from faultgauge.reporting import report
from faultgauge_studies import demonstration, drive
from faultgauge_studies.paper import experiment, reproduce


def test_what_never_settles_is_null(tmp_path, monkeypatch, capsys):
    figures = {"settling_worst_s": float("inf"), "pulse_rmse_V": 0.1, "halves": [1, float("nan")]}
    done = SimpleNamespace(figures=figures, calibration=SimpleNamespace(model=None))
    wheel = SimpleNamespace(figures={"settling_s": float("inf")}, traces=None)
    logs = SimpleNamespace(source="simulated (no data files)")
    monkeypatch.setattr(drive, "measured_logs", lambda: logs)
    monkeypatch.setattr(drive, "run_drive", lambda logs, name, progress: done)
    monkeypatch.setattr(experiment, "core", lambda seed, progress: wheel)
    monkeypatch.setattr(reproduce, "over_seeds", lambda each: None)
    monkeypatch.setattr(demonstration, "demonstration_report", lambda *given: None)
    monkeypatch.setattr(report, "write", lambda page, path: None)
    monkeypatch.setattr(models, "save_model", lambda model, path: None)
    demo(tmp_path / "out", json=True)

    def refused(name):
        raise AssertionError(f"{name} is no JSON")

    told = json.loads(capsys.readouterr().out, parse_constant=refused)
    wanted = {"settling_worst_s": None, "pulse_rmse_V": 0.1, "halves": [1, None]}
    assert told["physics"] == told["network"] == wanted
    assert told["wheel"] == {"settling_s": None}
