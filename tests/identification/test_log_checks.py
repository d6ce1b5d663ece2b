"""What `fit` says about logs: each warning on a log that earns it, none on one that does not."""

import numpy as np

from faultgauge.identification.log_checks import log_warnings, other_units
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

PLANT = """
name = "tank"
[states.level]
derivative = "u"
unit = "m"
min = 0
max = 2
[states.heat]
derivative = "u"
initial = 300
[inputs.u]
unit = "V"
min = -5
max = 5
[outputs.level]
value = "level"
[outputs.heat]
value = "heat"
"""
COUNT = 400


def log(level=None, heat=None, u=None):
    random = np.random.default_rng(0)
    columns = {
        "u": random.uniform(-4, 4, COUNT),
        "level": random.uniform(0.2, 1.8, COUNT),
        "heat": random.uniform(290, 310, COUNT),
    }
    given = {"level": level, "heat": heat, "u": u}
    for name, change in given.items():
        if change is not None:
            columns[name] = change(columns[name])
    return Run("first", "tank.csv", 0.1 * np.arange(COUNT), columns)


def warnings(*runs):
    return log_warnings(parse_plant(PLANT, "tank.toml").signals, list(runs))


def test_a_good_log_earns_no_warning():
    assert warnings(log(), log()) == []


def test_a_stuck_sensor():
    def stick(level):
        return np.where((np.arange(COUNT) >= 100) & (np.arange(COUNT) < 200), level[100], level)

    (text,) = warnings(log(level=stick))
    value = log().columns["level"][100]
    assert text.startswith(f"output 'level' is stuck at {value:.6g} from 10 s to 19.9 s of run ")
    assert "--where" in text


def test_empty_cells():
    def holes(share):
        return lambda level: np.where(np.arange(COUNT) < share * COUNT, np.nan, level)

    (text,) = warnings(log(level=holes(0.12)))
    assert "output 'level' is empty in 12 % of the rows of run 'first'" in text
    assert warnings(log(level=holes(0.04))) == []


def test_units_that_are_off_by_a_thousand():
    (text,) = warnings(log(level=lambda level: 1000 * level))
    assert "state 'level' is 8e+02 times its range from 0 to 2" in text
    assert "in m?" in text
    (text,) = warnings(log(heat=lambda heat: heat / 1000))
    assert "state 'heat' is 0.001 times its initial value 300" in text
    (text,) = warnings(log(u=lambda u: u / 1000))
    assert "input 'u' is 0.0008 times its range from -5 to 5" in text


def test_an_input_that_hardly_moves():
    (text,) = warnings(log(u=lambda u: u / 20))
    # 8 V / 20 of 10 V, a little less as 400 draws do not reach their ends
    assert text.startswith("input 'u' moves through 4.0 % of its range from -5 to 5 only")


def levels(name, scale, least=0.0, units=None):
    """400 samples of `least` to `scale`, and an input that is alike in all runs."""
    random = np.random.default_rng(0)
    columns = {"q": random.uniform(least, scale, COUNT), "u": random.uniform(-1, 1, COUNT)}
    return Run(name, f"{name}.csv", 0.1 * np.arange(COUNT), columns, units=units or {})


def test_a_run_in_another_unit_than_the_others_is_named():
    (text,) = other_units([levels("a", 2.0), levels("b", 2000.0), levels("c", 2.1)])
    # 1000 times as far as the narrower of the other two
    assert text.startswith("column 'q' spreads 1e+03 times as far in run 'b' as in run 'a'")
    assert "--map serves all logs" in text
    near = log()
    wide = Run("wide", "tank.csv", near.t, near.columns | {"more": 1e4 * near.columns["u"]})
    narrow = Run("narrow", "tank.csv", near.t, near.columns | {"more": near.columns["u"]})
    (found,) = warnings(wide, narrow)  # `fit` asks, over its logs and those for validation
    assert found.startswith("column 'more' spreads 1e+04 times as far in run 'wide'")


def test_runs_that_only_do_less_are_not_in_another_unit():
    assert other_units([levels("a", 2.0), levels("b", 500.0)]) == []  # 250 times
    assert other_units([levels("at rest", 2.0, 1.9999), levels("b", 2.0)]) == []
    still = levels("still", 2.0)
    still.columns["q"][:] = 0.0
    assert other_units([still, levels("b", 2.0)]) == []
    still.columns["q"][:] = np.nan
    assert other_units([still, levels("b", 2.0)]) == []


def test_units_that_the_logs_give_are_left_to_the_reading():
    known = [levels("a", 2.0, units={"q": "m"}), levels("b", 2000.0, units={"q": "m"})]
    assert other_units(known) == []
    assert len(other_units([known[0], levels("b", 2000.0)])) == 1


def test_an_input_with_empty_cells():
    def sparse(u):
        return np.where(np.arange(COUNT) % 10 == 3, np.nan, u)

    (text,) = warnings(log(u=sparse))
    assert "input 'u' is empty in 10 % of the rows of run 'first', and each empty cell cuts" in text
    (text,) = warnings(log(), log(u=sparse))  # once, of the run that has them
    assert warnings(log(u=lambda u: np.where(np.arange(COUNT) == 3, np.nan, u))) == []
