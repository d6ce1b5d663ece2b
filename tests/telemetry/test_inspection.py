"""What a log is said to hold, and the plant file that is guessed from it."""

import json
import re
import tomllib

import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.telemetry import Run, inspect_runs, plant_skeleton
from faultgauge.telemetry.statistics import statistics


@pytest.fixture
def log(tmp_path):
    def write(text: str, name: str = "log.csv") -> str:
        (tmp_path / name).write_text(text)
        return str(tmp_path / name)

    return write


def runs(**columns) -> list[Run]:
    arrays = {name: np.array(values, dtype=np.float64) for name, values in columns.items()}
    count = len(next(iter(arrays.values()), [0, 1]))
    return [Run("log", "log.csv", 0.1 * np.arange(count), arrays)]


def of(values, step=0.1):
    return statistics([step * np.arange(len(values))], [np.array(values, dtype=np.float64)])


def test_runs_are_described(log):
    path = log("t,u,mode\n0,1,a\n1,,b\n2,3,\n3,4,a\n8,5,a\n9,6,a\n")
    (run,) = inspect_runs(path).runs
    assert (run.name, run.source, run.rows) == ("log", path, 6)
    assert (run.start, run.end, run.duration) == (0, 9, 9)
    assert (run.step, run.rate) == (1, 1)
    assert [(gap.start, gap.length) for gap in run.gaps] == [(3, 5)]
    assert run.empty == {"u": 1, "mode": 1}
    # |step - 1| is 0 four times and 4 once; the 95th percentile lies 0.8 of the way between
    assert run.jitter == pytest.approx(3.2, rel=1e-12)


def test_columns_are_described(log):
    columns = inspect_runs(log("t,u,mode,dead\n0,1,a,\n1,,b,\n2,3,,\n3,5,a,\n")).columns
    u, mode, dead = columns
    assert [column.kind for column in columns] == ["number", "text", "empty"]
    assert (u.share_empty, mode.share_empty, dead.share_empty) == (0.25, 0.25, 1)
    assert (u.statistics.min, u.statistics.max, u.statistics.mean) == (1, 5, 3)
    assert u.statistics.std == pytest.approx(np.sqrt(8 / 3), rel=1e-12)
    assert mode.statistics is None
    assert dead.statistics.mean is None


def test_columns_pool_over_runs_and_files(log):
    first = log("t,run,u\n0,a,1\n1,a,2\n0,b,3\n1,b,4\n", "a.csv")
    second = log("t,u,h\n0,5,7\n1,6,8\n", "b.csv")
    report = inspect_runs([first, second])
    assert [run.name for run in report.runs] == ["a:a", "a:b", "b"]
    assert [column.name for column in report.columns] == ["u", "h"]
    assert report.columns[0].statistics.mean == 3.5


def test_the_report_is_json(log):
    report = inspect_runs(log("t,u,dead,mode\n0,1,,on\n1,inf,,on\n2,3,,on\n"))
    read_back = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert read_back["columns"][0]["statistics"]["max"] == 3
    assert read_back["runs"][0]["rows"] == 3


def test_noise_is_found_under_a_smooth_signal():
    rng = np.random.default_rng(0)
    t = 0.01 * np.arange(20_000)
    noise = of(np.sin(t) + 0.02 * rng.normal(size=t.size), step=0.01).noise
    # The MAD of n normal values is good to 1.17/sqrt(n); third differences are correlated: 3 %.
    assert noise == pytest.approx(0.02, rel=0.03)


def test_noise_does_not_see_gaps():
    t = (100 * np.arange(5)[:, None] + np.arange(3.0)).ravel()  # bursts of three: no four in a row
    assert statistics([t], [t**2]).noise is None
    assert of(np.arange(9.0) ** 2).noise == 0
    assert of([1, 2, 4]).noise is None


def test_quantum_is_the_resolution():
    rng = np.random.default_rng(1)
    # 0.1 * k and k / 10 differ in the last bit, which is no resolution
    values = np.concatenate([0.1 * np.arange(20), np.arange(20) / 10, 0.1 * rng.integers(0, 20, 9)])
    assert of(values).quantum == pytest.approx(0.1, rel=1e-9)
    assert of([5, 5, 5]).quantum is None


