"""`--where`: which rows stay, how a run is split by it, and what is no condition."""

import numpy as np
import pytest
import typer

from faultgauge.cli.app import app
from faultgauge.errors import InputError
from faultgauge.telemetry import inspect_runs, read_telemetry, segments
from faultgauge.telemetry.table import Table
from faultgauge.telemetry.where import met

NAN = np.nan
TABLE = Table(
    "log.csv",
    {
        "u": np.array([-6.0, -1.0, 0.0, 2.0, NAN, 7.0]),
        "mode": np.array([3.0, 3.0, 1.0, 3.0, 3.0, 3.0]),
        "wheel speed": np.arange(6.0),
        "phase": np.array(["idle", "run", " run", "", "run", "idle"], dtype=object),
    },
    np.arange(2, 8),
)


@pytest.fixture
def log(tmp_path):
    def write(text: str, name: str = "log.csv"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


@pytest.mark.parametrize(
    ("condition", "rows"),
    [
        ("mode == 3", [0, 1, 3, 4, 5]),
        ("mode != 3", [2]),
        ("u != 0", [0, 1, 3, 5]),  # an empty cell is neither equal nor different
        ("not u == 0", [0, 1, 3, 5]),
        ("abs(u) < 5 and mode == 3", [1, 3]),
        ("(abs(u) < 5) & (mode == 3)", [1, 3]),
        ("u < -5 or u > 5", [0, 5]),
        ("(u < -5) | (u > 5) | (mode == 1)", [0, 2, 5]),
        ("not (u < 0 or mode == 1)", [3, 5]),
        ("u > 100 or mode == 3", [0, 1, 3, 4, 5]),  # true whatever the empty cell may be
        ("-2 <= u < 2", [1, 2]),
        ("wheel_speed*2 + 1 > u + 4", [0, 2, 3]),
        ("phase == 'run'", [1, 2, 4]),
        ('"run" != phase', [0, 5]),  # an empty text is no phase
        ("1/u > 0", [2, 3, 5]),  # 1/0 is inf, as in IEEE 754
        ("sqrt(u) >= 0", [2, 3, 5]),  # and the root of -1 is nothing
    ],
)
def test_which_rows_meet_a_condition(condition, rows):
    assert np.flatnonzero(met(TABLE, condition)).tolist() == rows


@pytest.mark.parametrize(
    ("condition", "words"),
    [
        ("", ["not a condition"]),
        ("mode", ["'mode'", "no condition"]),
        ("3", ["no condition"]),
        ("mode = 3", ["check operators"]),
        ("mode == 3 and", ["check operators"]),
        ("mode == 3 and u", ["'u'", "no condition"]),
        ("mood == 3", ["'mood'", "did you mean 'mode'"]),
        ("mode == run", ["'run'"]),
        ("mode is 3", ["==", "word"]),
        ("mode in (1, 3)", ["==", "word"]),
        ("mode == 3 & u < 5", ["parentheses"]),
        ("phase == 3", ["quotes"]),
        ("mode == 'a'", ["quotes"]),
        ("phase < 'run'", ["== or !="]),
        ("abs(phase) == 'run'", ["'phase'", "text"]),
        ("__import__('os').system('x') == 0", ["allowed"]),
        ("(lambda: 1)() == 1", ["allowed"]),
        ("u.real == 1", ["allowed"]),
        ("(" * 60 + "u == 1" + ")" * 60, ["nested"]),
        ("not " * 60 + "u == 1", ["nested"]),
        ("u == 1 or " * 300 + "u == 1", ["longer than"]),
        ("u == 1\nor mode == 3", ["check operators"]),
    ],
)
def test_what_is_no_condition(condition, words):
    with pytest.raises(InputError) as caught:
        met(TABLE, condition)
    message = str(caught.value)
    assert "\n" not in message
    for word in ["log.csv, --where", *words]:
        assert word in message


def test_a_condition_may_be_written_over_several_lines_in_parentheses():
    assert met(TABLE, "(mode == 3\n and u > 5)").sum() == 1


def test_kept_rows_and_the_split_between_them(log):
    rows = [f"{k},{k + 0.5},{1 if k in (3, 4, 7) else 3}" for k in range(10)]
    path = log("\n".join(["t,u,mode", *rows]))
    (run,) = read_telemetry(path, where="mode == 3")
    # the first row of each hole stays, empty, so that even a hole of one row splits the run
    np.testing.assert_array_equal(run.t, [0, 1, 2, 3, 5, 6, 7, 8, 9])
    np.testing.assert_array_equal(run.columns["u"], [0.5, 1.5, 2.5, NAN, 5.5, 6.5, NAN, 8.5, 9.5])
    assert segments(run, ["u"]) == [slice(0, 3), slice(4, 6), slice(7, 9)]


def test_rows_at_either_end_leave_no_trace(log):
    path = log("t,u\n0,9\n1,1\n2,2\n3,9\n4,9\n")
    (run,) = read_telemetry(path, where="u < 5")
    np.testing.assert_array_equal(run.t, [1, 2])


def test_maps_come_before_the_condition(log):
    path = log("t,rpm\n0,1\n1,2\n2,3\n")
    (run,) = read_telemetry(path, maps=["w=rpm*10"], where="w >= 20")
    np.testing.assert_array_equal(run.columns["w"], [20, 30])


def test_time_that_runs_backwards_outside_the_condition_does_no_harm(log):
    path = log("t,u,ok\n0,1,0\n5,1,1\n6,2,1\n0,3,0\n")
    (run,) = read_telemetry(path, where="ok == 1")
    np.testing.assert_array_equal(run.t, [5, 6])


def test_runs_by_label_are_kept_apart(log):
    path = log("t,run,u\n0,a,1\n0,b,9\n1,a,2\n1,b,9\n2,a,9\n2,b,9\n3,a,4\n0,c,1\n1,c,2\n")
    first, second = read_telemetry(path, where="u < 5")
    assert (first.name, second.name) == ("log:a", "log:c")  # nothing is left of b
    np.testing.assert_array_equal(first.columns["u"], [1, 2, NAN, 4])


def test_a_slow_mode_column_keeps_its_last_value(log):
    rows = [f"{k / 100},{k},{k // 10 if k % 10 == 0 else ''}" for k in range(100)]
    path = log("\n".join(["t,u,mode", *rows]))
    (run,) = read_telemetry(path, names=["u"], where="mode == 3")
    np.testing.assert_array_equal(run.columns["u"], np.arange(30.0, 40.0))


def test_a_slow_text_column_keeps_its_last_text(log):
    rows = [f"{k / 100},{k},{'ab'[k // 20 % 2] if k % 10 == 0 else ''}" for k in range(100)]
    path = log("\n".join(["t,u,phase", *rows]))
    (run,) = read_telemetry(path, names=["u"], where="phase == 'b' and u < 50")
    np.testing.assert_array_equal(run.columns["u"], np.arange(20.0, 40.0))


def test_no_row_left(log):
    path = log("t,u\n0,1\n1,2\n2,9\n")
    for condition in ("u > 100", "u == 1"):  # one row is no run
        with pytest.raises(InputError, match=r"log\.csv, --where: no run has two rows"):
            read_telemetry(path, where=condition)


def test_inspection_reads_the_same_rows(log):
    path = log("t,u,mode\n0,1,a\n1,2,a\n2,3,b\n3,4,b\n")
    (run,) = inspect_runs(path, where="mode == 'b'").runs
    assert (run.rows, run.start, run.end) == (2, 2, 3)


def test_every_command_that_maps_columns_can_choose_rows():
    commands = typer.main.get_command(app).commands
    options = {
        name: {option for each in command.params for option in each.opts}
        for name, command in commands.items()
    }
    readers = {name for name, found in options.items() if "--map" in found}
    assert {"fit", "evaluate", "calibrate", "estimate", "check", "inspect"} <= readers
    assert all("--where" in options[name] for name in readers)


def test_the_command_line_passes_the_condition_on(log, capsys):
    path = log("t,u\n0,1\n1,2\n2,9\n")
    with pytest.raises(InputError, match="--where"):
        typer.main.get_command(app)(["inspect", str(path), "--where", "u >"], standalone_mode=False)
    typer.main.get_command(app)(
        ["inspect", str(path), "--where", "u < 5", "--json"], standalone_mode=False
    )
    assert '"rows": 2' in capsys.readouterr().out
