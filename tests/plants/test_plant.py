"""dx = F(x, u), y = h(dx, x, u) with faults, against values worked out by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import clip_state, respond
from faultgauge.plants.plant_file import parse_plant


def plant(faults=(), derivatives=("-2*x + u", "x*w")):
    """States x, v; inputs u in [-1, 3], w; outputs p = x + u, q = d(x)."""
    first, second = derivatives
    text = f"""
name = "p"
[states.x]
derivative = "{first}"
max = 5
[states.v]
derivative = "{second}"
min = -1
[inputs.u]
min = -1
max = 3
[inputs.w]
[outputs.p]
value = "x + u"
[outputs.q]
value = "d(x)"
[networks.NN]
"""
    for number, (enters, target) in enumerate(faults):
        text += f'[faults.f{number}]\nenters = "{enters}"\ntarget = "{target}"\n'
    return GrayBoxPlant.untrained(parse_plant(text))


def answer(u, f=None, faults=(), **kwargs):
    """(dx, y) at x = 1, v = 10 and w = 2."""
    sizes = None if f is None else jnp.array(f, float)
    model = plant(faults, **kwargs)
    dx, y = respond(model, jnp.array([1.0, 10.0]), jnp.array([u, 2.0]), sizes)
    return np.asarray(dx).tolist(), np.asarray(y).tolist()


# All values below are sums of small halves: exact in binary, so equality is meant.


def test_a_healthy_plant():
    assert answer(0.5) == ([-1.5, 2.0], [1.5, -1.5])
    assert answer(0.5, [0.0], [("state", "x")]) == answer(0.5)


def test_the_actuator_clips_the_command():
    assert answer(7.0) == answer(3.0) == ([1.0, 2.0], [4.0, 1.0])
    assert answer(-7.0) == answer(-1.0)


@pytest.mark.parametrize(
    ("enters", "target", "u", "size", "dx", "y"),
    [
        ("state", "x", 0.5, 4.0, [2.5, 2.0], [1.5, 2.5]),  # d(x) in an output feels it
        ("state", "v", 0.5, 4.0, [-1.5, 6.0], [1.5, -1.5]),
        ("output", "p", 0.5, 4.0, [-1.5, 2.0], [5.5, -1.5]),
        ("output", "q", 0.5, 4.0, [-1.5, 2.0], [1.5, 2.5]),
        ("input", "u", 0.5, 2.0, [0.5, 2.0], [3.5, 0.5]),
        ("input", "u", 0.5, 9.0, [1.0, 2.0], [4.0, 1.0]),  # 9.5 is beyond the limit of 3
        ("input", "u", 7.0, -6.5, [-1.5, 2.0], [1.5, -1.5]),  # 7 - 6.5, not 3 - 6.5
        ("input", "w", 0.5, 2.0, [-1.5, 4.0], [1.5, -1.5]),
        ("gain", "u", 2.0, 0.25, [-0.5, 2.0], [2.5, -0.5]),  # 0.75 * 2
        ("gain", "u", 8.0, 0.75, [0.0, 2.0], [3.0, 0.0]),  # 0.25 * 8, not 0.25 * 3
        ("gain", "u", 8.0, 1.0, [-2.0, 2.0], [1.0, -2.0]),
    ],
)
def test_a_fault_enters_where_its_file_says(enters, target, u, size, dx, y):
    assert answer(u, [size], [(enters, target)]) == (dx, y)


def test_faults_of_one_input_combine_in_the_stated_order_however_they_are_declared():
    both = [("gain", "u"), ("input", "u")]
    expected = ([-0.5, 2.0], [2.5, -0.5])  # u = 0.5 * 2 + 0.5
    assert answer(2.0, [0.5, 0.5], both) == expected
    assert answer(2.0, [0.5, 0.5], both[::-1]) == expected


def test_faults_of_one_place_add_up():
    assert answer(0.5, [1.0, 3.0], [("state", "x")] * 2) == ([2.5, 2.0], [1.5, 2.5])


def test_a_derivative_may_read_another_that_is_declared_later():
    dx, _ = answer(0.5, derivatives=("2*d(v) + u", "x*w"))
    assert dx == [4.5, 2.0]


def test_a_derivative_may_be_a_constant_and_a_network_may_read_one():
    dx, _ = answer(0.5, derivatives=("3", "d(x) + NN(2, d(x)*0, x)"))
    assert dx == [3.0, 3.0]  # an untrained network is zero


def test_states_are_kept_inside_their_limits():
    for x, expected in [([7.0, -3.0], [5.0, -1.0]), ([-9.0, 9.0], [-9.0, 9.0])]:
        assert clip_state(plant(), jnp.array(x)).tolist() == expected
