"""Levenberg-Marquardt with a penalty, on whole runs, and with starts in batches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from faultgauge.identification.optimise.levenberg_marquardt import (
    CONVERGED,
    FAILED,
    Options,
    levenberg_marquardt,
    normal_equations,
)

RNG = np.random.default_rng(0)
DESIGN = RNG.normal(size=(50, 4)) @ RNG.normal(size=(4, 4))
TARGET = DESIGN @ np.array([1.0, -2.0, 0.5, 3.0]) + RNG.normal(size=50)
EACH = np.array([0.3, 20.0, 0.0, 4.0])


equations_of = jax.jit(normal_equations, static_argnums=0)


def linear(theta, sample):
    x, y = sample
    return (x @ theta - y)[None]


def solve(residual, starts, samples, *, validation=None, penalty=None, bound=np.inf, **options):
    starts = jnp.atleast_2d(jnp.asarray(starts, float))
    limits = jnp.full(starts.shape[1], bound)
    return levenberg_marquardt(
        residual,
        starts,
        jax.tree.map(jnp.asarray, samples),
        None if validation is None else jax.tree.map(jnp.asarray, validation),
        -limits,
        limits,
        Options(**options),
        None if penalty is None else jnp.asarray(penalty),
    )


def ridge(penalty):
    theta = np.linalg.solve(DESIGN.T @ DESIGN + np.diag(penalty), DESIGN.T @ TARGET)
    return theta, np.sum((DESIGN @ theta - TARGET) ** 2) + penalty @ theta**2


@pytest.mark.parametrize("penalty", [np.full(4, 0.1), np.full(4, 100.0), EACH])
def test_penalty_on_a_linear_residual_is_ridge(penalty):
    found = solve(linear, np.ones(4), (DESIGN, TARGET), penalty=penalty)
    theta, cost = ridge(penalty)
    assert int(found.status[0]) == CONVERGED
    assert float(found.cost[0]) == pytest.approx(cost, rel=1e-12)  # flat: parameter error squared
    np.testing.assert_allclose(found.theta[0], theta, rtol=0, atol=1e-6)  # its square root


def test_no_penalty_is_a_penalty_of_zero():
    none = solve(linear, np.ones(4), (DESIGN, TARGET))
    zero = solve(linear, np.ones(4), (DESIGN, TARGET), penalty=np.zeros(4))
    np.testing.assert_allclose(none.theta, zero.theta, rtol=1e-12)  # two programs: rounding
    assert float(zero.cost[0]) == pytest.approx(ridge(np.zeros(4))[1], rel=1e-12)


def wave(theta, sample):
    t, y = sample
    return (theta[0] * jnp.exp(-theta[1] * t) + theta[2] - y)[None]


def test_penalty_on_a_curve_is_scipys():
    """The penalty as further equations sqrt(penalty) theta, which SciPy is given."""
    t = np.linspace(0, 4, 40)
    y = 2 * np.exp(-1.5 * t) + 0.5 + 0.05 * np.random.default_rng(2).normal(size=40)
    penalty = np.array([0.5, 0.0, 2.0])

    def stacked(p):
        return np.concatenate([p[0] * np.exp(-p[1] * t) + p[2] - y, np.sqrt(penalty) * p])

    found = solve(wave, (1.0, 1.0, 0.1), (t, y), penalty=penalty)
    reference = least_squares(stacked, (1, 1, 0.1), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert float(found.cost[0]) == pytest.approx(2 * reference.cost, rel=1e-9)  # a flat minimum
    np.testing.assert_allclose(found.theta[0], reference.x, rtol=0, atol=1e-5)  # its square root


def test_penalty_respects_bounds():
    """On a bound the penalty's slope still counts: the rest is ridge with the held one fixed."""
    penalty = np.full(4, 0.1)
    free, _ = ridge(penalty)
    bound = 0.9 * np.abs(free).max()
    found = np.asarray(
        solve(linear, np.zeros(4), (DESIGN, TARGET), penalty=penalty, bound=bound).theta[0]
    )
    assert np.abs(found).max() == bound
    gradient = DESIGN.T @ (DESIGN @ found - TARGET) + penalty * found
    inside = np.abs(found) < bound
    assert 0 < np.count_nonzero(inside) < 4
    # a stationary point, to the root of the cost's 1e-10; held ones push outwards
    scale = np.abs(DESIGN.T @ TARGET).max()
    assert np.abs(gradient[inside]).max() < 1e-5 * scale
    assert np.all(gradient[~inside] * found[~inside] < 0)


def test_validation_cost_is_without_the_penalty():
    penalty = np.full(4, 5.0)
    half = (DESIGN[:25], TARGET[:25]), (DESIGN[25:], TARGET[25:])
    found = solve(linear, np.zeros(4), half[0], validation=half[1], penalty=penalty)
    theta = np.asarray(found.theta[0])
    fit, validation = (float(np.sum((x @ theta - y) ** 2)) for x, y in half)
    assert float(found.validation_cost[0]) == pytest.approx(validation, rel=1e-12)  # rounding
    assert float(found.cost[0]) == pytest.approx(fit + penalty @ theta**2, rel=1e-12)


def test_history_falls_with_a_penalty():
    found = solve(wave, (1.0, 1.0, 0.1), (np.arange(5.0), np.ones(5)), penalty=np.full(3, 0.2))
    costs = np.asarray(found.history[0, : int(found.trials[0]), 0])
    assert np.all(np.diff(costs) <= 0)
    assert costs[-1] == float(found.cost[0])


# Whole runs: many equations to a sample. y(k) = a y(k-1) + b tanh(c u(k)) from y = 0, and
# theta = (a, b, c).
SAMPLES = 30


