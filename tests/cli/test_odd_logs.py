"""Logs with headers, units and clocks of their own, from the command line."""

import re
from datetime import datetime, timedelta

import numpy as np
import pytest

from faultgauge.cli.app import run
from faultgauge.errors import InputError
from faultgauge.plants.model import load_model

BEGIN = datetime(2026, 11, 22, 14, 3, 7)


def oddly(source, path):
    """A log of the workshop as a German measuring program writes it: volts in mV, metres in cm."""
    values = np.loadtxt(source, delimiter=",", skiprows=1)
    lines = ["Zeit;u [mV];Füllstand (cm)"]
    for t, u, x in values:
        at = BEGIN + timedelta(seconds=t)
        clock = f"{at:%d.%m.%Y %H:%M:%S},{at.microsecond // 100_000}"
        lines.append(
            f"{clock};{1000 * u:.10g};{100 * x:.10g}".replace(".", ",").replace(
                clock.replace(".", ","), clock
            )
        )
    path.write_text("\n".join([*lines, ""]), encoding="utf-8-sig")
    return path


@pytest.fixture(scope="module")
def odd(workshop, tmp_path_factory):
    """The odd logs, and a model that was fitted to the first with all that has to be said."""
    folder = tmp_path_factory.mktemp("odd")
    logs = [oddly(workshop.healthy, folder / "a.csv"), oddly(workshop.healthy2, folder / "b.csv")]
    said = ["--time", "Zeit", "--map", "x=Füllstand"]
    model = folder / "model.fgm"
    assert run(["fit", str(workshop.plant), str(logs[0]), "--out", str(model), *said]) == 0
    return *logs, model


def test_the_fit_is_that_of_the_plain_log(workshop, odd):
    own, plain = (load_model(each).plant.parameters for each in (odd[2], workshop.model))
    for name, value in plain.items():
        # ten digits of each cell
        assert float(own[name]) == pytest.approx(float(value), rel=1e-6)


def test_what_was_said_at_the_fit_need_not_be_said_again(workshop, odd, call):
    _, log, model = odd
    assert load_model(model).reading == {"time": "Zeit", "maps": ["x=Füllstand"]}
    found = call("evaluate", model, log, "--json")
    assert found.json["outputs"]["x"]["r2"] > 0.999
    assert 'b.csv: read as the logs of the fit, with --time Zeit --map "x=Füllstand"' in found.err
    assert "b.csv: converted to the plant's units: 'u' from mV to V, 'x' from cm to m." in found.err
    assert "b.csv: cells are separated by semicolons, numbers have decimal commas." in found.err
    plain = call("evaluate", model, workshop.healthy2, "--json")  # it has none of those columns
    assert "note" not in plain.err
    assert plain.json["outputs"]["x"]["r2"] == pytest.approx(
        found.json["outputs"]["x"]["r2"],
        rel=1e-9,  # ten digits of each cell
    )
    other = call("evaluate", model, log, "--map", "x=Füllstand/100 + 1", "--json")
    assert "--map" not in other.err
    assert other.json["outputs"]["x"]["r2"] < plain.json["outputs"]["x"]["r2"]


def test_swapped_columns_are_told_in_a_sentence(workshop, call, tmp_path):
    rows = workshop.healthy2.read_text().splitlines()
    swapped = tmp_path / "swapped.csv"
    swapped.write_text(
        "\n".join(
            [
                "t,u,x",
                *(",".join([t, x, u]) for t, u, x in (row.split(",") for row in rows[1:])),
                "",
            ]
        )
    )
    found = call("evaluate", workshop.model, swapped)
    (warning,) = [line for line in found.err.splitlines() if line.startswith("warning")]
    assert "swapped.csv: " in warning
    assert "u is" in warning
    assert "x is -1 to 1, " in warning.replace(" m, ", ", ")
    assert warning.endswith("where the model was fitted: the columns x and u look swapped.")
    assert len(found.err.splitlines()) + len(found.out.splitlines()) <= 5


def test_check_takes_several_healthy_logs(workshop, call, monkeypatch, tmp_path):
    taken = {}

    def look_into(good, doubtful, *rest, **more):
        taken.update(good=[each.name for each in good], doubtful=[each.name for each in doubtful])
        raise InputError("enough.")

    monkeypatch.setattr("faultgauge.verbs.check.check", look_into)
    both = ["healthy", "healthy2"]
    call("check", workshop.healthy, workshop.suspect, "--healthy", workshop.healthy2)
    assert taken == {"good": both, "doubtful": ["suspect"]}
    for name in both:
        (tmp_path / f"{name}.csv").write_text((workshop.folder / f"{name}.csv").read_text())
    call("check", tmp_path, workshop.suspect, "--plant", workshop.plant)
    assert taken == {"good": both, "doubtful": ["suspect"]}


