"""A rate that another rate reads, as a trolley's acceleration moves its load: what acts on the one
moves the other, by hand and by the same plant written without `d()`."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.plants.disturbed import Disturbed, Error
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import respond
from faultgauge.plants.plant_file import parse_plant
from faultgauge.plants.reached import Held, Strayed

CRANE = """
name = "crane"
[states.v]
derivative = "2*u - v"
[states.q]
derivative = "-(d(v) + 9.81*a)/1.5"
[states.a]
derivative = "q"
exact = true
[inputs.u]
[outputs.v]
value = "v"
[outputs.felt]
value = "d(q)"
[faults.push]
enters = "state"
target = "v"
[faults.wind]
enters = "state"
target = "q"
"""
X, U = np.array([0.4, 0.1, -0.05]), np.array([0.8])
V = 2 * 0.8 - 0.4


def crane(text=CRANE):
    return GrayBoxPlant.untrained(parse_plant(text))


def rates(push, wind):
    return np.array([V + push, -(V + push + 9.81 * -0.05) / 1.5 + wind, 0.1])


@pytest.mark.parametrize(("push", "wind"), [(0.0, 0.0), (0.7, 0.0), (-0.3, 0.2)])
def test_a_push_on_the_trolley_swings_the_load_and_a_wind_on_the_load_moves_no_trolley(push, wind):
    dx, y = respond(crane(), jnp.asarray(X), jnp.asarray(U), jnp.array([push, wind]))
    np.testing.assert_allclose(dx, rates(push, wind), rtol=1e-12)
    np.testing.assert_allclose(y, [0.4, rates(push, wind)[1]], rtol=1e-12)


def test_a_push_is_what_a_command_that_moves_the_trolley_as_much_is():
    plant, none = crane(), jnp.zeros(2)
    by_push = respond(plant, jnp.asarray(X), jnp.asarray(U), jnp.array([0.5, 0.0]))
    by_command = respond(plant, jnp.asarray(X), jnp.asarray(U + 0.25), none)
    for one, other in zip(by_push, by_command, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_so_does_what_the_model_errs_by_in_the_trolleys_equation():
    """d of 0.3 on v and of -0.2 on q, fading with 2 and 5 s: in the derivative, and in what the
    filter adds to the rates over a step."""
    plant = crane()
    none = jnp.zeros(0)
    error = Error(jnp.array([2.0, 5.0]), none, none)
    disturbed = Disturbed.of(plant, (0, 1), (), error, (), none, jnp.zeros((0, 0)))
    x = jnp.concatenate([jnp.asarray(X), jnp.array([0.3, -0.2])])
    assert disturbed.chained
    dx = disturbed.derivative(x, jnp.asarray(U))
    np.testing.assert_allclose(dx[:3], rates(0.3, -0.2), rtol=1e-12)
    np.testing.assert_allclose(dx[3:], [-0.15, 0.04], rtol=1e-12)
    t = jnp.array([0.0, 1.0])
    force = disturbed.forces(x, jnp.asarray(U), jnp.zeros(2), t)
    slow = [0.3 * np.exp(-0.5), -0.2 * np.exp(-0.2)]
    np.testing.assert_allclose(force[0], rates(0.3, -0.2) - rates(0, 0), atol=1e-12)
    np.testing.assert_allclose(force[1], rates(*slow) - rates(0, 0), atol=1e-12)


def test_what_holds_a_trolley_near_rest_holds_its_load_back_too():
    held = Held(crane().signals, crane(), jnp.array([-0.6]), np.array([0.02]), (0,))
    force = -0.6 / (1 + (0.4 / 0.02) ** 2)
    np.testing.assert_allclose(
        held.derivative(jnp.asarray(X), jnp.asarray(U)), rates(force, 0.0), rtol=1e-12
    )
    strayed = Strayed(crane().signals, crane(), np.array([0.25]))
    pushed = strayed.moved(jnp.asarray(X), jnp.asarray(U), np.array([0.1, 0.0, 0.0]))
    np.testing.assert_allclose(pushed, rates(0.6, 0.0), rtol=1e-12)


def test_a_plant_whose_rates_read_none_is_not_chained():
    assert crane().chained
    assert not crane(CRANE.replace("d(v)", "2*u - v")).chained
