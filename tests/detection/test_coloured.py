"""Noise levels against a model error that lasts."""

import numpy as np
import pytest

from faultgauge.detection.coloured import long_run, widening


def coloured(rng, scale, memory, count=8000):
    """White noise and an AR(1) part of its own size `scale`, correlated over `memory` samples."""
    fade = np.exp(-1 / memory)
    slow = np.zeros(count)
    for k in range(1, count):
        slow[k] = fade * slow[k - 1] + np.sqrt(1 - fade**2) * rng.standard_normal()
    return (rng.standard_normal(count) + scale * slow)[:, None]


def test_white_innovations_are_left_alone():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        white = [rng.standard_normal((4000, 2))]
        assert widening(lambda c, white=white: [e / c for e in white]) == 1.0


def test_the_sum_of_a_coloured_error_grows_as_its_spectrum_at_zero():
    """Of an AR(1) part with variance s^2 the long-run variance is s^2 (1 + a)/(1 - a)."""
    scale, memory = 0.5, 20.0
    fade = np.exp(-1 / memory)
    expected = 1 + scale**2 * (1 + fade) / (1 - fade)
    found = [long_run([coloured(np.random.default_rng(s), scale, memory)]) for s in range(10)]
    # the largest over horizons, of which the longest has few sums: it lies above, by their scatter
    assert 0.8 * expected < np.median(found) < 2.5 * expected


def test_levels_grow_until_no_horizon_stands_out():
    e = coloured(np.random.default_rng(0), 1.0, 50.0)
    factor = widening(lambda c: [e / c])
    assert factor**2 == pytest.approx(long_run([e]), rel=1.0)  # the grid of factors is sqrt(2) wide
    assert long_run([e / factor]) <= 1


def test_samples_that_are_missing_count_for_nothing():
    e = np.random.default_rng(1).standard_normal((4000, 1))
    holes = e.copy()
    holes[::2] = np.nan
    assert long_run([holes]) == pytest.approx(1.0, abs=1.0)
    assert widening(lambda c: [holes / c]) == 1.0
