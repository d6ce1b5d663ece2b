"""`[accommodation]` in scenario files: what it does to a run, and what is said of mistakes."""

import numpy as np
import pytest

from faultgauge.accommodation.simulate import simulate
from faultgauge.errors import InputError
from faultgauge.simulation.scenario import parse_scenario

LEAK, START = -0.002, 2000.0  # m/s, s
SCENARIO = f"""name = "leaking tank"
plant = "tank"
seconds = 4000
step = 5
[initial]
level = 1.0
[inputs.u]
offset = 1.0
[inputs.u.feedback.level]
kp = 4.0
[references.level]
source = "constant"
size = 1.0
[noise]
level = 0.001
[faults.leak]
profile = "constant"
size = {LEAK}
start = {START}
end = 3000
[accommodation]
policy = "estimate"
bandwidth = 0.05
[accommodation.alarms]
leak = 0.0005
[accommodation.authority]
u = 0.5
[accommodation.slew]
u = 0.01
"""


def run(text):
    return simulate(parse_scenario(text))


@pytest.fixture(scope="module")
def accommodated():
    return run(SCENARIO)


@pytest.fixture(scope="module")
def estimated():
    return run(SCENARIO.replace('"estimate"', '"none"'))


def test_the_level_is_back_while_the_tank_leaks(accommodated, estimated):
    late = (accommodated.t > 2600) & (accommodated.t < 3000)
    # without: 0.01 (1 - 4 e) - 0.01 sqrt(1 + e) = -leak gives e = -0.002/0.045 by first order
    alone = estimated.columns["level"][late].mean() - 1.0
    assert alone == pytest.approx(LEAK / 0.045, rel=0.03)
    # with: the estimate's own error, a twentieth of the leak
    assert abs(accommodated.columns["level"][late].mean() - 1.0) < 0.05 * abs(alone)


def test_the_compensation_is_the_leak_in_volts(accommodated):
    late = (accommodated.t > 2600) & (accommodated.t < 3000)
    assert accommodated.columns["added_u"][late].mean() == pytest.approx(-LEAK / 0.01, rel=0.02)
    assert np.all(accommodated.columns["acted_leak"][late] == 1.0)


def test_nothing_is_added_before_the_leak_nor_long_after(accommodated):
    t, added = accommodated.t, accommodated.columns["added_u"]
    # V: the difference of two commands near 1 V, to rounding
    assert np.abs(added[(t < START) | (t > 3500)]).max() < 1e-14
    assert np.all(accommodated.columns["acted_leak"][(t < START) | (t > 3500)] == 0.0)


def test_it_comes_and_goes_no_faster_than_its_slew(accommodated):
    steps = np.abs(np.diff(accommodated.columns["added_u"]))
    assert steps.max() <= 0.01 * 5 * (1 + 1e-9)


def test_authority_bounds_it():
    weak = run(SCENARIO.replace("u = 0.5", "u = 0.1"))
    assert np.abs(weak.columns["added_u"]).max() == pytest.approx(0.1)


def test_policy_none_leaves_the_log_as_it_was(estimated):
    without = run(SCENARIO[: SCENARIO.index("[accommodation]")])
    for name in ("u", "level", "true_leak"):
        assert np.array_equal(without.columns[name], estimated.columns[name])
    assert not any(name.startswith("fhat") for name in without.columns)


def test_the_same_file_gives_the_same_log(accommodated):
    again = run(SCENARIO)
    for name, column in accommodated.columns.items():
        assert np.array_equal(column, again.columns[name]), name


def test_adrc_needs_no_alarm_and_holds_the_level_too():
    adrc = run(
        SCENARIO.replace('"estimate"', '"adrc"\ndesired = "tank"').replace(
            "leak = 0.0005", "leak = 9"
        )
    )
    late = (adrc.t > 2600) & (adrc.t < 3000)
    assert abs(adrc.columns["level"][late].mean() - 1.0) < 0.003


MISTAKES = {
    "policy": ('"estimate"', '"cure"', "policy"),
    "key": ("bandwidth", "bandwith", "bandwith"),
    "no fault": ("leak = 0.0005", "lek = 0.0005", "lek"),
    "no alarms": ("[accommodation.alarms]\nleak = 0.0005", "", "alarms"),
    "negative": ("leak = 0.0005", "leak = -1", "greater than 0"),
    "no input": ("u = 0.5", "v = 0.5", "v"),
    "no bandwidth": ("bandwidth = 0.05\n", "", "bandwidth"),
    "no authority": ("[accommodation.authority]\nu = 0.5", "", "authority"),
    "no model": ('"estimate"', '"estimate"\nmodel = "x.fgm"', "x.fgm"),
    "another plant": ('"estimate"', '"estimate"\nmodel = "four_tanks"', "same order"),
    "no desired": ('"estimate"', '"adrc"', "desired"),
    "useless desired": ('"estimate"', '"estimate"\ndesired = "tank"', "desired"),
    "adrc with a model": (
        '"estimate"',
        '"adrc"\ndesired = "tank"\nmodel = "tank"',
        "remove `model`",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_are_answered_by_their_key(name):
    old, new, words = MISTAKES[name]
    assert old in SCENARIO
    with pytest.raises(InputError) as caught:
        run(SCENARIO.replace(old, new))
    assert words in str(caught.value)
    assert "[accommodation]" in str(caught.value)
