"""RK4 under the input's hold, against matrix exponentials and closed forms."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from faultgauge.plants.plant import Plant
from faultgauge.plants.signals import Fault, Input, Output, Signals, State
from faultgauge.simulation.integrators import step

A = np.array([[-0.3, 2.0], [-1.5, -0.4]])
B = np.array([[0.5], [1.0]])


class Linear(Plant):
    """dx = A x + B u, y = x."""

    signals: Signals = eqx.field(static=True)
    A: jax.Array
    B: jax.Array

    def derivative(self, x, u):
        return self.A @ x + self.B @ u

    def output(self, dx, x, u):
        return x


def linear(A=A, B=B, *, hold="zero", state=(-np.inf, np.inf), limit=np.inf, faults=()):
    n, m = B.shape
    holds = (hold,) * m if isinstance(hold, str) else hold
    signals = Signals(
        states=tuple(State(f"x{k}", min=state[0], max=state[1]) for k in range(n)),
        inputs=tuple(Input(f"u{k}", min=-limit, max=limit, hold=holds[k]) for k in range(m)),
        outputs=tuple(Output(f"x{k}", measures=f"x{k}") for k in range(n)),
        faults=faults,
    )
    return Linear(signals, jnp.asarray(A, float), jnp.asarray(B, float))


def after(plant, x, u, u_next, dt, substeps=1, f=None):
    f = np.zeros(len(plant.signals.faults)) if f is None else np.asarray(f, float)
    arrays = (jnp.asarray(np.asarray(a, float)) for a in (x, u, u_next, f, dt))
    x, u, u_next, f, dt = arrays
    return np.asarray(step(plant, x, u, u_next, f, dt, substeps))


def exact(x, u, dt):
    """The state under a constant input, from one exponential of [[A, B], [0, 0]]."""
    n, m = B.shape
    block = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * dt)
    return block[:n, :n] @ x + block[:n, n:] @ u


X0, U0 = np.array([1.0, -0.5]), np.array([0.8])


def test_matrix_exponential_under_a_zero_order_hold():
    dt = 0.05
    # RK4's first omitted term is (|A| dt)^5 / 5! |x|, |A| = 2.1: 1e-7
    bound = (np.linalg.norm(A, 2) * dt) ** 5 / 120 * (np.linalg.norm(X0) + 1)
    np.testing.assert_allclose(after(linear(), X0, U0, [99.0], dt), exact(X0, U0, dt), atol=bound)


def test_order_of_convergence_is_four():
    """Over a fixed second, twice the substeps leave a sixteenth of the error."""
    plant = linear()
    errors = [
        np.linalg.norm(after(plant, X0, U0, U0, 1.0, substeps) - exact(X0, U0, 1.0))
        for substeps in (8, 16, 32)
    ]
    orders = -np.diff(np.log2(errors))
    np.testing.assert_allclose(orders, 4.0, atol=0.15)  # the next order still shows: h |A| = 0.26


def test_substeps_are_steps():
    """Substeps inside one sample are the same arithmetic as samples under a constant input."""
    plant, x = linear(), X0
    for _ in range(4):
        x = after(plant, x, U0, U0, 0.025)
    np.testing.assert_allclose(after(plant, X0, U0, U0, 0.1, 4), x, rtol=1e-14)  # rounding


@pytest.mark.parametrize("substeps", [1, 3])
def test_zero_order_hold_never_reads_the_next_sample(substeps):
    plant = linear()
    calm = after(plant, X0, U0, U0, 0.1, substeps)
    for other in (1e6, np.nan, np.inf):
        np.testing.assert_array_equal(after(plant, X0, U0, [other], 0.1, substeps), calm)


@pytest.mark.parametrize("substeps", [1, 2, 5])
def test_linear_hold_is_exact_for_a_ramp_into_an_integrator(substeps):
    """x' = u, u from 1 to 4 in 0.5 s: the trapezoid, 0.2 + 0.5 (1 + 4) / 2."""
    plant = linear(np.zeros((1, 1)), np.ones((1, 1)), hold="linear")
    found = after(plant, [0.2], [1.0], [4.0], 0.5, substeps)
    np.testing.assert_allclose(found, [1.45], rtol=1e-15)  # rounding only


def test_linear_hold_through_two_integrators():
    """q' = v, v' = u with a ramp: q is a cubic, which RK4 integrates exactly."""
    plant = linear(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), hold="linear")
    T, u0, u1 = 0.7, 2.0, -1.0
    q = 1 + 3 * T + u0 * T**2 / 2 + (u1 - u0) * T**2 / 6
    v = 3 + (u0 + u1) / 2 * T
    np.testing.assert_allclose(after(plant, [1.0, 3.0], [u0], [u1], T), [q, v], rtol=1e-14)


def test_holds_may_differ_between_inputs():
    plant = linear(np.zeros((1, 1)), np.ones((1, 2)), hold=("zero", "linear"))
    found = after(plant, [0.0], [1.0, 1.0], [5.0, 5.0], 1.0)
    np.testing.assert_allclose(found, [1.0 + 3.0], rtol=1e-15)  # 1 held, (1 + 5) / 2 straight


def test_actuator_clips_the_input():
    plant = linear(limit=0.3)
    np.testing.assert_array_equal(
        after(plant, X0, [7.0], [7.0], 0.1), after(plant, X0, [0.3], [0.3], 0.1)
    )


@pytest.mark.parametrize("substeps", [1, 4])
def test_state_limits(substeps):
    """An integrator filled past its limit stays on it and comes off it at once."""
    plant = linear(np.zeros((1, 1)), np.ones((1, 1)), state=(0.0, 1.0))
    assert after(plant, [0.9], [1.0], [1.0], 0.5, substeps) == 1.0
    assert after(plant, [0.1], [-1.0], [1.0], 0.5, substeps) == 0.0
    assert after(plant, [1.0], [-1.0], [1.0], 0.5, substeps) == pytest.approx(0.5, rel=1e-15)


def test_no_time_no_change():
    np.testing.assert_array_equal(after(linear(), X0, U0, U0, 0.0, 3), X0)


def test_faults_enter_where_they_say():
    """On x' = u over 1 s every fault shows as plain arithmetic: x = 0.5 + clip(...) + f."""
    faults = (
        Fault("drift", "state", "x0"),
        Fault("bias", "input", "u0"),
        Fault("weak", "gain", "u0"),
    )
    plant = linear(np.zeros((1, 1)), np.ones((1, 1)), limit=2.0, faults=faults)

    def x(*f):
        return float(after(plant, [0.5], [1.5], [1.5], 1.0, f=f)[0])

    assert x(0, 0, 0) == 2.0
    assert x(0.25, 0, 0) == 2.25
    assert x(0, 0.25, 0) == 2.25
    assert x(0, 5, 0) == 2.5  # added before the actuator clips to 2
    assert x(0, 0, 0.5) == 1.25
