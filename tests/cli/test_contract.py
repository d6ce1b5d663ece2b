"""The command line keeps its contract: exit codes, one sentence, nothing half-written."""

import csv
import json
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy

from faultgauge.cli.app import ISSUES, run

PLANT = """
name = "lag"
[states.x]
derivative = "-a*x + NN(u)"
[inputs.u]
[outputs.x]
value = "x"
[parameters]
a = {value = 0.4, min = 0}
[networks.NN]
hidden = 3
[faults.leak]
enters = "state"
target = "x"
[observer]
bandwidth = 2
"""
A, B, DT, FAULT = 0.5, 1.0, 0.1, -0.3


def log(path, seed, fault=0.0, samples=800):
    """x' = -A x + B u + f under a held u, solved exactly; small noise."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(samples)
    u = np.repeat(rng.uniform(-1, 1, samples // 10), 10)
    f = np.where(np.arange(samples) >= samples // 2, fault, 0.0)
    x = np.zeros(samples)
    decay = np.exp(-A * DT)
    for k in range(samples - 1):
        x[k + 1] = decay * x[k] + (1 - decay) / A * (B * u[k] + f[k])
    table = np.c_[t, u, x + 1e-4 * rng.standard_normal(samples)]
    np.savetxt(path, table, delimiter=",", header="t,u,x", comments="")
    return path


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cli")
    (folder / "plant.toml").write_text(PLANT)
    log(folder / "healthy.csv", 0)
    log(folder / "other.csv", 1)
    log(folder / "suspect.csv", 2, FAULT)
    fit = ["fit", str(folder / "plant.toml"), str(folder / "healthy.csv")]
    assert run([*fit, "--out", str(folder / "raw.fgm")]) == 0
    assert run([*fit, "--out", str(folder / "again.fgm")]) == 0
    raw, model = str(folder / "raw.fgm"), str(folder / "model.fgm")
    assert run(["calibrate", raw, str(folder / "other.csv"), "--out", model]) == 0
    return folder


def spoken(capsys, *arguments):
    """(exit code, stdout, stderr) of one call."""
    capsys.readouterr()
    code = run([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return code, out, err


def refused(capsys, *arguments, says):
    code, _, err = spoken(capsys, *arguments)
    assert code == 2, err
    lines = [line for line in err.strip().splitlines() if not line.startswith("warning:")]
    assert len(lines) == 1, err
    assert lines[0].startswith("faultgauge: ")
    for text in says:
        assert text in lines[0]


def test_the_same_fit_twice_gives_the_same_bytes(work):
    assert (work / "raw.fgm").read_bytes() == (work / "again.fgm").read_bytes()


def test_evaluate_json_has_the_contracts_keys_and_is_untouched_by_calibrate(work, capsys):
    before = spoken(capsys, "evaluate", work / "raw.fgm", work / "other.csv", "--json")
    after = spoken(capsys, "evaluate", work / "model.fgm", work / "other.csv", "--json")
    assert before[:2] == after[:2]
    found = json.loads(before[1])
    assert set(found) == {"outputs", "runs"}
    assert set(found["outputs"]["x"]) == {"r2", "rmse", "nrmse"}
    assert set(found["runs"][0]) == {"run", "samples", "warmup", "outputs"}
    assert found["runs"][0]["warmup"] == 0  # nothing is hidden
    assert found["outputs"]["x"]["r2"] > 0.999  # noise is 1e-4 of a signal of order 0.5


def test_estimate_writes_the_contracts_rows_and_finds_the_fault(work, capsys, tmp_path):
    out = tmp_path / "e.csv"
    call = ("estimate", work / "model.fgm", work / "suspect.csv", "--out", out, "--json")
    code, text, _ = spoken(capsys, *call)
    assert code == 0
    (event,) = json.loads(text)["events"]
    assert set(event) == {"run", "fault", "start", "end", "size", "lo", "hi", "p"}
    assert event["fault"] == "leak"
    assert abs(event["start"] - 40.0) < 2.0  # within 4 / bandwidth of the true onset
    assert event["size"] == pytest.approx(FAULT, rel=0.05)  # model error of the learned NN
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert len(rows) == 800
    assert list(rows[0]) == [
        "run", "t", "r_x", "f_leak", "f_leak_lo", "f_leak_hi", "p_leak",
        "p_healthy", "p_unknown", "status", "reason",
    ]  # fmt: skip
    assert rows[0]["status"] == "NOT_JUDGED"
    assert {row["status"] for row in rows[100:380]} == {"HEALTHY"}
    assert {row["status"] for row in rows[450:]} == {"FAULT"}
    first = out.read_bytes()
    assert spoken(capsys, *call)[0] == 0
    assert out.read_bytes() == first


def test_uncalibrated_nothing_is_judged(work, capsys, tmp_path):
    out = tmp_path / "e.csv"
    code, text, _ = spoken(capsys, "estimate", work / "raw.fgm", work / "suspect.csv", "--out", out)
    assert code == 0
    assert "Not calibrated" in text
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert {(r["status"], r["reason"], r["p_leak"]) for r in rows} == {
        ("NOT_JUDGED", "not calibrated", "")
    }


def test_parquet_holds_what_csv_holds(work, capsys, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    out = tmp_path / "e.parquet"
    assert (
        spoken(capsys, "estimate", work / "model.fgm", work / "suspect.csv", "--out", out)[0] == 0
    )
    table = parquet.read_table(out)
    assert table.num_rows == 800
    assert table["status"][0].as_py() == "NOT_JUDGED"


def test_check_does_it_all(work, capsys, tmp_path):
    out = tmp_path / "out"
    code, text, _ = spoken(
        capsys, "check", work / "healthy.csv", work / "suspect.csv",
        "--plant", work / "plant.toml", "--out", out,
    )  # fmt: skip
    assert code == 0
    assert text.startswith(("leak -0.3", "leak -0.29"))
    assert {p.name for p in out.iterdir()} == {"report.html", "model.fgm", "estimates.csv"}
    assert "<script" not in (out / "report.html").read_text()


def test_inspect_drafts_a_plant_that_loads(work, capsys, tmp_path):
    draft = tmp_path / "draft.toml"
    assert spoken(capsys, "inspect", work / "healthy.csv", "--init-plant", draft)[0] == 0
    code, text, _ = spoken(
        capsys, "fit", draft, work / "healthy.csv", "--out", tmp_path / "m.fgm", "--json"
    )
    assert code == 0
    assert json.loads(text)["metrics"]["validation_free_run_nrmse"] < 0.1


def test_help_names_every_command_and_loads_nothing_heavy():
    code = (
        "import sys; from faultgauge.cli.app import run; run(['--help']); "
        "assert not {'jax', 'numpy', 'matplotlib', 'scipy'} & set(sys.modules), 'heavy'"
    )
    text = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    for name in ("demo", "check", "inspect", "fit", "evaluate", "calibrate", "estimate"):
        assert f"  {name} " in text


LOGS = {
    "missing column": ("t,u\n0,1\n1,2\n", ["'x'", "bad.csv"]),
    "text": ("t,u,x\n0,1,2\n1,oops,2\n2,1,1\n", ["'oops'", "row 3", "'u'"]),
    "inf": ("t,u,x\n0,1,2\n1,inf,2\n2,1,1\n", ["row 3", "'u'"]),
    "empty file": ("", ["empty"]),
    "one row": ("t,u,x\n0,1,2\n", ["row"]),
    "semicolons": ("t;u;x\n0;1;2\n1;1;2\n", ["semicolon"]),
    "reversed time": ("t,u,x\n0,1,2\n2,1,2\n1,1,2\n", ["'t'", "row 4"]),
    "duplicate time": ("t,u,x\n0,1,2\n1,1,2\n1,1,2\n", ["'t'", "row 4"]),
    "all-empty column": ("t,u,x\n0,,2\n1,,2\n2,,2\n", ["'u'", "empty"]),
    "no time": ("time_s,u,x\n0,1,2\n1,1,2\n", ["--time time_s"]),
    "binary": (b"\x00\x01\x02\xff" * 50, ["binary"]),
}


@pytest.mark.parametrize("kind", list(LOGS))
def test_a_bad_log_is_refused(kind, work, capsys, tmp_path):
    content, says = LOGS[kind]
    bad = tmp_path / "bad.csv"
    bad.write_bytes(content if isinstance(content, bytes) else content.encode())
    out = tmp_path / "m.fgm"
    refused(capsys, "fit", work / "plant.toml", bad, "--out", out, says=["bad.csv", *says])
    assert not out.exists()


def test_no_excitation_is_refused_by_the_networks_argument(work, capsys, tmp_path):
    t = DT * np.arange(400)
    table = np.c_[t, np.ones(400), 2 - np.exp(-A * t)]
    path = tmp_path / "flat.csv"
    np.savetxt(path, table, delimiter=",", header="t,u,x", comments="")
    out = tmp_path / "m.fgm"
    refused(
        capsys, "fit", work / "plant.toml", path, "--out", out, says=["never changes", "'u'", "NN"]
    )


PLANTS = {
    "misspelt key": (PLANT.replace("derivative", "derivatve"), ["[states.x]", "'derivatve'"]),
    "number as unit": (PLANT.replace('value = "x"', 'value = "x"\nunit = 3'), ["unit"]),
    "code": (PLANT.replace("NN(u)", "__import__('os')"), ["column", "__import__"]),
    "attribute": (PLANT.replace("NN(u)", "u.real"), ["column"]),
    "circle": (PLANT.replace("-a*x + NN(u)", "-a*x + d(x) + NN(u)"), ["circle"]),
    "oversized": (PLANT.replace("NN(u)", "NN(u)" + "+u" * 1500), ["longer than"]),
    "reserved": (PLANT.replace("hidden = 3", "hidden = 3\nodd = true"), ["'odd'", "not supported"]),
    "bandwidth": (PLANT.replace("bandwidth = 2", "bandwidth = -2"), ["bandwidth"]),
    "not TOML": ("name = ", ["TOML"]),
}


@pytest.mark.parametrize("kind", list(PLANTS))
def test_a_bad_plant_is_refused(kind, work, capsys, tmp_path):
    text, says = PLANTS[kind]
    bad = tmp_path / "bad.toml"
    bad.write_text(text)
    out = tmp_path / "m.fgm"
    refused(capsys, "fit", bad, work / "healthy.csv", "--out", out, says=["bad.toml", *says])
    assert not out.exists()


def altered(data: bytes) -> bytes:
    return data[:-5] + bytes([data[-5] ^ 1]) + data[-4:]


MODELS = {
    "truncated": lambda good: good[: len(good) // 2],
    "altered": altered,
    "altered text": lambda good: good.replace(b"leak", b"lork", 1),
    "foreign": lambda good: safetensors.numpy.save({"w": np.zeros(3)}),
    "pickled": lambda good: pickle.dumps({"w": [1, 2]}),
    "empty": lambda good: b"",
}


@pytest.mark.parametrize("kind", list(MODELS))
def test_a_bad_model_is_refused(kind, work, capsys, tmp_path):
    bad = tmp_path / "bad.fgm"
    bad.write_bytes(MODELS[kind]((work / "model.fgm").read_bytes()))
    refused(capsys, "evaluate", bad, work / "other.csv", says=["bad.fgm"])


def test_bad_options_are_refused(work, capsys, tmp_path):
    model, log_ = work / "model.fgm", work / "suspect.csv"
    nowhere = tmp_path / "nowhere" / "e.csv"
    for arguments, says in (
        (("estimate", model, log_, "--out", nowhere), ["nowhere"]),
        (("estimate", model, log_, "--out", tmp_path / "e.xls"), [".xls", ".csv"]),
        (("estimate", model, log_, "--out", tmp_path / "e.csv", "--observer", "x"), ["eso"]),
        (("estimate", model, log_, "--out", tmp_path / "e.csv", "--map", "u"), ["--map"]),
        (("estimate", model, log_, "--out", tmp_path / "e.csv", "--map", "u=zz"), ["zz"]),
        (("evaluate", model, tmp_path / "none.csv"), ["none.csv"]),
        (("evaluate", model, log_, "--warmup", "-1"), ["--warmup"]),
        (("evaluate", model, log_, "--wormup", "1"), ["--wormup"]),
        (("evaluate", model), ["logs"]),
        (("calibrate", model, log_, "--mtbfa", "1e9", "--out", tmp_path / "c.fgm"), ["--mtbfa"]),
        (("fit", tmp_path / "p.toml", log_, "--out", tmp_path / "m.fgm"), ["p.toml"]),
    ):
        refused(capsys, *arguments, says=says)
    assert list(tmp_path.iterdir()) == []


def test_a_write_that_fails_leaves_the_old_model_whole(work, capsys, tmp_path, monkeypatch):
    model = tmp_path / "model.fgm"
    model.write_bytes((work / "raw.fgm").read_bytes())

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    refused(capsys, "calibrate", model, work / "other.csv", says=["model.fgm", "No space left"])
    assert model.read_bytes() == (work / "raw.fgm").read_bytes()
    assert list(tmp_path.iterdir()) == [model]


def test_ctrl_c_ends_with_130_and_writes_nothing(work, capsys, tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("faultgauge.identification.fit.fit", interrupted)
    out = tmp_path / "m.fgm"
    code, _, err = spoken(capsys, "fit", work / "plant.toml", work / "healthy.csv", "--out", out)
    assert (code, out.exists()) == (130, False)
    assert "Traceback" not in err


def test_our_own_fault_exits_1_and_says_where_to_report(work, capsys, tmp_path, monkeypatch):
    def broken(*_, **__):
        raise RuntimeError("boom")

    monkeypatch.setattr("faultgauge.identification.fit.fit", broken)
    call = ("fit", work / "plant.toml", work / "healthy.csv", "--out", tmp_path / "m.fgm")
    code, _, err = spoken(capsys, *call)
    assert code == 1
    assert ISSUES in err
    assert "Traceback" not in err
    assert "Traceback" in spoken(capsys, *call, "--debug")[2]


def test_the_console_script_is_installed():
    program = Path(sys.executable).with_name("faultgauge")
    done = subprocess.run([program, "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.strip()
