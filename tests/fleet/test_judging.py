"""`calibrate --fleet` and `estimate --fleet`: for every unit what the verbs say of it alone."""

import json

import pytest

from faultgauge.cli.app import run

from .conftest import drawn, write_log

pytestmark = pytest.mark.study


def test_a_unit_of_a_fleet_is_judged_as_it_is_alone(fleet, tmp_path, capsys):
    """The same table to the byte; the units without a model or a log are named, or left out."""
    a, b = drawn(0)
    write_log(tmp_path / "healthy" / "tank0.csv", 20, a, b, count=600)
    write_log(tmp_path / "today" / "tank0.csv", 21, a, b, count=600)
    write_log(tmp_path / "today" / "stranger.csv", 22, a, b, count=600)
    folder, out = tmp_path / "calibrated", tmp_path / "out"
    call = ["calibrate", fleet.folder, tmp_path / "healthy", "--fleet", "--out", folder]
    assert run([str(each) for each in call]) == 0
    call = ["estimate", folder, tmp_path / "today", "--fleet", "--out", out, "--json"]
    capsys.readouterr()
    assert run([str(each) for each in call]) == 0
    told = json.loads(capsys.readouterr().out)
    assert list(told["units"]) == ["tank0"]
    assert "has no model in this fleet" in told["failed"]["stranger"]
    alone = tmp_path / "alone.csv"
    model = folder / "units" / "tank0.fgm"
    call = ["estimate", model, tmp_path / "today" / "tank0.csv", "--out", alone]
    assert run([str(each) for each in call]) == 0
    assert (out / "tank0.csv").read_bytes() == alone.read_bytes()
