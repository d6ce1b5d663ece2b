"""What the estimator in the loop is told of a command."""

from functools import cache

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from calibrations import for_bank
from faultgauge.accommodation.estimator import ByPosterior, TotalDisturbance
from faultgauge.accommodation.feed_forward import Limits
from faultgauge.accommodation.policy import Accommodation
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.watch import Watch
from faultgauge.observers.eso import design_eso
from faultgauge.observers.observer import OperatingPoints
from models import as_stated

WHEEL = """name = "wheel"
[states.h]
derivative = "2*u - 0.1*h"
[inputs.u]
min = -1
max = 1
[outputs.h]
value = "h"
[faults.drag]
enters = "state"
target = "h"
"""
STEP, DRAG = 0.1, -0.6


def model():
    points = np.random.default_rng(0).uniform([-20, -1], [20, 1], (80, 2))
    levels = [1e-3], [1e-3], [], [1e-3], [50.0], [1e-3], [5.0], [], []
    noise = Noise(*(np.array(each) for each in levels))
    return for_bank(as_stated(WHEEL, points, [("h", 0)], ["h"]), noise)


def by_posterior():
    return ByPosterior(Watch(model(), ("u", "h"), STEP))


def by_observer():
    points = OperatingPoints(np.zeros((3, 1)), np.zeros((3, 1)))
    return TotalDisturbance(
        design_eso(model().plant, "drag", points, STEP, 2.0, ("h",), 1e9).observer
    )


@cache
def of(estimator):
    """The policy of it that compensates nothing, and its step: compiled once for all tests."""
    limits = Limits(authority=jnp.ones(1), slew=jnp.ones(1))
    policy = Accommodation(estimator(), None, limits)
    return policy, eqx.filter_jit(policy.step)


@pytest.mark.parametrize("estimator", [by_posterior, by_observer])
def test_a_command_beyond_its_limit_is_estimated_as_what_the_actuator_does(estimator):
    """5 is wanted and 1 is done, and from 6 s on there is a drag of 0.6: h' = 2 - 0.1 h, then
    1.4 - 0.1 h, in closed form. Told of 5, the estimator would have to find a drag of -8.6."""
    policy, step = of(estimator)
    state = policy.init(jnp.zeros(1), jnp.ones(1))
    h = 0.0
    for k in range(120):
        rest = (2 + DRAG * (k >= 60)) / 0.1
        h = rest + (h - rest) * np.exp(-0.1 * STEP)
        state, u, info = step(state, jnp.array([5.0]), jnp.array([h]), jnp.asarray(STEP))
    assert (float(u[0]), bool(info.short[0])) == (5.0, True)
    # 6 s at 2 rad/s leave e^-8 of the way to go
    assert float(info.f[0]) == pytest.approx(DRAG, abs=4e-3)
    assert bool(info.engaged[0])


def test_while_nothing_is_sampled_the_last_state_is_kept():
    policy, step = of(by_posterior)
    state, still = policy.init(jnp.array([3.0]), jnp.zeros(1)), jnp.zeros(1)
    state, _, info = step(state, still, jnp.array([jnp.nan]), jnp.asarray(STEP))
    assert float(state.estimator.x[0]) == 3.0
    state, _, info = step(state, still, jnp.array([5.0]), jnp.asarray(STEP))
    assert float(state.estimator.x[0]) == pytest.approx(5.0, abs=0.01)
    assert not bool(info.engaged[0])
