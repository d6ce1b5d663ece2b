"""No command writes over what it reads, over another of its outputs, or over what is no file."""

import inspect
import os
import shutil
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from faultgauge.cli.app import COMMANDS
from faultgauge.cli.writing import Fills, Reads, Writes, guarded
from faultgauge.errors import InputError

SCENARIO = """name = "tank"
plant = "model.fgm"
seconds = 4
step = 0.1
[inputs.u]
source = "log"
path = "log.csv"
column = "u"
"""


@pytest.fixture
def files(workshop, tmp_path):
    """A folder of one's own with model, log and plant, and links to each."""
    for name, source in (
        ("model.fgm", workshop.calibrated),
        ("log.csv", workshop.suspect),
        ("good.csv", workshop.healthy),
        ("plant.toml", workshop.plant),
    ):
        shutil.copy(source, tmp_path / name)
    os.symlink(tmp_path / "log.csv", tmp_path / "soft.csv")
    os.link(tmp_path / "log.csv", tmp_path / "hard.csv")
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    (tmp_path / "log.injections.ndjson").symlink_to(tmp_path / "model.fgm")
    return tmp_path


CALLS = [
    "estimate model.fgm log.csv --out log.csv",
    "estimate model.fgm log.csv --out soft.csv",
    "estimate model.fgm log.csv --out hard.csv",
    "estimate model.fgm soft.csv --out ../FOLDER/log.csv",
    "estimate model.fgm log.csv --out e.csv --report log.csv",
    "estimate model.fgm log.csv --out e.csv --report model.fgm",
    "estimate model.fgm log.csv --out e.csv --report e.csv",
    "estimate model.fgm log.csv --out e.csv --report ./e.csv",
    "estimate model.fgm - --events model.fgm",
    "estimate model.fgm log.csv --out /dev/null.csv/../null",
    "estimate model.fgm log.csv --out e.csv --report /dev/null",
    "estimate model.fgm log.csv --out e.csv --report pipe",
    "fit plant.toml good.csv --out good.csv",
    "fit plant.toml good.csv --out plant.toml",
    "fit plant.toml good.csv --out m.fgm --report plant.toml",
    "fit plant.toml good.csv --validate log.csv --out soft.csv",
    "calibrate model.fgm good.csv --out good.csv",
    "calibrate model.fgm good.csv --report model.fgm",
    "calibrate model.fgm good.csv --out model.fgm --report model.fgm",
    "calibrate model.fgm good.csv --plant plant.toml --out plant.toml",
    "evaluate model.fgm log.csv --report log.csv",
    "rehearse model.fgm log.csv --report hard.csv",
    "rehearse model.fgm log.csv --out r --report r/trials.csv",
    "detectability model.fgm log.csv --report hard.csv",
    "check good.csv log.csv --report hard.csv",
    "check good.csv log.csv --out r --report r/report.html",
    "inspect log.csv --init-plant soft.csv",
    "demo --out log.csv",
    "simulate scenario.toml --out log.csv",
    "simulate scenario.toml --out e.csv --report scenario.toml",
    "simulate scenario.toml --out e.csv --report model.fgm",
    "simulate scenario.toml --realtime 1e6 --control c.csv --out c.csv",
    "simulate scenario.toml --realtime 1e6 --out log.csv.gz",
]


@pytest.mark.parametrize("line", CALLS)
def test_what_would_be_lost_is_refused(call, files, monkeypatch, line):
    monkeypatch.chdir(files)
    os.mkfifo("pipe")
    before = {p: p.read_bytes() for p in files.iterdir() if p.is_file()}
    said = call(*line.replace("FOLDER", files.name).split())
    assert said.code == 2, said.err
    assert said.err.startswith("faultgauge: ")
    assert said.err.count("\n") == 1
    assert {p: p.read_bytes() for p in files.iterdir() if p.is_file()} == before
    assert sorted(p.name for p in files.iterdir() if p.is_dir()) in ([], ["r"])


def test_the_sentence_names_option_file_and_what_to_do(call, files, monkeypatch):
    monkeypatch.chdir(files)
    assert call("estimate", "model.fgm", "log.csv", "--out", "soft.csv").err == (
        "faultgauge: --out: soft.csv is what this call reads and would be lost; give another "
        "name.\n"
    )
    said = call("estimate", "model.fgm", "log.csv", "--out", "e.csv", "--report", "e.csv")
    assert "--report: e.csv is what this call writes for --out" in said.err
    said = call("estimate", "model.fgm", "log.csv", "--out", "e.csv", "--report", "/dev/null")
    assert "/dev/null: is a device, not a file" in said.err


def test_a_model_may_be_replaced_by_its_calibration(call, files, monkeypatch):
    monkeypatch.chdir(files)
    shutil.copy("model.fgm", "other.fgm")
    eso = ("--observer", "eso")
    assert call("calibrate", "model.fgm", "good.csv", *eso).code == 0
    assert call("calibrate", "other.fgm", "good.csv", *eso, "--out", "./other.fgm").code == 0
    assert Path("model.fgm").read_bytes() == Path("other.fgm").read_bytes()


def test_evidence_is_none_of_the_inputs(call, files, monkeypatch):
    """Its names are known when the events are: a log that has one of them stays as it is."""
    monkeypatch.chdir(files)
    found = call("estimate", "model.fgm", "log.csv", "--out", "e.csv", "--evidence", "ev", "--json")
    assert found.code == 0, found.err
    (path,) = {Path(event["evidence"]) for event in found.json["events"]}
    path.unlink()
    path.symlink_to(files / "log.csv")
    Path("e.csv").unlink()
    said = call("estimate", "model.fgm", "log.csv", "--out", "e.csv", "--evidence", "ev")
    assert said.code == 2
    assert f"--evidence: {path} is what this call reads" in said.err
    assert not Path("e.csv").exists(), "nothing is written before"


@pytest.mark.parametrize("command", COMMANDS, ids=lambda each: each.__name__)
def test_every_path_of_every_command_says_what_becomes_of_it(command):
    hints = get_type_hints(inspect.unwrap(command), include_extras=True)
    for name, hint in hints.items():
        if "Path" in str(get_args(hint)[:1]):
            assert any(isinstance(each, Reads | Writes | Fills) for each in get_args(hint)), name


def test_standard_output_that_is_a_file_counts_too(tmp_path, monkeypatch):
    from typing import Annotated

    @guarded
    def command(out: Annotated[Path, Writes()]) -> None:
        raise AssertionError

    with open(tmp_path / "o.csv", "w") as file, monkeypatch.context() as patched:
        patched.setattr("sys.stdout", file)
        with pytest.raises(InputError, match="prints to"):
            command(tmp_path / "o.csv")
