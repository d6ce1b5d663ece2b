"""The neural ODE against the exact discretisation, the classical tableau and SciPy's solver."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete

from faultgauge_studies.baselines.baseline import Record, Scaling, free_run, one_step
from faultgauge_studies.baselines.neural_ode import neural_ode

DT = 0.1
A = np.array([[-0.8, 1.0], [-1.0, -0.5]])
B = np.array([[0.5], [1.0]])
C, D = np.array([[1.0, -2.0]]), np.array([[0.3]])
RNG = np.random.default_rng(0)
U = np.repeat(RNG.uniform(-1, 1, (8, 1)), 5, axis=0)
PLAIN = Scaling(jnp.zeros(1), jnp.ones(1), jnp.zeros(1), jnp.ones(1))


def unit(dt=DT, networks=0.0):
    """A, B, C, D above, and networks `networks` times those of a start."""
    model = neural_ode(PLAIN, 4, 2, dt, np.random.default_rng(1))
    weights = dict(model.weights)
    weights["f_line"] = jnp.asarray(np.hstack([A, B]))
    weights["h_line"] = jnp.asarray(np.hstack([C, D]))
    for name in ("f_out", "h_out"):
        weights[name] = networks * jnp.sign(weights[name])
    return eqx.tree_at(lambda m: m.weights, model, weights)


def start_of(model, u0, y0):
    return np.asarray(model.weights["encoder"]) @ np.array([u0, y0, 1.0])


def run(model, u=U):
    y = np.zeros_like(u)
    y[0] = 0.4
    return np.asarray(free_run(model, Record(u, y)))[:, 0], start_of(model, u[0, 0], 0.4)


def linear(z, phi, gamma, u):
    found = []
    for now in u:
        found.append((C @ z + D @ now)[0])
        z = phi @ z + gamma @ now
    return np.array(found)


def taylor(dt):
    """Four stages on a linear system are the exponential's series up to the fourth power."""
    square = A @ A * dt**2
    phi = np.eye(2) + A * dt + square / 2 + square @ A * dt / 6 + square @ square / 24
    return phi, (np.eye(2) + A * dt / 2 + square / 6 + square @ A * dt / 24) @ B * dt


def test_without_networks_it_is_a_linear_system():
    found, z = run(unit())
    np.testing.assert_allclose(found, linear(z, *taylor(DT), U), rtol=0, atol=1e-13)  # rounding
    phi, gamma, *_ = cont2discrete((A, B, C, D), DT, method="zoh")
    # |A| = 1.3: what is cut off is (0.13)^5/120 = 3e-7 a step, over about 16 steps of memory
    np.testing.assert_allclose(found, linear(z, phi, gamma, U), rtol=0, atol=1e-5)


def test_half_the_step_on_held_inputs_is_the_same_curve():
    """The error of a step of the fourth order falls to a sixteenth."""
    coarse = unit()
    fine = coarse.every(DT / 2)
    assert (coarse.dt, fine.dt) == (DT, DT / 2)
    found, z = run(coarse)
    twice, _ = run(fine, np.repeat(U, 2, axis=0))
    phi, gamma, *_ = cont2discrete((A, B, C, D), DT, method="zoh")
    exact = linear(z, phi, gamma, U)
    ratio = np.abs(found - exact).max() / np.abs(twice[::2] - exact).max()
    assert 14 < ratio < 18  # 16 up to terms of the next order, of relative size |A| dt


def test_with_networks_it_is_scipys_solution():
    model = unit(networks=0.5)
    w = {name: np.asarray(value) for name, value in model.weights.items()}

    def part(name, z, now):
        x = np.concatenate([z, now])
        hidden = np.tanh(w[f"{name}_in"] @ x + w[f"{name}_bias"])
        return w[f"{name}_line"] @ x + w[f"{name}_out"] @ hidden + w[f"{name}_bias_out"]

    found, z = run(model)
    expected = []
    for now in U:
        expected.append(part("h", z, now)[0])
        z = solve_ivp(lambda t, z, u=now: part("f", z, u), (0, DT), z, rtol=1e-11, atol=1e-12).y[
            :, -1
        ]
    # as above, with slopes of the network up to about 2: 15 times the bound of the linear system
    coarse = np.abs(found - expected).max()
    assert coarse < 1.5e-4
    fine, _ = run(model.every(DT / 4), np.repeat(U, 4, axis=0))
    assert np.abs(fine[::4] - expected).max() < coarse / 100  # 4^4 = 256, with room


def test_measured_outputs_are_read_at_the_start_alone():
    model = unit(networks=0.5)
    record = Record(U, np.random.default_rng(2).normal(size=U.shape))
    np.testing.assert_array_equal(free_run(model, record), one_step(model, record))


def test_encoder_reads_scaled_signals():
    scaling = Scaling(jnp.array([1.0]), jnp.array([2.0]), jnp.array([-1.0]), jnp.array([4.0]))
    model = neural_ode(scaling, 4, 3, DT, np.random.default_rng(1))
    record = Record(np.full((1, 1), 2.0), np.full((1, 1), 3.0))
    w = {name: np.asarray(value) for name, value in model.weights.items()}
    x = np.concatenate([w["encoder"] @ [0.5, 1.0, 1.0], [0.5]])  # (2-1)/2, (3+1)/4
    y = w["h_line"] @ x + w["h_out"] @ np.tanh(w["h_in"] @ x + w["h_bias"]) + w["h_bias_out"]
    found = free_run(model, record)
    np.testing.assert_allclose(found[0], -1.0 + 4.0 * y, rtol=1e-13)  # rounding


def test_no_start_runs_away():
    """Rates of 0.02 and 0.002 1/s: over 10 s the curve stays within a few times its start."""
    u = np.ones((100, 1))
    for seed in range(10):
        model = neural_ode(PLAIN, 4, 2, DT, np.random.default_rng(seed))
        found = np.asarray(free_run(model, Record(u, u)))
        # x' = 0.02 (three N(0,1) terms of size ~1): less than 0.1 1/s, so e^1 at most, times ~10
        assert np.abs(found).max() < 30