def simulated(theta, run):
    u, y = run

    def step(state, now):
        state = theta[0] * state + theta[1] * jnp.tanh(theta[2] * now)
        return state, state

    return jax.lax.scan(step, 0.0, u)[1] - y


def sensitivities(theta, u, y):
    """The run and its derivatives, propagated by hand: forward sensitivities in NumPy."""
    (a, b, c), state, d, rows, states = theta, 0.0, np.zeros(3), [], []
    for now in u:
        t = np.tanh(c * now)
        d = a * d + np.array([state, t, b * (1 - t**2) * now])
        state = a * state + b * t
        rows.append(d)
        states.append(state)
    return np.array(states) - y, np.array(rows)


def runs(theta, count, noise=0.0):
    rng = np.random.default_rng(1)
    u = rng.uniform(-2, 2, (count, SAMPLES))
    clean = np.stack([sensitivities(theta, each, np.zeros(SAMPLES))[0] for each in u])
    return u, clean + noise * rng.normal(size=clean.shape)


def test_more_equations_than_parameters_are_forward_sensitivities():
    u, y = runs((0.8, 0.5, 1.2), 4, noise=0.3)
    theta = np.array([0.7, 0.6, 1.0])
    parts = [sensitivities(theta, *run) for run in zip(u, y, strict=True)]
    r, J = (np.concatenate([p[i] for p in parts]) for i in (0, 1))
    found = equations_of(simulated, jnp.asarray(theta), (jnp.asarray(u), jnp.asarray(y)))
    # sums of 120 products: a few hundred roundings
    assert float(found[0]) == pytest.approx(r @ r, rel=1e-12)
    np.testing.assert_allclose(found[1], J.T @ J, rtol=1e-11)
    np.testing.assert_allclose(found[2], J.T @ r, rtol=1e-11)


@pytest.mark.parametrize("equations", [2, 3, 7])
def test_either_mode_gives_the_analytic_jacobian(equations):
    """Fewer, as many and more equations than the three parameters."""
    powers = jnp.arange(1.0, equations + 1)

    def residual(theta, sample):
        return theta[0] * jnp.sin(powers * theta[1] * sample) + powers * theta[2] ** 2

    x, (a, b, c), p = np.linspace(-1, 2, 9), (1.3, 0.7, -0.4), np.arange(1.0, equations + 1)
    angle = x[:, None] * p * b
    r = a * np.sin(angle) + p * c**2
    J = np.stack(
        [np.sin(angle), a * np.cos(angle) * x[:, None] * p, np.broadcast_to(2 * p * c, r.shape)],
        axis=-1,
    ).reshape(-1, 3)
    found = equations_of(residual, jnp.array([a, b, c]), jnp.asarray(x))
    assert float(found[0]) == pytest.approx(np.sum(r**2), rel=1e-12)  # rounding of 63 products
    np.testing.assert_allclose(found[1], J.T @ J, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(found[2], J.T @ r.ravel(), rtol=1e-11, atol=1e-12)


def test_runs_without_noise_give_the_system():
    truth = (0.8, 0.5, 1.2)
    found = solve(simulated, (0.5, 1.0, 0.5), runs(truth, 3))
    # the cost falls to rounding, and the parameters with its root
    np.testing.assert_allclose(found.theta[0], truth, rtol=0, atol=1e-9)


def test_runs_with_noise_give_scipys_minimum():
    u, y = runs((0.8, 0.5, 1.2), 3, noise=0.2)

    def stacked(p):
        return np.concatenate([sensitivities(p, *run)[0] for run in zip(u, y, strict=True)])

    found = solve(simulated, (0.5, 1.0, 0.5), (u, y))
    reference = least_squares(stacked, (0.5, 1.0, 0.5), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert float(found.cost[0]) == pytest.approx(2 * reference.cost, rel=1e-9)  # a flat minimum


@pytest.mark.parametrize("batch", [2, 5])
def test_a_batch_changes_no_fit(batch):
    """Five starts, which a batch of two does not divide; one of them fails at once."""
    samples = runs((0.8, 0.5, 1.2), 3, noise=0.2)
    starts = np.random.default_rng(3).uniform(0.2, 1.2, (5, 3))
    starts[2] = np.nan
    plain = solve(simulated, starts, samples, max_trials=60)
    batched = solve(simulated, starts, samples, max_trials=60, batch=batch)
    assert int(plain.status[2]) == FAILED
    np.testing.assert_array_equal(batched.status == FAILED, plain.status == FAILED)
    fine = np.array([0, 1, 3, 4])
    # other sums, so other rounding: the flat minimum has the same cost, and theta to its root
    np.testing.assert_allclose(batched.cost[fine], plain.cost[fine], rtol=1e-9)
    np.testing.assert_allclose(batched.theta[fine], plain.theta[fine], rtol=0, atol=1e-4)
    for name in ("cost", "history", "trials"):
        assert getattr(batched, name).shape == getattr(plain, name).shape


def test_a_start_that_ends_early_stands_while_its_batch_goes_on():
    """One start at the minimum, one far away: the first is not moved by the second's trials."""
    samples = runs((0.8, 0.5, 1.2), 3)
    starts = np.array([[0.8, 0.5, 1.2], [0.3, 1.0, 0.4]])
    found = solve(simulated, starts, samples, batch=2)
    alone = solve(simulated, starts[:1], samples)
    assert int(found.trials[0]) < int(found.trials[1])
    assert int(found.trials[0]) == int(alone.trials[0])
    ended = np.asarray(found.history[0, int(found.trials[0]) :])
    assert np.all(np.isnan(ended))
    np.testing.assert_allclose(found.theta[0], starts[0], rtol=0, atol=1e-12)  # rounding
