"""Pole placement: what the closed forms say, for pairs that are easy and pairs that are not."""

import numpy as np
import pytest
from scipy.signal import place_poles

from faultgauge.observers.gains import ackermann, bandwidth_poles, spectral_radius

PAIR = np.array([0.5 + 0.3j, 0.5 - 0.3j])


@pytest.mark.parametrize("zeta", [0.05, 1 / np.sqrt(2), 1.0, 3.0])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_poles_lie_inside_the_unit_circle_from_1e_3_to_50(order, zeta):
    for speed in np.geomspace(1e-3, 50, 25):
        poles = bandwidth_poles(order, speed / 0.02, zeta, 0.02)
        assert len(poles) == order
        assert np.abs(poles).max() < 1


@pytest.mark.parametrize("zeta", [0.4, 1.0, 2.5])
def test_the_continuous_polynomial_is_that_of_the_bandwidth(zeta):
    """(s + w)(s^2 + 2 zeta w s + w^2), with |Im s| dt < pi so that the logarithm is unique."""
    omega, dt = 3.0, 0.05
    wanted = np.polymul([1, omega], [1, 2 * zeta * omega, omega**2])
    poles = np.log(bandwidth_poles(3, omega, zeta, dt)) / dt
    # a double pole (zeta = 1) is good to the square root of machine precision
    np.testing.assert_allclose(np.poly(poles).real, wanted, rtol=1e-7)


@pytest.mark.parametrize("seed", range(8))
def test_ackermann_agrees_with_scipy_on_a_complex_pair(seed):
    rng = np.random.default_rng(seed)
    A, C = rng.normal(size=(3, 3)), rng.normal(size=3)
    poles = np.append(PAIR, 0.2)
    wanted = place_poles(A.T, C[:, None], poles).gain_matrix[0]
    # two different solvers: rounding times the conditioning of a random pair (below 1e6)
    np.testing.assert_allclose(ackermann(A, C, poles), wanted, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("unit", [1e-9, 1e-3, 1e6, 1e9])
def test_units_do_not_matter(unit):
    """x in other units, x -> S x: A -> S A S^-1, C -> C S^-1, and so L -> S L."""
    A = np.array([[1.0, 0.1, 0.005], [0.0, 1.0, 0.1], [0.0, 0.0, 1.0]])
    C = np.array([1.0, 0.0, 0.0])
    S = np.diag([1.0, unit, 1 / unit])
    poles = np.append(PAIR, 0.2)
    scaled = ackermann(S @ A @ np.linalg.inv(S), C @ np.linalg.inv(S), poles)
    # L = p(A) O^-1 e_n cancels from terms of order 1 to 1: some 100 roundings
    np.testing.assert_allclose(scaled, S @ ackermann(A, C, poles), rtol=1e-10)


def test_a_very_slow_chain_is_still_placed():
    """dt = 1e-6 s: the columns of the observability matrix differ by twelve orders."""
    dt = 1e-6
    A = np.array([[1.0, dt, dt**2 / 2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    C = np.array([1.0, 0.0, 0.0])
    poles = np.append(PAIR, 0.2)
    L = ackermann(A, C, poles)
    T = np.diag([1.0, dt, dt**2])  # the same error dynamics in units that suit it
    error = T @ (A - np.outer(L, C)) @ np.linalg.inv(T)
    # simple poles 0.3 apart: a few hundred roundings
    np.testing.assert_allclose(np.poly(error), np.poly(poles).real, atol=1e-12)


@pytest.mark.parametrize(
    ("A", "C"),
    [
        (np.eye(2), np.array([1.0, 1.0])),  # two states that always move alike
        (np.array([[1.0, 0.0], [0.1, 1.0]]), np.array([1.0, 0.0])),  # nothing reads the second
        (np.diag([0.5, 0.9]), np.zeros(2)),  # nothing is read at all
    ],
)
def test_an_unobservable_pair_raises(A, C):
    with pytest.raises(np.linalg.LinAlgError, match="not observable"):
        ackermann(A, C, np.array([0.1, 0.2], complex))


def test_the_spectral_radius_is_the_worst_of_all_points():
    points = np.array([np.diag([0.1, 0.2]), [[0.0, 1.0], [-0.81, 0.0]]])
    assert spectral_radius(points) == pytest.approx(0.9)
