"""What the observer in the loop is told of a command."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.accommodation.estimator import JointFaults, SingleFault
from faultgauge.accommodation.feed_forward import Limits
from faultgauge.accommodation.policy import Accommodation
from faultgauge.observers.eso import design_eso
from faultgauge.observers.joint import design_joint
from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant

WHEEL = """name = "wheel"
[states.h]
derivative = "2*u - 0.1*h"
[inputs.u]
min = -1
max = 1
[outputs.h]
value = "h"
[faults.drag]
enters = "input"
target = "u"
"""
STEP, DRAG = 0.1, -0.3


@pytest.mark.parametrize("joint", [False, True])
def test_a_command_beyond_its_limit_is_estimated_as_what_the_actuator_does(joint):
    """5 is wanted and 1 is done, of which drag takes 0.3: h' = 1.4 - 0.1 h in closed form. Told of
    5, the observer would have to find a drag of -4.3."""
    wheel = GrayBoxPlant.untrained(parse_plant(WHEEL))
    points = OperatingPoints(np.zeros((3, 1)), np.zeros((3, 1)))
    if joint:
        estimator = JointFaults(design_joint(wheel, points, STEP, 2.0, np.array([1e-3]), 1e9))
    else:
        found = design_eso(wheel, "drag", points, STEP, 2.0, ("h",), 1e9)
        estimator = SingleFault(found.observer)
    limits = Limits(authority=jnp.ones(1), slew=jnp.ones(1))
    policy = Accommodation(estimator, None, None, limits)
    step = eqx.filter_jit(policy.step)
    state = policy.init(jnp.zeros(1), jnp.ones(1))
    rest = 2 * (1 + DRAG) / 0.1
    for k in range(1, 60):
        h = rest * (1 - np.exp(-0.1 * STEP * k))
        state, u, info = step(state, jnp.array([5.0]), jnp.array([h]), jnp.asarray(STEP))
    assert (float(u[0]), bool(info.short[0])) == (5.0, True)
    # 6 s at 2 rad/s leave e^-8 of the way to go
    assert float(info.f[0]) == pytest.approx(DRAG, abs=2e-3)