def test_presets_are_listed_and_printed(call, tmp_path):
    listed = call("presets")
    assert "tank                       tank: u -> level" in listed.out.splitlines()
    assert set(call("presets", "--json").json["presets"]) == {
        line.split()[0] for line in listed.out.splitlines()
    }
    printed = call("presets", "tank")
    (tmp_path / "plant.toml").write_text(printed.out)
    (tmp_path / "log.csv").write_text("t,u,level\n0,1,2\n1,2,3\n")
    assert call("presets", "tank", "--json").json["text"].strip() == printed.out.strip()
    refused = call("presets", "tunk")
    assert (refused.code, "did you mean 'tank'" in refused.err) == (2, True)


@pytest.mark.parametrize("command", ["fit", "export", "simulate"])
def test_help_says_that_out_is_required(call, command):
    said = " ".join(call(command, "--help").out.split())
    option = said[said.index("--out") :]
    assert "[required" in option[: option.index(" --", 5)]


def test_inspect_shows_headers_as_they_are(call, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("t,T [degC],x [raw],[bold]\n0,1,5,3\n1,2,7,4\n2,3,6,5\n")
    shown = call("inspect", log)
    for text in ("T  *degC", r"x \[raw\]", r"\[bold\]"):
        assert re.search(f"^ {text} ", shown.out, re.MULTILINE)
    names = {each["name"]: each["unit"] for each in call("inspect", log, "--json").json["columns"]}
    assert names == {"T": "degC", "x [raw]": "", "[bold]": ""}


def test_no_text_of_a_log_reaches_the_terminal_as_a_command(call, workshop, tmp_path):
    """Names of files, columns and runs, and cells, with escape sequences in them."""
    log = tmp_path / "log\x1b[31m.csv"
    log.write_text(
        "t,run,u,\x1b]0;x\x07,x\n" + "".join(f"{k},\x1b[2J,{k % 2},1,{k}\n" for k in range(9))
    )
    for command in (
        ("inspect", log),
        ("inspect", log, "--json"),
        ("evaluate", workshop.model, log),
    ):
        said = call(*command)
        assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", said.out + said.err), command


@pytest.mark.study
def test_a_newcomer_with_an_odd_log_has_an_answer_in_four_commands(workshop, call, tmp_path):
    """The leak as from the plain logs, from logs that no command needs a --map for."""
    names = ("healthy", "healthy2", "suspect")
    for name in names:
        oddly(workshop.folder / f"{name}.csv", tmp_path / f"{name}.csv")
    healthy, more, suspect = (tmp_path / f"{name}.csv" for name in names)
    model, plant = tmp_path / "model.fgm", tmp_path / "plant.toml"
    text = workshop.plant.read_text().replace("[outputs.x]", '[outputs."Füllstand"]')
    plant.write_text(text)
    assert "--time Zeit" in call("inspect", healthy).err
    assert call("fit", plant, healthy, "--time", "Zeit", "--out", model).code == 0
    assert call("calibrate", model, more).code == 0
    found = call("estimate", model, suspect, "--out", tmp_path / "answer.csv", "--json")
    plain = call(
        "estimate",
        workshop.calibrated,
        workshop.suspect,
        "--out",
        model.with_suffix(".csv"),
        "--json",
    )
    (event,), (same,) = (each.json["events"] for each in (found, plain))
    assert event["fault"] == "leak"
    assert event["lo"] <= workshop.leak <= event["hi"]
    for key in ("size", "start", "end"):
        # ten digits of each cell, through two calibrations
        assert event[key] == pytest.approx(same[key], rel=1e-3)


def test_a_clock_is_shown_whole_with_its_zone(call, tmp_path):
    log = tmp_path / "a_log_whose_name_is_longer_than_its_column_is_wide.csv"
    rows = [f"{1772438400000 + 10 * k},{k % 7}" for k in range(50)]  # date -d @1772438400
    log.write_text("\n".join(["stamp,x", *rows, ""]))
    table, _, _ = call("inspect", log, "--time", "stamp").out.partition("hint:")
    shown = " ".join(table.split())
    assert shown.count("2026-03-02") == 2
    assert "08:00:00" in shown
    assert "UTC" in shown
    assert "…" not in shown
