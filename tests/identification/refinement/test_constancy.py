"""What parameters would explain if they changed, against least squares with and without that."""

import numpy as np
import pytest

from faultgauge.identification.refinement.constancy import drops, steps


@pytest.mark.parametrize("prior", [0.0, 3.0])
def test_a_linear_problem(prior):
    """There the first order is all: the drop is the difference of two least squares."""
    rng = np.random.default_rng(0)
    J, r = rng.standard_normal((60, 9)), rng.standard_normal(60)
    fitted, own = np.array([0, 1, 2, 4, 5]), [np.array([3, 6]), np.array([7, 8])]
    penalty = np.zeros((5, 9))
    penalty[np.arange(5), fitted] = np.sqrt(prior)

    def least(columns):
        A = np.concatenate([J, penalty])[:, columns]
        b = np.concatenate([r, np.zeros(5)])
        return np.sum((b - A @ np.linalg.lstsq(A, b)[0]) ** 2)

    hessian, gradient = J.T @ J, J.T @ r
    inner = np.linalg.inv(hessian[np.ix_(fitted, fitted)] + prior * np.eye(5))
    found = drops(hessian, inner, gradient, fitted, own)
    wanted = [least(fitted) - least(np.concatenate([fitted, each])) for each in own]
    np.testing.assert_allclose(found, wanted, rtol=1e-9)  # rounding


def test_what_is_fitted_already_explains_nothing_more():
    """The sum of a parameter's steps is the parameter itself."""
    rng = np.random.default_rng(1)
    part = rng.standard_normal((50, 2))
    J, r = np.column_stack([part.sum(axis=1), part]), rng.standard_normal(50)
    r -= J[:, 0] * (J[:, 0] @ r) / (J[:, 0] @ J[:, 0])
    own = [np.array([1, 2])]
    found = drops(J.T @ J, np.array([[1 / (J[:, 0] @ J[:, 0])]]), J.T @ r, np.array([0]), own)
    wanted = np.sum(r**2) - np.sum((r - part @ np.linalg.lstsq(part, r)[0]) ** 2)
    np.testing.assert_allclose(found, [wanted], rtol=1e-9)


def test_steps():
    found = steps(10, 4, 2)
    assert found.shape == (10, 4, 2)
    np.testing.assert_array_equal(found.sum(axis=1), 1.0)  # one part at a time
    np.testing.assert_array_equal(found[..., 0].argmax(axis=1), [0, 0, 0, 1, 1, 2, 2, 2, 3, 3])
    np.testing.assert_array_equal(found[..., 0], found[..., 1])
