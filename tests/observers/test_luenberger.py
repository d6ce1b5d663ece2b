"""The observer without a fault: silent when healthy, and by how much it is off otherwise."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.observers import observe
from faultgauge.observers.luenberger import design_luenberger
from faultgauge.observers.observer import OperatingPoints
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant

DT, OMEGA, SAMPLES = 0.1, 2.0, 400
MASS = """
name = "mass"
[states.q]
derivative = "v"
[states.v]
derivative = "u"
[inputs.u]
[outputs.q]
value = "q"
[outputs.v]
value = "v"
"""


def mass():
    return GrayBoxPlant.untrained(parse_plant(MASS, "mass.toml"))


def design(measured):
    points = OperatingPoints(np.zeros((3, 2)), np.zeros((3, 1)))
    return design_luenberger(mass(), points, DT, OMEGA, measured, 1e9)


def record(f):
    """(u, y) of the double integrator from (1, -0.5) with `f` added to u; exact."""
    u = np.random.default_rng(0).uniform(-1, 1, SAMPLES)
    A, B = np.array([[1.0, DT], [0.0, 1.0]]), np.array([DT**2 / 2, DT])
    x = [np.array([1.0, -0.5])]
    for k in range(SAMPLES - 1):
        x.append(A @ x[-1] + B * (u[k] + f))
    return u, np.array(x)


def innovation(built, u, y, x0=(0.0, 0.0)):
    dt = np.full(SAMPLES, DT)
    dt[0] = 0.0
    arrays = (jnp.asarray(x0), jnp.asarray(u[:, None]), jnp.asarray(y), jnp.asarray(dt))
    return np.asarray(observe(built.observer, *arrays).innovation)


@pytest.mark.parametrize("measured", [("q",), ("q", "v")])
def test_from_a_wrong_start_the_innovation_goes_to_zero(measured):
    built = design(measured)
    r = innovation(built, *record(0.0))
    assert abs(r[0, 0]) == pytest.approx(1.0)  # it did start wrong
    # 20 s at 2 rad/s: e^-40, below the rounding of positions up to 100
    np.testing.assert_allclose(r[200:], 0, atol=1e-11)


def test_its_poles_are_those_asked_for():
    built = design(("q",))
    wanted = np.exp(-OMEGA * DT * np.array([1.0, 1.05]))  # 5 % apart
    A, C = np.array([[1.0, DT], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    L = np.asarray(built.observer.gain)[:, :1]
    found = np.sort(np.linalg.eigvals((np.eye(2) - L @ C) @ A).real)[::-1]
    np.testing.assert_allclose(found, wanted, rtol=1e-9)  # poles 1 % apart amplify rounding
    assert built.radius == pytest.approx(wanted[0], rel=1e-9)
    np.testing.assert_allclose(built.poles, [-OMEGA, -1.05 * OMEGA], rtol=1e-12)


def test_a_fault_leaves_the_offset_of_the_closed_form():
    """One output: (1 - z1)(1 - z2) r = f T^2 at rest, for poles z1, z2 of the error."""
    f = 0.3
    r = innovation(design(("q",)), *record(f))[:, 0]
    z = np.exp(-OMEGA * DT * np.array([1.0, 1.05]))
    # settled like the healthy one, on positions up to 250
    np.testing.assert_allclose(r[250:], f * DT**2 / np.prod(1 - z), rtol=0, atol=1e-10)


def test_two_outputs_leave_the_offset_of_the_steady_error():
    """Before the correction: r = C (I - A (I - L C))^-1 B f."""
    f, built = 0.3, design(("q", "v"))
    r = innovation(built, *record(f))
    A, B = np.array([[1.0, DT], [0.0, 1.0]]), np.array([DT**2 / 2, DT])
    keep = np.eye(2) - np.asarray(built.observer.gain)
    wanted = np.linalg.solve(np.eye(2) - A @ keep, B * f)
    np.testing.assert_allclose(r[250:], np.tile(wanted, (SAMPLES - 250, 1)), rtol=0, atol=1e-10)


def test_an_output_without_samples_is_predicted():
    u, y = record(0.0)
    y[100:120] = np.nan
    r = innovation(design(("q", "v")), u, y, x0=(1.0, -0.5))
    np.testing.assert_allclose(r, 0, atol=1e-11)


def test_outputs_that_do_not_determine_the_state_are_refused_by_name():
    with pytest.raises(InputError, match=r"\(v\) do not determine all of the states q, v"):
        design(("v",))
