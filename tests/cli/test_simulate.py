"""`faultgauge simulate`: its log is a log for every other command, and whole or not there."""

import csv
import gzip

import pytest

import faultgauge as fg
import faultgauge.files

SCENARIO = """name = "leak in the workshop's tank"
plant = "model.fgm"
seconds = 60
step = 0.1
seed = 7

[inputs.u]
source = "noise"
sigma = 0.8
low = 0.01
high = 1

[inputs.u.feedback.x]
kp = 0.2
ki = 0.05

[noise]
x = 0.002

[faults.leak]
profile = "constant"
size = 0.6
start = 30
"""


@pytest.fixture
def scenario(workshop, tmp_path):
    (tmp_path / "model.fgm").write_bytes(workshop.calibrated.read_bytes())
    path = tmp_path / "scenario.toml"
    path.write_text(SCENARIO)
    return path


def test_simulate_says_and_writes_what_it_did(call, scenario, tmp_path):
    out, report = tmp_path / "log.csv", tmp_path / "report.html"
    said = call("simulate", scenario, "--out", out, "--report", report, "--json")
    assert said.code == 0, said.err
    assert said.out.count("\n") == 1
    assert said.json == {
        "rows": 600,
        "columns": ["t", "u", "x", "true_leak"],
        "out": str(out),
        "faults": [{"name": "leak", "enters": "state", "target": "x", "effect": "add"}],
    }
    with open(out, newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == said.json["columns"]
    assert [float(row["t"]) for row in rows] == [k / 10 for k in range(600)]
    assert [float(row["true_leak"]) for row in rows] == [0.0] * 300 + [0.6] * 300
    page = report.read_text()
    assert page.count("<svg") == 3  # the input, the output, the fault
    assert "1 fault injected" in page
    text = call("simulate", scenario, "--out", out)
    assert text.code == 0
    assert "600 rows of t, u, x, true_leak" in text.out


def test_the_same_scenario_gives_the_same_bytes(call, scenario, tmp_path):
    for name in ("a.csv", "b.csv", "a.csv.gz", "b.csv.gz"):
        assert call("simulate", scenario, "--out", tmp_path / name).code == 0
    plain = (tmp_path / "a.csv").read_bytes()
    assert (tmp_path / "b.csv").read_bytes() == plain
    assert (tmp_path / "a.csv.gz").read_bytes() == (tmp_path / "b.csv.gz").read_bytes()
    assert gzip.decompress((tmp_path / "a.csv.gz").read_bytes()) == plain
    scenario.write_text(SCENARIO.replace("seed = 7", "seed = 8"))
    assert call("simulate", scenario, "--out", tmp_path / "c.csv").code == 0
    assert (tmp_path / "c.csv").read_bytes() != plain


def test_the_log_goes_through_inspect_estimate_and_fit(call, workshop, scenario, tmp_path):
    log, out = tmp_path / "log.csv.gz", tmp_path / "estimates.csv"
    assert call("simulate", scenario, "--out", log).code == 0
    (run,) = call("inspect", log, "--json").json["runs"]
    assert run["rows"] == 600
    (event,) = call("estimate", workshop.calibrated, log, "--out", out, "--json").json["events"]
    assert event["fault"] == "leak"
    assert event["start"] == pytest.approx(30, abs=3)  # s: the observer's lag
    assert event["size"] == pytest.approx(0.6, rel=0.05)  # as in the workshop's own suspect log
    scenario.write_text(SCENARIO[: SCENARIO.index("[faults")])
    assert call("simulate", scenario, "--out", log).code == 0
    fitted = call("fit", workshop.plant, log, "--out", tmp_path / "new.fgm", "--json").json
    truth = {name: float(v) for name, v in fg.load_model(workshop.model).plant.parameters.items()}
    # 600 samples with noise of 0.2 % of the signal, as for the workshop's own fit
    assert fitted["parameters"] == pytest.approx(truth, rel=0.02)


def test_python_and_parquet_hold_the_same_log(call, scenario, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    scenario.write_text(SCENARIO + 'effect = "stuck"\n')
    assert call("simulate", scenario, "--out", tmp_path / "log.parquet").code == 0
    table = parquet.read_table(tmp_path / "log.parquet").to_pydict()
    run = fg.simulate(scenario).run
    assert list(table) == ["t", *run.columns]
    assert table["x"] == run.columns["x"].tolist()
    assert table["true_leak"] == [None] * 300 + [0.6] * 300  # while it is free, none


def unknown_key(path):
    path.write_text(SCENARIO.replace("seconds", "secnds"))
    return "secnds"


def other_plant(path):
    path.write_text(SCENARIO.replace("model.fgm", "reaction_wheel_network"))
    return "faultgauge fit"


def damaged_model(path):
    model = path.with_name("model.fgm")
    model.write_bytes(model.read_bytes()[:-1])
    return str(model)


def binary(path):
    path.write_bytes(b"\xff\xfe\x00\x01")
    return "not a text file"


def absent(path):
    path.unlink()
    return "No such file"


def explodes(path):
    path.write_text(SCENARIO.replace("kp = 0.2", "kp = -1e50"))
    return "leaves all bounds"


@pytest.mark.parametrize(
    "change", [unknown_key, other_plant, damaged_model, binary, absent, explodes]
)
def test_refusals_are_one_sentence_and_leave_nothing(call, scenario, tmp_path, change):
    named = change(scenario)
    before = sorted(tmp_path.iterdir())
    out, report = tmp_path / "log.csv", tmp_path / "r.html"
    said = call("simulate", scenario, "--out", out, "--report", report, "--json")
    assert said.code == 2, said.err
    assert said.out == ""
    assert said.err.startswith("faultgauge: ")
    assert said.err.count("\n") == 1
    assert named in said.err
    assert str(scenario) in said.err or named == str(tmp_path / "model.fgm")
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("out", "naming"), [("log.xls", ".csv.gz"), ("no/log.csv", "no"), ("folder.csv", "is a folder")]
)
def test_a_place_that_cannot_be_written_is_refused(call, scenario, tmp_path, out, naming):
    (tmp_path / "folder.csv").mkdir()
    said = call("simulate", scenario, "--out", tmp_path / out)
    assert said.code == 2
    assert naming in said.err
    assert str(tmp_path / out) in said.err


@pytest.mark.parametrize(("error", "code"), [(OSError(28, "full"), 2), (KeyboardInterrupt(), 130)])
def test_a_write_that_fails_leaves_the_old_log_whole(
    call, scenario, tmp_path, monkeypatch, error, code
):
    def failing(*args):
        raise error

    log = tmp_path / "log.csv"
    log.write_text("old")
    before = sorted(tmp_path.iterdir())
    monkeypatch.setattr(faultgauge.files.os, "replace", failing)
    said = call("simulate", scenario, "--out", log)
    assert said.code == code
    assert said.err.count("\n") == 1
    assert log.read_text() == "old"
    assert sorted(tmp_path.iterdir()) == before, "no draft stays behind"