def test_constant_and_stuck():
    assert of([2, 2, 2, 2]).constant
    moving = of([1, 2, 2, 2, 2, 3, 3, 4])
    assert not moving.constant
    assert moving.stuck == pytest.approx(0.3, rel=1e-12)
    assert of([1, 2, 3]).stuck == 0


def test_a_held_signal_is_told_from_a_slow_coarse_one():
    rng = np.random.default_rng(2)
    assert of(np.repeat(rng.normal(size=50), 10)).held
    assert of(np.tile(np.repeat([0.0, 5.0], 20), 5)).held  # a switch
    assert not of(np.round(np.linspace(0, 20, 2000))).held  # an encoder
    assert not of(rng.normal(size=500)).held
    assert not of(np.full(100, 3.0)).held


@pytest.mark.parametrize(
    ("text", "time", "words"),
    [
        ("t_ms,u\n0,1\n10,2\n", "t_ms", ["'t_ms'", '--map "t=t_ms/1000"']),
        ("t,u\n0,1\n10,2\n", None, ["'t'", "milliseconds"]),
        ("t,u\n0,1\n1.5,1\n", None, ["'u'", "never changes (1)"]),
        ("t,u\n0,\n1.5,\n", None, ["'u'", "empty"]),
        ("t,u\n0,1\n.1,inf\n", None, ["row 3", "'u'", "infinite"]),
        ("t,u\n0,1\n.1,2\n.2,ERR\n", None, ["row 4", "'u'", "'ERR'"]),
        ("t,wheel speed\n0,1\n.1,2\n", None, ["'wheel speed'", "wheel_speed"]),
        ("t,u\n0,1\n.1,2\n.2,2\n.9,2\n", None, ["1 gap(s)", "0.7 s"]),
        ("t,u\n0,1\n.1,2\n.3,2\n.4,2\n.6,3\n", None, ["unevenly"]),
    ],
)
def test_hints_say_what_to_do(log, text, time, words):
    hints = inspect_runs(log(text), time=time).hints
    assert any(all(word in hint for word in words) for hint in hints), hints


@pytest.mark.parametrize("step", [2, 5, 30, 60, 0.5])
def test_steps_that_are_usual_in_seconds_are_no_milliseconds(log, step):
    assert inspect_runs(log(f"t,u\n0,1\n{step},2\n{2 * step},4\n")).hints == ()


def test_a_clean_log_and_a_text_column_give_no_hint(log):
    assert inspect_runs(log("t,u,mode\n0,1,on\n.1,2,off\n.2,4,\n")).hints == ()


def test_time_is_refused_as_by_reading(log):
    with pytest.raises(InputError, match="--time t_s"):
        inspect_runs(log("t_s,u\n0,1\n1,2\n"))
    with pytest.raises(InputError, match="backwards"):
        inspect_runs(log("t,u\n1,1\n0,2\n"))


def test_skeleton_guesses_roles():
    text = plant_skeleton(
        runs(
            pump_V=[-0.5, 0.75],
            level=[1, 2],
            y_V=[3, 4],
            level_ref=[0, 0],
            d_level=[5, 6],
            Sollwert=[7, 8],
        ),
        "tank",
    )
    plant = tomllib.loads(text)
    assert plant["name"] == "tank"
    assert set(plant["inputs"]) == {"pump_V"}
    assert set(plant["states"]) == set(plant["outputs"]) == {"level", "y_V"}
    assert plant["states"]["level"] == {"derivative": "NN_level(level, y_V, pump_V)"}
    assert plant["outputs"]["y_V"] == {"value": "y_V"}
    assert plant["networks"] == {"NN_level": {"hidden": 10}, "NN_y_V": {"hidden": 10}}
    assert '"level_ref" (looks like a setpoint' in text
    assert '"Sollwert" (looks like a setpoint' in text
    assert '"d_level" (read as the derivative of level)' in text


