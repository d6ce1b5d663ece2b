"""Which wheel is named, by hand and by made-up residuals; the batch of flights by single ones."""

import jax
import numpy as np
import pytest

from faultgauge.plants.gray_box import load_plant
from faultgauge.simulation.satellite.observatory import MOMENTA, SLEW, run
from faultgauge.simulation.schedules import Constant, Schedule, Sine
from faultgauge_studies.paper.claims.components import CALIBRATION, RIGHT, SIZES, section, smallest
from faultgauge_studies.paper.claims.components_flights import (
    Plan,
    flights,
    one_wheel,
    residuals,
)
from faultgauge_studies.paper.claims.components_naming import (
    NAMED,
    WATCHED,
    limits,
    named,
    statistic,
    tally,
)
from faultgauge_studies.paper.learning import beside

SECONDS, SEED = 100.0, 5
RIPPLE = Schedule("f", "state", "h", Sine(0.01, 0.3))
FAULTS = {"roll": Constant(0.1, 40.0), "pitch": Constant(-0.05, 60.0)}
# Batched and single flights differ in the order of sums: rounding of 1e-16 of 100 N*m*s, over
# 2000 steps of a loop that forgets.
ROUNDING = 1e-8


@pytest.fixture(scope="module")
def wheel():
    return load_plant("reaction_wheel")


@pytest.fixture(scope="module")
def flown(wheel):
    """A flight with two faults and one without, in one batch."""
    plans = [Plan(SLEW, MOMENTA, SEED, FAULTS), Plan(SLEW, MOMENTA, SEED + 1, {})]
    return flights(wheel, [RIPPLE], plans, SECONDS)


def test_flights_in_a_batch_are_those_flown_one_by_one(wheel, flown):
    schedules = {axis: [Schedule("d", "state", "h", f)] for axis, f in FAULTS.items()}
    alone = [
        run(wheel, SECONDS, SEED, [RIPPLE], schedules),
        run(wheel, SECONDS, SEED + 1, [RIPPLE]),
    ]
    for k, each in enumerate(alone):
        for name in ("u", "torque", "momentum", "attitude"):
            np.testing.assert_allclose(
                getattr(flown, name)[k], getattr(each, name), rtol=0, atol=ROUNDING
            )


