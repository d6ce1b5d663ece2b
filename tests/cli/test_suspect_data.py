"""Data that are not what they are taken for: a plain sentence that says what and where."""

import csv
import json
import re

import pytest


def table(path):
    with open(path) as lines:
        return list(csv.DictReader(lines))


@pytest.mark.parametrize("wrong", ["x=x+0.75", "x=0-x"])
def test_calibration_data_that_the_model_does_not_follow_are_named(call, workshop, tmp_path, wrong):
    """A gauge off all over the log, and the model of another plant, whose motor turns the other
    way."""
    args = (workshop.model, workshop.healthy2, "--map", wrong, "--out", tmp_path / "c.fgm")
    said = call("calibrate", *args, "--observer", "eso")  # which is quick: whatever judges, later
    assert said.code == 0, said.err
    assert "run healthy2: the model's free run errs by" in said.err
    assert "a fault all over this log, or the model of another plant" in said.err


def test_the_model_of_another_plant_is_suspected(call, workshop, tmp_path):
    out = tmp_path / "f.csv"
    args = (workshop.calibrated, workshop.healthy, "--map", "x=0-x", "--out", out)
    said = call("estimate", *args)
    assert said.code == 0
    assert "a fault already there when the log begins, or the model of another plant" in said.err
    status = [row["status"] for row in table(out)]
    assert status.count("FAULT") > 0.8 * (len(status) - status.count("NOT_JUDGED"))
    sound = call("estimate", workshop.calibrated, workshop.suspect, *args[4:], "--json")
    assert json.loads(sound.out)["warnings"] == []  # the leak begins in the middle


@pytest.mark.study
def test_faults_that_no_data_tell_apart_are_named(call, workshop, tmp_path):
    """A leak into the tank and a push of its pump, which is declared after the fit, are the same to
    the level."""
    plant, model = tmp_path / "p.toml", tmp_path / "p.fgm"
    push = '\n[faults.push]\nenters = "input"\ntarget = "u"\n'
    plant.write_text(workshop.plant.read_text() + push)
    args = (workshop.model, workshop.healthy2, "--plant", plant, "--out", model)
    said = call("calibrate", *args)
    assert "faults 'leak' and 'push' act on the measured outputs in the same way" in said.err
    out = tmp_path / "f.csv"
    said = call("estimate", model, workshop.suspect, "--out", out)
    assert said.out.startswith("An alarm from 30")
    assert "cause undecided: " in said.out
    last = table(out)[-1]
    assert last["status"] == "FAULT"
    assert "undecided: " in last["reason"]
    assert "leak" in last["reason"]
    assert "push" in last["reason"]


@pytest.mark.parametrize("observer", ["eso", "bank"])
def test_gaps_and_empty_cells_in_the_middle_are_not_judged(call, workshop, tmp_path, observer):
    """No cell of u from 20 to 21 s, no rows from 40 to 45 s."""
    lines = workshop.suspect.read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    rows = [[t, "" if 20 <= float(t) <= 21 else u, x] for t, u, x in rows]
    rows = [row for row in rows if not 40 < float(row[0]) < 45]
    log, out = tmp_path / "log.csv", tmp_path / "f.csv"
    log.write_text("\n".join([lines[0], *(",".join(row) for row in rows)]) + "\n")
    said = call("estimate", workshop.judging(observer), log, "--out", out, "--observer", observer)
    assert said.code == 0
    found = {float(row["t"]): row for row in table(out)}
    assert len(found) == len(rows)
    assert {found[t]["status"] for t in found if 20 <= t <= 21} == {"NOT_JUDGED"}
    assert {found[t]["status"] for t in found if 45 <= t < 45.9} == {"NOT_JUDGED"}  # hold-off
    decided = "FAULT" if observer == "bank" else "NOT_JUDGED"
    assert found[max(found)]["status"] == decided


