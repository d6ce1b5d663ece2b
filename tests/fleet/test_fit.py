"""`fit --fleet`: every unit's own constants, and what the fleet tells of its next one."""

import csv
import json

import numpy as np
import pytest
from scipy.optimize import least_squares

from faultgauge.cli.app import run
from faultgauge.fleet.fit import common_length, fit_fleet
from faultgauge.plants.model import load_model

from .conftest import NOISE, PLANT, STEP, drawn, write_log


def test_every_unit_has_its_own_constants(fleet):
    """As SciPy fits its log alone, with the plant's exact solution: stopping early may leave 5 % of
    a standard error, which itself is known to a fifth."""
    assert list(fleet.found.units) == list(fleet.truth)
    t, u, y = np.loadtxt(fleet.logs / "tank1.csv", delimiter=",", skiprows=1).T

    def off(p):
        a, b, x = p
        decay, path = np.exp(-a * STEP), []
        for v in u:
            path.append(x)
            x = decay * x + (1 - decay) / a * b * v
        return (np.array(path) - y) / NOISE

    best = least_squares(off, [*fleet.truth["tank1"], 0.0])
    errors = np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)))
    told = fleet.found.units["tank1"]
    for constant, value, error in zip(("a", "b"), best.x, errors, strict=False):
        assert told.constants[constant][0] == pytest.approx(value, abs=0.05 * error)
        assert told.constants[constant][1] == pytest.approx(error, rel=0.2)
    assert (told.samples, told.seconds) == (len(t), pytest.approx(t[-1] - t[0]))


def test_the_fleet_tells_mean_and_spread(fleet):
    """By hand: the mean of five, and a spread that is the sample's or, as five tell it badly, at
    most twice of it."""
    logs = np.log([each[0] for each in fleet.truth.values()])
    law = fleet.found.laws["a"]
    assert law.log
    assert abs(np.log(law.center) - logs.mean()) < law.error
    assert 0.5 < law.spread / np.std(logs, ddof=1) < 2
    assert not fleet.found.laws["b"].log


def test_a_unit_that_fails_is_named_and_stops_nobody(fleet):
    assert list(fleet.found.failed) == ["still"]
    assert "input 'u' never changes" in fleet.found.failed["still"]
    assert fleet.found.warnings == [f"unit still: {fleet.found.failed['still'].rstrip('.')}"]
    with (fleet.folder / "units.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["unit"] for row in rows] == [*fleet.truth, "still"]
    assert rows[-1]["failed"]
    assert not rows[0]["failed"]


def test_progress_has_a_share(fleet):
    shares = [each.share for each in fleet.said if hasattr(each, "share")]
    assert shares == [k / 6 for k in range(1, 7)]


def test_units_that_are_done_are_not_done_again(fleet):
    """A call that was ended goes on: what is missing is done, to the same bytes as before."""
    kept = {path: path.stat().st_mtime_ns for path in (fleet.folder / "units").iterdir()}
    lost = fleet.folder / "units" / "tank1.fgm"
    data, whole = lost.read_bytes(), (fleet.folder / "fleet.fgm").read_bytes()
    lost.unlink()
    found = fit_fleet(PLANT, [fleet.logs], fleet.folder)
    assert found.before == 4
    assert lost.read_bytes() == data
    assert (fleet.folder / "fleet.fgm").read_bytes() == whole
    for path in kept.keys() - {lost}:
        assert path.stat().st_mtime_ns == kept[path]


def test_a_new_unit_leans_on_the_fleet(fleet, tmp_path, capsys):
    """From 40 samples: what the log leaves open the fleet tells."""
    a, b = drawn(31)
    write_log(tmp_path / "logs" / "new.csv", 31, a, b, count=40)
    call = ["fit", str(fleet.folder.parent / "plant.toml"), str(tmp_path / "logs"), "--fleet"]
    call += ["--from", str(fleet.folder), "--out", str(tmp_path / "out"), "--json"]
    assert run(call) == 0
    told = json.loads(capsys.readouterr().out)["units"]["new"]
    assert told["prior"]
    law = fleet.found.laws["a"]
    assert told["constants"]["a"][1] < law.spread * law.center  # it knows more than the fleet alone
    assert abs(told["constants"]["a"][0] - a) < 4 * told["constants"]["a"][1]
    model = load_model(tmp_path / "out" / "units" / "new.fgm")
    assert model.plant.spec.text == PLANT
    assert not (tmp_path / "out" / "fleet.fgm").exists()


def test_lengths_of_logs_are_few(fleet):
    lengths = {common_length(k) for k in range(1000, 2000)}
    assert len(lengths) < 11
    assert all(k - common_length(k) < k / 8 for k in range(1, 3000))