def test_skeleton_still_parses_with_its_examples_uncommented():
    text = plant_skeleton(runs(u=[-0.5, 0.75], h=[1, 2]), "wheel")
    example = re.compile(r"^# (?=\[\w+[.\]]|\w+ = [-\"\[\d])", re.MULTILINE)
    plant = tomllib.loads(example.sub("", text))
    assert plant["inputs"]["u"] == {"unit": "...", "min": -0.5, "max": 0.75}
    assert plant["faults"] == {
        "h_drift": {"enters": "state", "target": "h"},
        "u_bias": {"enters": "input", "target": "u"},
    }
    assert plant["observer"]["outputs"] == ["h"]
    assert plant["observer"]["bandwidth"] == pytest.approx(1.0)  # a tenth of 1 / 0.1 s


@pytest.mark.parametrize(
    "name",
    ["u", "u1", "u_pct", "torque_cmd", "CMD_speed", "motor_volts", "v_V", "pwm", "torque_command",
     "valve_1", "pump", "throttle"],
)  # fmt: skip
def test_names_taken_for_inputs(name):
    assert set(
        tomllib.loads(plant_skeleton(runs(**{name: [0, 1], "x": [2, 3]}), "p"))["inputs"]
    ) == {name}


def test_skeleton_without_an_input_says_so():
    text = plant_skeleton(runs(h=[1, 2], w_ref=[3, 4]), "wheel")
    assert "No column could be taken for an input" in text
    plant = tomllib.loads(text)
    assert set(plant["states"]) == {"h", "w_ref"}
    assert "inputs" not in plant


def test_a_draft_asks_whether_what_stays_as_set_is_a_command():
    """Beside a column that is called like an input nothing else is taken for one: a sensor that is
    read seldom stays as read, too."""
    fan = np.repeat([600.0, 1500.0, 900.0, 1200.0], 10)
    heat = np.linspace(20, 90, 40) + np.random.default_rng(0).normal(size=40)
    text = plant_skeleton(runs(duty=range(40), fan=fan, heat=heat), "oven")
    asked = "# It stays as set between its changes: a command is an input, not a state.\n"
    assert f"{asked}[states.fan]" in text
    assert text.count(asked) == 1


def test_skeleton_of_awkward_names():
    text = plant_skeleton(
        runs(**{"a b": [1, 2], "ω": [3, 4], "c d": [5, 6], "c.d": [7, 8]}), 'it\'s "x"\n'
    )
    plant = tomllib.loads(text)
    assert plant["name"] == 'it\'s "x"\n'
    assert set(plant["states"]) == {"a_b", "ω"}
    assert '"c.d" (another column has this name too' in text


def test_skeleton_leaves_a_clock_out(log):
    plant = tomllib.loads(plant_skeleton(runs(t_ms=[0, 1], h=[1, 2]), "wheel"))
    assert set(plant["states"]) == {"h"}


def test_skeleton_needs_a_state():
    with pytest.raises(InputError, match=r"log\.csv.*state.*columns: u"):
        plant_skeleton(runs(u=[1, 2]), "wheel")
    with pytest.raises(InputError, match="columns: none"):
        plant_skeleton(runs(), "wheel")


def test_skeleton_takes_the_units_of_the_log():
    text = plant_skeleton(
        runs(u=[-0.5, 0.75], **{"wheel.h": [1, 2]}), "wheel", {"wheel.h": "N*m*s", "u": 'N"m'}
    )
    plant = tomllib.loads(text)
    assert plant["states"]["wheel_h"]["unit"] == plant["outputs"]["wheel_h"]["unit"] == "N*m*s"
    assert plant["inputs"]["u"]["unit"] == 'N"m'


def test_units_of_the_file_are_shown_and_follow_a_rename(tmp_path):
    h5py = pytest.importorskip("h5py", reason="the extra io is not installed")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, unit in (("t", "ms"), ("w", "rad/s")):
            file[name] = np.arange(5.0)
            file[name].attrs["units"] = unit
    report = inspect_runs(tmp_path / "log.h5", maps=["speed=w", "double=2*w"])
    assert {column.name: column.unit for column in report.columns} == {
        "w": "rad/s",
        "speed": "rad/s",
        "double": "",
    }
    (run,) = report.runs
    assert run.end == 0.004  # 4 ms
    assert not any("seconds" in hint for hint in report.hints)
