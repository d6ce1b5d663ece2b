"""Means of residuals: the least squares of a matrix that averages, point by point."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.identification.optimise.algorithms import ALGORITHMS
from faultgauge.identification.optimise.means import Means
from faultgauge.identification.optimise.normal_equations import normal_equations

POINTS, UNDER = 40, 5


def bend(theta, sample):
    """Two equations of three unknowns."""
    x, y = sample
    return jnp.stack([theta[0] + jnp.sin(theta[1] * x) - y, theta[2] * x**2 - y])


def averaged(equations=2):
    """(points, `Means` over them, the matrix of each equation's means)."""
    rng = np.random.default_rng(0)
    points = jnp.asarray(rng.normal(size=(2, POINTS)))
    first = np.sort(rng.choice(POINTS - UNDER + 1, 20, replace=False))
    weights = rng.uniform(size=(equations, UNDER))
    matrices = np.zeros((equations, len(first), POINTS))
    for row, start in enumerate(first):
        matrices[:, row, start : start + UNDER] = weights
    return (*points,), Means((*points,), jnp.asarray(first), jnp.asarray(weights)), matrices


def test_means_are_the_matrix():
    points, samples, matrices = averaged()
    theta = jnp.array([0.3, 0.7, -0.2])
    r, J = (
        np.einsum("esp,pe...->se...", matrices, each)
        for each in (
            jax.vmap(bend, (None, 0))(theta, points),
            jax.vmap(jax.jacobian(bend), (None, 0))(theta, points),
        )
    )
    cost, hessian, gradient = normal_equations(bend, theta, samples)
    np.testing.assert_allclose(cost, np.sum(r**2))
    np.testing.assert_allclose(hessian, np.einsum("sei,sej->ij", J, J))
    np.testing.assert_allclose(gradient, np.einsum("sei,se->i", J, r))


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_linear_least_squares_of_means(algorithm):
    points, samples, matrices = averaged(1)

    def line(theta, sample):
        x, y = sample
        return (theta[0] + theta[1] * x - y)[None]

    free = jnp.full(2, jnp.inf)
    minimise, options = ALGORITHMS[algorithm]
    found = minimise(line, jnp.zeros((1, 2)), samples, samples, -free, free, options)
    x, y = points
    slopes = matrices[0] @ np.stack([np.ones(POINTS), x], axis=1)
    expected = np.linalg.lstsq(slopes, matrices[0] @ y)[0]
    # where gradient descent stops, too
    np.testing.assert_allclose(found.theta[0], expected, atol=1e-4)
    np.testing.assert_allclose(found.validation_cost, found.cost)