@pytest.mark.usefixtures("noise_once")
def test_fewer_healthy_data_than_the_rate_needs_say_how_many_it_needs(call, workshop, tmp_path):
    """No alarm in T seconds proves at most T / 3."""
    out = tmp_path / "c.fgm"
    said = call("calibrate", workshop.model, workshop.healthy2, "--mtbfa", "600", "--out", out)
    assert said.code == 2
    assert "give 1800 s of healthy data" in said.err
    assert not out.exists()


@pytest.mark.parametrize("observer", ["eso", "bank"])
def test_a_model_whose_columns_the_log_lacks_is_refused(call, workshop, tmp_path, observer):
    lines = workshop.suspect.read_text().splitlines()
    log, out = tmp_path / "log.csv", tmp_path / "f.csv"
    log.write_text("\n".join(["t,u,speed", *lines[1:]]) + "\n")
    said = call("estimate", workshop.judging(observer), log, "--out", out, "--observer", observer)
    assert said.code == 2
    assert "'x'" in said.err or " x" in said.err
    assert str(log) in said.err
    assert not out.exists()


def test_a_sensor_at_the_end_of_its_range_is_not_judged(call, workshop, tmp_path):
    """From 10 s on the gauge ends at 0.5 m."""
    lines = workshop.healthy.read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    rows = [[t, u, str(min(float(x), 0.5)) if float(t) > 10 else x] for t, u, x in rows]
    log = tmp_path / "log.csv"
    log.write_text("\n".join([lines[0], *(",".join(row) for row in rows)]) + "\n")
    for observer in ("eso", "bank"):
        out = tmp_path / f"{observer}.csv"
        args = (workshop.judging(observer), log, "--out", out, "--observer", observer)
        assert call("estimate", *args).code == 0
        still = [r for r in table(out) if "stuck or saturated" in r["reason"]]
        assert {row["status"] for row in still} == {"NOT_JUDGED"}
        # a third of the time at the end of the range, in stretches of a second
        assert len(still) > 30


def flickering(lines):
    """0 and 1 in turn at one input: a sensor far noisier than any that was calibrated."""
    return [f"{k / 10},5,{k % 2}" for k in range(300)]


def one_usable_row(lines):
    return [f"{line.rsplit(',', 1)[0]}," if k != 7 else line for k, line in enumerate(lines)]


def no_whole_row(lines):
    """Each lacks one of the two columns."""
    rows = [line.split(",") for line in lines]
    return [f"{t},{u}," if k % 2 else f"{t},,{x}" for k, (t, u, x) in enumerate(rows)]


def stuck(lines):
    return [f"{line.rsplit(',', 1)[0]},0.3" for line in lines]


KINDS = (flickering, one_usable_row, no_whole_row, stuck)


@pytest.mark.parametrize(
    ("kind", "observer"),
    [(kind, "eso") for kind in KINDS]
    # the bank on rows without a sample of x: one usable row
    + [
        pytest.param(kind, "bank", marks=[pytest.mark.study] if kind is no_whole_row else [])
        for kind in KINDS
    ],
)
def test_a_log_that_says_next_to_nothing_is_answered_in_numbers(
    call, workshop, tmp_path, kind, observer
):
    """Or refused in a sentence; no number that is printed or written is NaN or infinite."""
    head, *lines = workshop.suspect.read_text().splitlines()
    log, out, report = tmp_path / "log.csv", tmp_path / "e.csv", tmp_path / "r.html"
    log.write_text("\n".join([head, *kind(lines), ""]))
    args = ("estimate", workshop.judging(observer), log, "--observer", observer, "--out", out)
    more = ("--smooth", "--evidence", tmp_path / "ev") if observer == "bank" else ()
    said = call(*args, "--report", report, "--json", *more)
    assert said.code in (0, 2), said.err
    written = [path.read_text() for path in tmp_path.rglob("*.csv") if path != log]
    for text in (said.out, said.err, *written):
        assert not re.search(r"\b(nan|inf|infinity)\b", text, re.IGNORECASE)
    if said.code == 0:
        assert not re.search(r"[>\s,-](nan|inf)[<\s,]", report.read_text(), re.IGNORECASE)
        assert table(out)
