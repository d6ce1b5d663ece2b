"""Fisher's scoring on samples whose likeliest levels are known in closed form."""

import numpy as np
import pytest

from faultgauge.detection.calibration.innovation_likelihood import Likelihoods
from faultgauge.detection.calibration.scoring import scored

rng = np.random.default_rng(0)
SAMPLES = rng.standard_normal((2, 500)) * np.array([[0.3], [20.0]])
FREE = np.full(2, -30.0), np.full(2, 30.0), np.zeros(2), np.full(2, np.inf)


def tell(levels):
    """Independent samples, normal with the standard deviations exp(level), a row of them each."""
    root = np.repeat(levels, SAMPLES.shape[1], axis=1)
    white = SAMPLES.ravel() * np.exp(-root)
    cost = np.sum(white**2 / 2 + root, axis=1)
    return Likelihoods(
        cost, np.zeros((len(levels), 1, 0)), np.zeros((len(levels), 1, 0, 0)), white, root
    )


def climbed(low, high, center, pull, most=50, enough=1e-9):
    steps = []
    prior = (center, pull)
    found, cost = scored(
        tell, tell, np.zeros(2), low, high, *prior, most, enough, lambda: steps.append(1)
    )
    return found, cost, len(steps)


def test_the_likeliest_levels_are_the_samples_own():
    """ln of the root of the mean square, each; of 500 squares that is known to 1 / sqrt(1000), and
    the slopes' differences are a tenth of that."""
    found, cost, steps = climbed(*FREE)
    exact = np.log(np.sqrt(np.mean(SAMPLES**2, axis=1)))
    np.testing.assert_allclose(found, exact, atol=1e-3)
    assert cost == pytest.approx(tell(exact[None]).cost[0], abs=1e-3)
    assert steps < 20  # steps of at most 2, from 0 to 3, and then by the curvature


def test_a_bound_holds_and_leaves_the_other_level_free():
    low, _, *prior = FREE
    found, _, _ = climbed(low, np.array([30.0, 2.0]), *prior)
    assert found[1] == 2.0
    assert found[0] == pytest.approx(np.log(np.sqrt(np.mean(SAMPLES[0] ** 2))), abs=1e-3)


def test_a_prior_pulls_as_its_weight_says():
    """d/dx [n ln s + sum y^2 / 2 s^2 + (x - c)^2 / 2 pull^2] = 0 at what is found; the slope's
    scale is n / pull^2 of some thousand."""
    low, high, _, _ = FREE
    center, pull = np.array([2.0, 0.0]), np.array([0.05, np.inf])
    found, _, _ = climbed(low, high, center, pull)
    n = SAMPLES.shape[1]
    slope = n - np.sum(SAMPLES[0] ** 2) * np.exp(-2 * found[0]) + (found[0] - 2.0) / 0.05**2
    assert abs(slope) < 1e-2 * n
    assert found[0] > np.log(np.sqrt(np.mean(SAMPLES[0] ** 2))) + 0.1


def test_the_search_ends_where_a_step_gains_little_and_says_how_often_it_went():
    _, _, long = climbed(*FREE)
    _, cost, short = climbed(*FREE, enough=1e9)
    assert short == 1 < long
    assert cost < tell(np.zeros((1, 2))).cost[0]


def test_a_rough_likelihood_is_searched_by_longer_differences():
    """Ripples of 5, 0.01 apart, which a difference of 0.003 takes for slopes. Both up and both down
    are 20 apart, which the samples weigh at sqrt(2 * 20 / 1000) = 0.2 from their own levels."""
    low, high, *prior = FREE

    def rough(levels):
        told = tell(levels)
        return told._replace(cost=told.cost + 5 * np.sum(np.sin(levels * 628.0), axis=1))

    found, cost = scored(rough, rough, np.zeros(2), low, high, *prior, 50, 1.0, lambda: None)
    exact = np.log(np.sqrt(np.mean(SAMPLES**2, axis=1)))
    np.testing.assert_allclose(found, exact, atol=0.2)
    assert cost < rough(exact[None]).cost[0] + 20


def test_where_information_is_ten_times_the_curvature_the_last_steps_are_mixed():
    """Damped steps alone go a tenth of the way each, and need 140 from 3 to 1e-6; of a quadratic
    of two levels three steps mixed tell the rest, which a square of h leaves to a few more."""
    A, least = np.array([[3.0, 1.0], [0.0, 2.0], [1.0, -1.0]]), np.array([1.0, -3.0])

    def stiff(levels):
        e = (levels - least) @ A.T
        none = np.zeros((len(levels), 1, 0)), np.zeros((len(levels), 1, 0, 0))
        return Likelihoods(np.sum(e**2, axis=1) / 20, *none, e, np.zeros_like(e))

    low, high, *prior = FREE
    steps = []
    found, _ = scored(
        stiff, stiff, np.zeros(2), low, high, *prior, 200, 1e-12, lambda: steps.append(1)
    )
    # the slope is off by the curvature that M has too much of, h / 2 times nine tenths of it
    np.testing.assert_allclose(found, least, atol=0.05)
    assert len(steps) < 20
