"""Levenberg-Marquardt with unknowns that belong to one run alone, against SciPy on all at once."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from faultgauge.identification.optimise.levenberg_marquardt import (
    CONVERGED,
    FAILED,
    Options,
    levenberg_marquardt,
)
from faultgauge.identification.optimise.normal_equations import bordered_equations, forward

# y(t) = x0 exp(-a t) + b (1 - exp(-a t)) + drift t: a and b of the plant, x0 and drift of a run
T = np.linspace(0, 4, 25)
RUNS, SHARED, LOCAL = 5, 2, 2
STARTS = np.random.default_rng(0).uniform(-3, 3, (RUNS, LOCAL)) * [1.0, 0.05]
TRUTH = np.concatenate([[0.8, 2.0], STARTS.ravel()])


def response(xp, own):
    a, b, x0, drift = own
    decay = xp.exp(-a * T)
    return x0 * decay + b * (1 - decay) + drift * T


def residual(own, y):
    return response(jnp, own) - y


def by_hand(own, y):
    """The residual and its Jacobian, in closed form."""
    a, b, x0, _ = own
    decay = jnp.exp(-a * T)
    J = jnp.stack([T * decay * (b - x0), 1 - decay, decay, jnp.asarray(T)], axis=1)
    return residual(own, y), J


def each_run(theta):
    return np.concatenate(
        [np.broadcast_to(theta[:SHARED], (RUNS, SHARED)), theta[SHARED:].reshape(RUNS, LOCAL)], 1
    )


def outputs(noise, seed=1):
    clean = np.stack([response(np, own) for own in each_run(TRUTH)])
    return clean + noise * np.random.default_rng(seed).normal(size=clean.shape)


def stacked(theta, y):
    runs = zip(each_run(theta), y, strict=True)
    return np.concatenate([response(np, own) - each for own, each in runs])


def solve(starts, y, *, penalty=None, upper=None, linearised=None, **options):
    starts = jnp.atleast_2d(jnp.asarray(starts))
    size = starts.shape[1]
    return levenberg_marquardt(
        residual,
        starts,
        jnp.asarray(y),
        None,
        jnp.full(size, -np.inf),
        jnp.full(size, np.inf) if upper is None else jnp.asarray(upper),
        Options(**options),
        None if penalty is None else jnp.asarray(penalty),
        LOCAL,
        linearised,
    )


def first_guess():
    return np.concatenate([[0.3, 0.5], np.zeros(RUNS * LOCAL)])


@pytest.mark.parametrize("linearised", [forward(residual), by_hand])
def test_normal_equations_are_those_of_the_joint_problem(linearised):
    theta, y = TRUTH + 0.1, outputs(0.3)
    # with one evaluation: central differences where it starts
    J = least_squares(stacked, theta, args=(y,), jac="3-point", max_nfev=1).jac
    r = stacked(theta, y)
    found = bordered_equations(linearised, jnp.asarray(theta), jnp.asarray(y), LOCAL)
    assert float(found[0]) == pytest.approx(r @ r, rel=1e-13)  # rounding of 125 products
    # central differences: about 1e-10 of each entry
    np.testing.assert_allclose(found[1], J.T @ J, rtol=0, atol=1e-8 * np.abs(J.T @ J).max())
    np.testing.assert_allclose(found[2], J.T @ r, rtol=0, atol=1e-8 * np.abs(J.T @ r).max())


@pytest.mark.parametrize("linearised", [None, by_hand])
def test_same_minimum_as_scipy(linearised):
    y = outputs(0.1)
    found = solve(first_guess(), y, linearised=linearised)
    reference = least_squares(stacked, first_guess(), args=(y,), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert int(found.status[0]) == CONVERGED
    assert float(found.cost[0]) == pytest.approx(2 * reference.cost, rel=1e-9)  # a flat minimum
    np.testing.assert_allclose(found.theta[0], reference.x, rtol=0, atol=1e-5)  # its square root


def test_no_noise_gives_the_truth():
    found = solve(first_guess(), outputs(0.0))
    np.testing.assert_allclose(found.theta[0], TRUTH, rtol=0, atol=1e-8)  # to rounding's root


def test_prior_and_bound_reach_shared_and_local_unknowns():
    """The penalty as further equations, and two bounds that hold, which SciPy is given too."""
    y = outputs(0.1)
    penalty = np.concatenate([[0.0, 2.0], np.tile([0.5, 0.0], RUNS)])
    upper = np.full(TRUTH.size, np.inf)
    upper[0], upper[2] = 0.7, TRUTH[2] - 0.3

    def equations(theta):
        return np.concatenate([stacked(theta, y), np.sqrt(penalty) * theta])

    start = np.minimum(first_guess(), upper - 0.1)
    reference = least_squares(
        equations, start, bounds=(-np.inf, upper), xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    found = solve(start, y, penalty=penalty, upper=upper)
    theta = np.asarray(found.theta[0])
    assert theta[0] == upper[0]
    assert theta[2] == upper[2]
    # SciPy stays a little inside its bounds: 1e-6 of the cost's slope there
    assert float(found.cost[0]) == pytest.approx(2 * reference.cost, rel=1e-5)
    assert float(found.cost[0]) <= 2 * reference.cost * (1 + 1e-9)
    np.testing.assert_allclose(theta, reference.x, rtol=0, atol=1e-4)


def test_starts_side_by_side_and_one_that_fails():
    y = outputs(0.1)
    starts = np.stack([first_guess(), np.full(TRUTH.size, np.nan), TRUTH])
    found = solve(starts, y, batch=3)
    assert [int(s) == FAILED for s in found.status] == [False, True, False]
    # one minimum, from both sides: flat, as above
    np.testing.assert_allclose(found.theta[0], found.theta[2], rtol=0, atol=1e-5)


def test_a_run_alone_moves_no_other():
    """Noise in one run changes its own unknowns, and the others' only through what is shared."""
    y = outputs(0.0)
    y[3] += 0.2 * np.sin(3 * T)
    held = np.concatenate([TRUTH[:SHARED], np.full(RUNS * LOCAL, np.inf)])
    lower = jnp.asarray(np.concatenate([TRUTH[:SHARED], np.full(RUNS * LOCAL, -np.inf)]))
    found = levenberg_marquardt(
        residual, jnp.asarray(np.atleast_2d(first_guess())), jnp.asarray(y), None,
        lower, jnp.asarray(held), Options(), None, LOCAL, by_hand,
    )  # fmt: skip
    theta = np.asarray(found.theta[0])
    others = np.ones(TRUTH.size, bool)
    others[SHARED + 3 * LOCAL : SHARED + 4 * LOCAL] = False
    np.testing.assert_allclose(
        theta[others], TRUTH[others], rtol=0, atol=1e-7
    )  # to rounding's root
    decay = np.exp(-0.8 * T)
    own, *_ = np.linalg.lstsq(np.stack([decay, T], 1), y[3] - 2.0 * (1 - decay))
    np.testing.assert_allclose(theta[~others], own, rtol=0, atol=1e-7)
    assert np.abs(own - STARTS[3]).max() > 0.01


def test_acceleration_follows_a_curved_valley():
    """Rosenbrock's valley, narrow and bent: fewer trials to the same minimum."""

    def valley(theta, scale):
        return jnp.stack([1 - theta[0], scale * (theta[1] - theta[0] ** 2)])

    free = jnp.full(2, np.inf)
    trials = []
    for linearised in (None, forward(valley)):
        found = levenberg_marquardt(
            valley, jnp.array([[-1.2, 1.0]]), jnp.array([1000.0]), None, -free, free,
            Options(tolerance=1e-14), None, 0, linearised,
        )  # fmt: skip
        # the minimum by hand; a step that ends at 1e-12 of it squares to less
        np.testing.assert_allclose(found.theta[0], [1.0, 1.0], rtol=0, atol=1e-6)
        trials.append(int(found.trials[0]))
    plain, accelerated = trials
    assert accelerated < plain / 2
