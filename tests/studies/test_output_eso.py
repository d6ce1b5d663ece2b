"""Eq (11) closed on an output, against its closed form and SciPy's integrator."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from faultgauge.errors import InputError
from faultgauge.observers.observer import observe
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge_studies.paper.output_eso import design_output_eso, time_constant

DT, SAMPLES, SIZE = 0.01, 2000, 0.1
BETA_2 = 0.04


def wheel(derivative="u", value="d(h)", enters='"state", target = "h"'):
    text = f"""
name = "wheel"
states.h.derivative = "{derivative}"
inputs.u.unit = "N*m"
outputs.T.value = "{value}"
faults.friction = {{ enters = {enters} }}
"""
    return GrayBoxPlant.untrained(parse_plant(text))


def estimates(plant, beta_1, torque, u=0.0, start=0.0, **gains):
    observer = design_output_eso(plant, "friction", "T", beta_1, BETA_2, 1, **gains)
    found = observe(
        observer,
        jnp.full(1, start),
        jnp.full((SAMPLES, 1), u),
        jnp.asarray(np.broadcast_to(torque, (SAMPLES, 1)).astype(float)),
        jnp.full(SAMPLES, DT),
    )
    return np.asarray(found.f), np.asarray(found.x[:, 0])


@pytest.mark.parametrize(("c", "beta_1"), [(1, 0.4), (1, 2.0), (-1, 1.6), (-1, 0.5)])
def test_the_fault_is_a_first_order_lag(c, beta_1):
    f, x = estimates(wheel(value=f"{c}*d(h)"), beta_1, c * SIZE, start=1.0)
    tau = time_constant(beta_1, BETA_2, float(c))
    t = DT * np.arange(1, SAMPLES + 1)
    # Euler's first step: the rate is off by dt/(2 tau) of itself, over t/tau time constants
    np.testing.assert_allclose(
        f - SIZE, -SIZE * np.exp(-t / tau), rtol=1.1 * DT * t[-1] / (2 * tau**2)
    )
    assert (abs(f[-1] - SIZE) > SIZE) == (c == -1 and beta_1 < 1)  # diverges only there
    # the state's error is what the lag leaves: d(error) = (f - SIZE)/(1 + c beta_1), nothing back
    left = 1.0 + np.sum(f - SIZE) * DT / (1 + c * beta_1)
    assert x[-1] - SIZE * t[-1] == pytest.approx(left, abs=abs(f[-1] - SIZE) * DT * 2 + 2e-3)


@pytest.mark.parametrize("c", [1.0, -1.0])
def test_the_errors_matrix_has_determinant_zero(c):
    beta_1 = 0.3
    a = 1 / (1 + c * beta_1)
    matrix = np.array([[0.0, a], [0.0, -c * BETA_2 * a]])
    assert np.linalg.det(matrix) == 0.0
    slow, fast = sorted(np.linalg.eigvals(matrix), key=abs)
    assert slow == 0.0
    assert fast == pytest.approx(-1 / time_constant(beta_1, BETA_2, c), rel=1e-12)


def test_a_nonlinear_wheel_against_scipy():
    plant = wheel("u - 0.05*tanh(h)", "d(h) + 0.02*d(h)**2")
    beta_1, u, torque = 0.5, 0.03, 0.12

    def e_of(x, f):
        # y = r + 0.02 r^2 with r = F + f - beta_1 e and e = y - torque: a quadratic in r
        rest = u - 0.05 * np.tanh(x) + f
        b = 1 + beta_1
        r = (-b + np.sqrt(b**2 + 4 * 0.02 * beta_1 * (rest + beta_1 * torque))) / (
            2 * 0.02 * beta_1
        )
        return r + 0.02 * r**2 - torque

    def rates(_, z):
        e = e_of(*z)
        return [u - 0.05 * np.tanh(z[0]) + z[1] - beta_1 * e, -BETA_2 * e]

    end = DT * SAMPLES
    exact = solve_ivp(rates, (0, end), [0.2, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
    f, x = estimates(plant, beta_1, torque, u=u, start=0.2)
    # e is held over each step: first order, about dt times rates of 0.05 over 20 s
    assert f[-1] == pytest.approx(exact[1], abs=2e-4)
    assert x[-1] == pytest.approx(exact[0], abs=2e-3)


def test_without_a_sample_nothing_is_corrected():
    f, x = estimates(wheel(), 0.4, np.nan, start=1.0)
    np.testing.assert_array_equal(f, 0.0)
    np.testing.assert_array_equal(x, 1.0)


def test_a_fault_that_enters_no_state_is_refused():
    with pytest.raises(InputError, match="'friction' does not enter a state"):
        design_output_eso(wheel(enters='"input", target = "u"'), "friction", "T", 0.4, 0.04, 1)
