"""Folders of campaigns: whatever ends one early, and whose they are; runs are made up by hand."""

import errno
import json
import os
import shutil
from importlib import import_module

import pytest

from faultgauge import files as writing
from faultgauge.campaigns import read_campaign
from faultgauge.campaigns.judging import plant_of
from faultgauge.campaigns.schema import label
from faultgauge.cli.app import run as command
from faultgauge.errors import InputError
from faultgauge.plants.gray_box import load_plant
from faultgauge.verbs.campaign import Campaigned, campaign

from .conftest import contents
from .rows import row

pytest.importorskip("pyarrow", reason="needs the extra io.")
CAMPAIGNS = import_module("faultgauge.campaigns.carry_out")


class Killed(BaseException):
    """As a signal that nobody handles."""


class Lab:
    """Every leak is told after 3 s, and nothing else is."""

    def __init__(self, *given):
        pass

    def row(self, run):
        kind = label(run.kinds)
        told = kind if kind == "leak" else ""
        return row(run.number, kind, told, after=3.0 if told else None, seed=run.seed)


@pytest.fixture(scope="module", autouse=True)
def laboratory():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CAMPAIGNS, "_Lab", Lab)
        yield


@pytest.fixture(scope="module")
def done(files, tmp_path_factory, laboratory) -> Campaigned:
    """One that nothing disturbed."""
    return campaign(files / "campaign.toml", tmp_path_factory.mktemp("done") / "out")


def test_the_folder_holds_runs_results_and_a_page(done):
    import pyarrow.parquet as parquet

    table = parquet.read_table(done.folder / "runs.parquet").to_pydict()
    assert table == done.columns()
    content = json.loads((done.folder / "results.json").read_text())
    assert content == json.loads(json.dumps(done.as_dict()))
    page = (done.folder / "report.html").read_text()
    for title in ("Detection against false alarms", "Missed, by size", "What was named"):
        assert title in page


def test_what_is_ended_early_ends_the_same_to_the_byte(done, files, tmp_path, monkeypatch, capsys):
    """Killed between two chunks, then by a full disk; what of a chunk is not whole is not
    believed."""
    out, replace = tmp_path / "out", os.replace
    chunks = out / "chunks"

    def progress(text):
        if list(chunks.glob("*.json")):
            raise Killed

    def full(draft, target):
        if str(target).endswith("00001.json"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        replace(draft, target)

    with pytest.raises(Killed):
        campaign(files / "campaign.toml", out, progress=progress)
    (kept,) = chunks.iterdir()
    before = kept.stat().st_mtime_ns
    call = ["campaign", str(files / "campaign.toml"), "--out", str(out), "--json"]
    with monkeypatch.context() as patch:
        patch.setattr(writing.os, "replace", full)
        assert command(call) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "00001.json: cannot be written" in said.err
    assert said.err.endswith("the disk is full: make room, or choose a folder on another.\n")
    assert list(chunks.iterdir()) == [kept]
    (chunks / "00001.json").write_bytes(b'{"key": "')
    assert command(call) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(done.as_dict()))
    assert kept.stat().st_mtime_ns == before
    assert contents(out) == contents(done.folder)


def test_a_folder_of_another_campaign_is_left_as_it_is(done, written, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(done.folder, out)
    with pytest.raises(InputError, match=r"holds results of another campaign \('leaks'"):
        campaign(written(("seeds = 2", "seeds = 3")), out)
    assert contents(out) == contents(done.folder)


def test_a_damaged_folder_is_named(done, files, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(done.folder, out)
    (out / "campaign.json").write_text("{")
    with pytest.raises(InputError, match=r"campaign.json: is damaged"):
        campaign(files / "campaign.toml", out)


@pytest.mark.parametrize(
    ("named", "more", "words"),
    [
        ('["leek"]', "", ["[faults.silent] named", "'leek'", "'leak'"]),
        ('["leak"]', 'pairs = [["leak", "silent"]]', ["leak and silent both go by", "'leak'"]),
    ],
)
def test_names_that_the_judge_does_not_have(written, tmp_path, named, more, words):
    path = written(("named = []", f"named = {named}"), ("onset = 50", f"onset = 50\n{more}"))
    with pytest.raises(InputError) as refused:
        campaign(path, tmp_path / "out")
    for word in words:
        assert word in str(refused.value)


def test_the_truth_has_nothing_to_fit_and_the_scenarios_constants(files, tmp_path):
    """Of a plant file with free constants, in a scenario that gives one of them another value."""
    for name in ("tank.toml", "scenario.toml", "campaign.toml"):
        text = (files / name).read_text()
        text = text.replace("0.2*x", "a*x") + ("[parameters]\na = 0.3\n" * (name[0] == "s"))
        if name[0] == "t":
            text += '[parameters]\na = { value = 0.2, min = 0, vary = "run" }\n'
        (tmp_path / name).write_text(text.replace("model.fgm", "truth"))
    plant = plant_of(read_campaign(tmp_path / "campaign.toml"))
    (a,) = plant.spec.parameters
    assert (a.value, a.fixed, a.vary) == (0.3, True, None)
    assert float(plant.parameters["a"]) == 0.3
    assert load_plant(tmp_path / "tank.toml").spec.parameters[0].vary == "run"
