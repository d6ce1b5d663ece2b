"""`--where`: which rows stay, how a run is split by it, and what is no condition."""

from pathlib import Path

import numpy as np
import pytest
import typer

from faultgauge.cli.app import app
from faultgauge.errors import InputError
from faultgauge.telemetry import inspect_runs, read_telemetry, segments
from faultgauge.telemetry.table import LogTable
from faultgauge.telemetry.where import met

NAN = np.nan
DATA = Path(__file__).parents[1] / "data"
TABLE = LogTable(
    "log.csv",
    {
        "u": np.array([-6.0, -1.0, 0.0, 2.0, NAN, 7.0]),
        "mode": np.array([3.0, 3.0, 1.0, 3.0, 3.0, 3.0]),
        "wheel speed": np.arange(6.0),
        "phase": np.array(["idle", "run", " run", "", "run", "idle"], dtype=object),
    },
    np.arange(2, 8),
)


def met_rows(condition: str) -> list[int]:
    """The rows of TABLE, one a second, that meet `condition`."""
    found = met(TABLE, condition, "t", np.arange(6.0), {"log": np.arange(6)})
    return np.flatnonzero(found).tolist()


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
    assert met_rows(condition) == rows


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
        met_rows(condition)
    message = str(caught.value)
    assert "\n" not in message
    for word in ["log.csv, --where", *words]:
        assert word in message


def test_a_condition_may_be_written_over_several_lines_in_parentheses():
    assert met_rows("(mode == 3\n and u > 5)") == [5]


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


def sampled_at(cells: dict[int, object], rows: int = 100) -> str:
    """A log at 10 Hz with `u` the row number and `mode` empty but for `cells`."""
    return "\n".join(["t,u,mode", *(f"{k / 10},{k},{cells.get(k, '')}" for k in range(rows))])


def kept(path, where: str) -> list[float]:
    (run,) = read_telemetry(path, names=["u"], where=where)
    return run.columns["u"][np.isfinite(run.columns["u"])].tolist()


@pytest.mark.parametrize("modes", [{1: 1, 2: 2, 3: 3}, {1: "idle", 2: "spin", 3: "run"}])
def test_a_mode_logged_on_change_holds_until_the_next(log, modes):
    cells = {5: modes[1], 10: modes[2], 17: modes[1], 40: modes[3], 70: modes[1], 95: modes[3]}
    path = log(sampled_at(cells))
    written = repr(modes[1])
    assert kept(path, f"mode == {written}") == [*range(5, 10), *range(17, 40), *range(70, 95)]
    assert kept(path, f"mode == {modes[3]!r}") == [*range(40, 70), *range(95, 100)]
    # what the mode was before its first value is not known
    assert kept(path, f"not mode == {written}") == [*range(10, 17), *range(40, 70), *range(95, 100)]


def test_a_mode_that_is_logged_once_holds_to_the_end(log):
    assert kept(log(sampled_at({30: 2})), "mode == 2") == list(range(30, 100))
    (run,) = read_telemetry(log("t,mode\n0,\n1,2\n2,\n"), where="mode == 2")
    np.testing.assert_array_equal(run.t, [1, 2])


def test_even_phases_are_no_clock(log):
    """Logged every second for four seconds and then no more: the values never repeat."""
    path = log(sampled_at({0: 1, 10: 2, 20: 1, 30: 2}))
    assert kept(path, "mode == 2") == [*range(10, 20), *range(30, 100)]


def test_modes_that_change_in_bursts(log):
    path = log(sampled_at({0: 1, 1: 2, 2: 3, 3: 4, 60: 1, 61: 2, 62: 3, 63: 4}))
    assert kept(path, "mode == 4") == [*range(3, 60), *range(63, 100)]


def test_a_mode_of_one_run_says_nothing_of_another(log):
    lines = ["t,run,u,mode", "0,a,0,1", "1,a,1,", "2,a,2,", "0,b,3,", "1,b,4,1", "2,b,5,"]
    runs = read_telemetry(log("\n".join(lines)), names=["u"], where="mode == 1")
    assert [run.columns["u"].tolist() for run in runs] == [[0, 1, 2], [4, 5]]