def test_beside_the_true_wheel_what_enters_a_wheel_is_left_in_its_residual_alone(wheel, flown):
    """r = f(t) + d in the wheel that has it, whatever the others do."""
    r, t = residuals(wheel, flown), flown.t[0]
    ripple = 0.01 * np.sin(0.3 * t)
    roll, pitch = ripple + 0.1 * (t >= 40.0), ripple - 0.05 * (t >= 60.0)
    expected = [roll, pitch, ripple]
    np.testing.assert_allclose(r[0].T, expected, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(r[1].T, [ripple] * 3, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(("axis", "k"), [("roll", 0), ("pitch", 1), ("yaw", 2)])
def test_the_wheel_of_any_axis_can_stand_where_the_pitch_wheel_is_looked_at(wheel, flown, axis, k):
    single = jax.tree.map(lambda a: a[0], flown)
    found = beside(wheel, one_wheel(single, axis), "measured").y[:, 0]
    r = residuals(wheel, flown)[0, :, k]
    np.testing.assert_allclose(single.torque[:, k] - found, r, rtol=0, atol=ROUNDING)


def test_the_statistic_is_the_largest_mean_over_20_seconds():
    """80 samples of 0.25 s: 2 N*m for 40 of them is a mean of 1, -3 for 20 one of 0.75."""
    r = np.zeros((1, 1000, 3))
    r[0, 200:240, 0] = 2.0
    r[0, 500:520, 1] = -3.0
    r[0, 600:, 2] = 0.5
    np.testing.assert_allclose(statistic(r), [[1.0, 0.75, 0.5]], atol=1e-12)  # sums of 1000 terms


def test_limits_are_the_largest_of_the_healthy_and_names_follow_from_them():
    healthy = np.array([[0.3, 0.1, 9.0], [0.2, 0.4, 9.0]])  # roll, pitch, yaw
    limit = limits(healthy)
    assert limit == {"pitch": 0.4, "roll": 0.3}
    found = np.array([[0.3, 0.4, 9.0], [0.2, 0.5, 0.0], [0.31, 0.4, 0.0], [1.0, 1.0, 0.0]])
    assert named(found, limit) == ["none", "pitch", "roll", "both"]


def test_a_limit_errs_once_in_as_many_flights_as_were_seen_and_one():
    """19 calibrate, one is judged: 1/20 each, by symmetry; 20,000 draws have an sd of 0.0015."""
    draws = np.random.default_rng(0).standard_normal((20_000, CALIBRATION + 1))
    share = np.mean(draws[:, -1] > draws[:, :-1].max(axis=1))
    assert abs(share - 1 / (CALIBRATION + 1)) < 4 * 0.0015
    assert pytest.approx(1 - 2 / 20) == RIGHT


def test_shares_of_names_by_hand():
    cells = [("none", 0.0)] * 4 + [("pitch", 0.1)] * 2 + [("both", 0.1)] * 2
    names = ["none", "none", "none", "roll", "pitch", "both", "both", "roll"]
    found = tally(cells, names)
    assert found["named"]["0"]["none"] == {"none": 0.75, "pitch": 0.0, "roll": 0.25, "both": 0.0}
    assert found["named"]["0.1"]["both"] == {"none": 0.0, "pitch": 0.0, "roll": 0.5, "both": 0.5}
    assert found["judged"]["0"] == {"right": 0.75, "sound_named": 0.25, "missed": 0.0}
    # of 4 flights 2 are right; of 2 with a sound wheel one names it; of 4 with a fault one misses
    assert found["judged"]["0.1"] == {"right": 0.5, "sound_named": 0.5, "missed": 0.25}


@pytest.mark.parametrize(
    ("right", "least"),
    [
        ((0.0, 0.5, 1.0, 1.0, 1.0), SIZES[2]),
        ((0.0, 1.0, 0.5, 1.0, 1.0), SIZES[3]),  # a smaller size that came out well by luck
        ((1.0, 1.0, 1.0, 1.0, 1.0), SIZES[0]),
        ((1.0, 1.0, 1.0, 1.0, 0.5), np.inf),
    ],
)
def test_the_smallest_fault_told_is_where_all_larger_ones_are(right, least):
    assert smallest(made_up(right)) == least


def over(value):
    """One number as it comes over seeds that agree."""
    return {"median": value, "min": value, "max": value}


def made_up(right):
    """Results in which the names at each size are right this often."""
    shares = {name: over(0.25) for name in NAMED}
    judged = {
        f"{s:g}": {"right": over(x), "sound_named": over(0.0), "missed": over(0.0)}
        for s, x in zip(SIZES, right, strict=True)
    }
    channels = ("attitude", "torque", "residual_free", "residual")
    talk = {name: {n: over(1e-5) for n in ("pitch", "roll", "ratio")} for name in channels}
    limit = {"pitch": over(1e-3), "roll": over(1e-3)}
    return {
        "judged": judged,
        "limit": limit,
        "named": {s: dict.fromkeys(NAMED[1:], shares) for s in judged},
        "crosstalk": talk,
    }


@pytest.mark.parametrize(
    ("right", "verdict"),
    [
        ((1.0,) * 5, "holds for every size tried, from 0.0005"),
        ((0.0, 0.5, 0.95, 1.0, 1.0), "holds only for faults of 0.002"),
        ((0.0,) * 5, "does not hold"),
    ],
)
def test_the_verdict_follows_the_numbers(right, verdict):
    t = 0.25 * np.arange(8)
    names = [f"{a}_r_{truth}" for a in WATCHED for truth in NAMED]
    names += [f"{a}_{key}" for a in WATCHED for key in ("torque", "residual")]
    traces = {"components": {"t": t, **{name: np.sin(t) for name in names}}}
    found = section({"components": made_up(right)}, traces)
    assert found.paragraphs[1].startswith(f"It {verdict}")
    assert len(found.tables) == 2
    assert len(found.figures) == 3
