"""Prior weights by evidence, where the evidence is a closed form."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from faultgauge.identification.simulation_error.evidence import LEAST, MOST, updated

SIZES, COUNT, NOISE = [3, 5], 60, 0.3
SPREAD = [2.0, 0.2]  # of the weights of either network


def linear(seed):
    """(J, y) of outputs that are linear in the weights of two networks."""
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(COUNT, sum(SIZES)))
    theta = np.repeat(SPREAD, SIZES) * rng.normal(size=sum(SIZES))
    return J, J @ theta + NOISE * rng.normal(size=COUNT)


def settled(J, y, tau=1.0):
    """Updates at the least squares of `tau` copies of every sample, until nothing changes."""
    J, y = np.repeat(J, int(tau), axis=0), np.repeat(y, int(tau))
    ridge = np.ones(sum(SIZES))
    for _ in range(500):
        precision = J.T @ J + NOISE**2 * np.diag(ridge)
        theta = np.linalg.solve(precision, J.T @ y)
        variance = np.diag(NOISE**2 * tau * np.linalg.inv(precision))
        ridge = updated(theta, variance, ridge, tau, SIZES)
    return ridge


@pytest.mark.parametrize("seed", range(3))
def test_the_weights_have_the_greatest_marginal_likelihood(seed):
    """y ~ N(0, s^2 I + sum_g J_g J_g' / a_g): its density by SciPy, its maximum by Nelder-Mead."""
    J, y = linear(seed)

    def unlikely(log_a):
        variances = np.repeat(np.exp(-log_a), SIZES)
        cov = NOISE**2 * np.eye(COUNT) + (J * variances) @ J.T
        return -multivariate_normal(np.zeros(COUNT), cov).logpdf(y)

    found = minimize(unlikely, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-6})
    ridge = settled(J, y)
    assert np.ptp(ridge[:3]) == np.ptp(ridge[3:]) == 0
    # Nelder-Mead ends within 1e-4 of the likelihood, flat there
    np.testing.assert_allclose(np.log(ridge[[0, -1]]), found.x, atol=0.02)


def test_samples_that_repeat_others_say_nothing_new():
    """Every sample five times over with tau = 5: a is the same, and ridge = tau a."""
    J, y = linear(0)
    np.testing.assert_allclose(settled(J, y, tau=5.0), 5 * settled(J, y), rtol=1e-9)  # rounding


def test_prior_weights_stay_finite():
    """Weights at exactly 0 of which the data say all, or nothing."""
    zero, one = np.zeros(3), np.ones(3)
    np.testing.assert_array_equal(updated(zero, zero, one, 1.0, [3]), MOST)
    np.testing.assert_array_equal(updated(zero, one, one, 1.0, [3]), LEAST)