def test_a_dropout_of_full_rate_is_not_held(log):
    cells = {k: 3 for k in range(100) if k not in (20, *range(50, 80))}
    assert kept(log(sampled_at(cells)), "mode == 3") == list(cells)


def test_many_dropouts_of_full_rate_are_not_held(log):
    cells = {k: 3 for k in range(100) if k % 7 not in (2, 5)}  # steps 1 and 2: no even rate
    assert kept(log(sampled_at(cells)), "mode == 3") == list(cells)


def test_a_sensor_of_full_rate_that_dies_is_not_held(log):
    cells = {k: 3.25 + k for k in range(30)}
    assert kept(log(sampled_at(cells)), "mode > 0") == list(range(30))


def test_a_slow_periodic_column_holds_over_two_missed_samples_and_not_over_more(log):
    """Every 5 rows: held over 70 and 75, and for its own interval where 25 to 55 are missing."""
    cells = {k: 3 for k in range(0, 100, 5) if not 25 <= k < 60 and k not in (70, 75)}
    assert kept(log(sampled_at(cells)), "mode == 3") == [*range(25), *range(60, 100)]


def test_rows_of_another_clock_are_no_dropouts(log):
    """`u` every 0.1 s and `y` every 0.3 s, 0.01 s later: u holds on the rows that are y's."""
    rows = [(k / 10, f"{k / 10},{k},") for k in range(60)]
    rows += [(k / 10 + 0.01, f"{k / 10 + 0.01},,{k}") for k in range(0, 60, 3)]
    path = log("\n".join(["t,u,y", *(text for _, text in sorted(rows))]))
    (run,) = read_telemetry(path, names=["y"], where="u >= 30")
    assert run.columns["y"].tolist() == list(range(30, 60, 3))


def clocked(log, out):
    """A log at 10 Hz with `x` on every row, `y` and `z` on every tenth; `ok` is 0 on rows `out`."""
    cells = (f"{k if k % 10 == 0 else ''}" for k in range(101))
    rows = [f"{k / 10},{k},{y},{y},{int(k not in out)}" for k, y in enumerate(cells)]
    return log("\n".join(["t,x,y,z,ok", *rows]))


@pytest.mark.parametrize("names", [["y"], ["y", "z"]])
def test_a_hole_between_two_samples_of_slow_columns_splits_the_run(log, names):
    (run,) = read_telemetry(clocked(log, range(33, 38)), names=names, where="ok == 1")
    np.testing.assert_allclose(run.t, [0, 1, 2, 3, 3.3, *range(4, 11)])
    assert segments(run, names) == [slice(0, 4), slice(5, 12)]


@pytest.mark.parametrize(
    ("out", "left"),
    [
        (range(33, 38), [*range(31), *range(40, 101)]),
        (range(38, 44), [*range(31), *range(50, 101)]),
    ],
)
@pytest.mark.parametrize("held", [[], ["y"]])
def test_a_slow_column_is_not_filled_across_a_hole(log, held, out, left):
    """Of what lies in the hole nothing is known, and the sample at 40 may be out of it."""
    path = clocked(log, out)
    (run,) = read_telemetry(path, names=["x", "y"], held=held, where="ok == 1")
    both = np.isfinite(run.columns["x"]) & np.isfinite(run.columns["y"])
    assert run.columns["x"][both].tolist() == left


def test_a_mode_topic_of_a_bag():
    """/mode twice in the bag: idle at 0 s, run at 0.25 s (row 25 of 50)."""
    bag = {"maps": ["w=imu_angular_velocity_x"], "names": ["w"]}
    (run,) = read_telemetry(DATA / "rosbags.mcap", where="mode_data == 'run'", **bag)
    np.testing.assert_array_equal(run.columns["w"], np.arange(25, 50) / 2)
    (run,) = read_telemetry(DATA / "rosbags.mcap", where="mode_data == 'idle'", **bag)
    np.testing.assert_array_equal(run.columns["w"], np.arange(25) / 2)


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
