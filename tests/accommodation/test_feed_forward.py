"""Compensation against arithmetic by hand and steady states found by iteration."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import fsolve

from faultgauge.accommodation.feed_forward import FeedForward, Limits, limited, outcome
from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.gray_box import GrayBoxPlant, load_plant
from faultgauge.plants.plant import respond
from faultgauge.plants.plant_file import parse_plant

WHEEL = """name = "wheel"
[states.h]
derivative = "2*u - 0.1*h"
[inputs.u]
min = -1
max = 1
[outputs.h]
value = "h"
[faults.friction]
enters = "state"
target = "h"
[faults.loss]
enters = "gain"
target = "u"
"""
ONE = jnp.ones((1, 1))


def wheel():
    return GrayBoxPlant.untrained(parse_plant(WHEEL))


def command(desired, u, f, floor=0.2):
    feed = FeedForward(wheel(), desired, ONE, floor)
    return float(feed.command(jnp.array([3.0]), jnp.array([u]), jnp.array(f))[0])


def test_an_additive_fault_is_taken_off_in_units_of_the_input():
    # d(h) = 2 u - 0.1 h + f: c = -f/2
    assert command(wheel(), 0.3, [0.5, 0.0]) == pytest.approx(-0.25)


def test_a_loss_is_divided_out():
    # (1 - 0.4)(u + c) = u
    assert command(wheel(), 0.3, [0.0, 0.4]) == pytest.approx(0.3 / 0.6 - 0.3)


def test_both_at_once():
    # 2 * 0.6 (u + c) + f = 2 u
    assert command(wheel(), 0.3, [0.5, 0.4]) == pytest.approx((0.6 - 0.5) / 1.2 - 0.3)


def test_a_large_loss_counts_as_its_floor():
    assert command(wheel(), 0.1, [0.0, 0.99]) == pytest.approx(0.1 / 0.2 - 0.1)
    assert np.isfinite(command(wheel(), 0.1, [0.0, 1.0]))


def test_what_differs_from_the_desired_plant_is_fed_forward():
    text = WHEEL.replace("2*u - 0.1*h", "2*u")
    ideal = GrayBoxPlant.untrained(parse_plant(text))
    assert command(ideal, 0.3, [0.0, 0.0]) == pytest.approx(0.1 * 3.0 / 2)


def test_at_its_limit_the_command_is_taken_for_one_just_inside():
    # a clipped command has half a slope at the limit; twice the compensation would be wrong
    assert command(wheel(), 1.0, [0.5, 0.0]) == pytest.approx(-0.25, rel=1e-9)


def test_compensation_is_bounded_in_size_and_slope():
    limits = Limits(authority=jnp.array([0.4]), slew=jnp.array([0.1]))
    c, short = limited(jnp.array([5.0]), jnp.array([0.0]), limits, jnp.asarray(0.5))
    assert (float(c[0]), bool(short[0])) == (pytest.approx(0.05), True)
    for _ in range(20):
        c, _ = limited(jnp.array([5.0]), c, limits, jnp.asarray(0.5))
    assert float(c[0]) == pytest.approx(0.4)
    c, short = limited(jnp.array([0.0]), c, limits, jnp.asarray(0.5))
    assert (float(c[0]), bool(short[0])) == (pytest.approx(0.35), False)


def test_lower_levels_end_up_where_they_were():
    """Four tanks with a leak and a weak pump: the steady state under u + c, found by SciPy, has
    the same lower levels as the healthy one. To first order: 1 % of a level."""
    plant = load_plant("four_tanks")
    u = np.array([3.0, 3.0])
    start = np.array([12.4, 12.7, 1.8, 1.4])

    def at_rest(u, f):
        def rates(x):
            return np.asarray(respond(plant, jnp.asarray(x), jnp.asarray(u), jnp.asarray(f))[0])

        return fsolve(rates, start)

    none, f = np.zeros(4), np.array([0.2, 0.0, 0.0, -0.03])
    x = at_rest(u, none)
    points = OperatingPoints(x[None], u[None])
    feed = FeedForward(plant, plant, outcome(plant, points, (0, 1), 1e-6), 0.2)
    c = np.asarray(feed.command(jnp.asarray(x), jnp.asarray(u), jnp.asarray(f)))
    faulty, cured = at_rest(u, f), at_rest(u + c, f)
    assert np.abs(faulty - x)[:2].max() > 1.0
    assert cured[:2] == pytest.approx(x[:2], rel=0.01)


def test_the_outcome_of_a_push_is_the_change_of_the_steady_state():
    plant = load_plant("four_tanks")
    x, u = np.array([12.4, 12.7, 1.8, 1.4]), np.array([3.0, 3.0])
    found = np.asarray(outcome(plant, OperatingPoints(x[None], u[None]), (0, 1), 1e-9))
    # tank 1 empties at T1 = A1/a1 sqrt(2 h1/g): Johansson's Table gives 62 s; tank 3 passes all on
    T1 = 28 / 0.071 * np.sqrt(2 * 12.4 / 981)
    assert found[0, 0] == pytest.approx(T1, rel=1e-6)
    assert found[0, 2] == pytest.approx(T1, rel=1e-6)  # A3 = A1
    assert found[0, 1] == pytest.approx(0.0, abs=1e-6)


def test_the_outcome_stays_that_of_the_operating_point():
    # leaves, not structure: two designs share one compiled program
    feed = FeedForward(wheel(), wheel(), ONE, 0.2)
    other = replace(feed, outcome=2 * ONE)
    x, u, f = jnp.zeros(1), jnp.array([0.1]), jnp.array([0.2, 0.0])
    step = eqx.filter_jit(lambda feed: feed.command(x, u, f))
    assert float(step(feed)[0]) == pytest.approx(float(step(other)[0]))
