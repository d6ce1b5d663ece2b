"""Multisines: their lines, their rms and their peaks."""

import numpy as np
import pytest
from scipy import signal

from faultgauge.errors import InputError
from faultgauge.excitation import band_limited_noise, multisine


def draw(seed, samples=1000, dt=1.0, low=0.005, high=0.4, sigma=0.4, lines=None):
    return multisine(np.random.default_rng(seed), samples, dt, low, high, sigma, lines)


def crest(x):
    return np.abs(x).max() / np.sqrt(np.mean(x**2))


def schroeder(lines, samples):
    """phi_k = -pi k (k - 1)/M for a flat spectrum, by the sum as it is written."""
    k, M = np.arange(1, len(lines) + 1), len(lines)
    phase = 2 * np.pi * np.outer(np.arange(samples), lines) / samples - np.pi * k * (k - 1) / M
    return np.cos(phase).sum(axis=1)


@pytest.mark.parametrize(("samples", "dt"), [(1000, 1.0), (999, 1.0), (5000, 0.1)])
def test_equal_lines_in_the_band_and_none_outside(samples, dt):
    x = draw(0, samples, dt, 0.01, 0.4, 3.0)
    f, power = signal.periodogram(x, 1 / dt, detrend=False, scaling="spectrum")
    inside = (f > 0.01 - 1e-9) & (f < 0.4 + 1e-9)
    # sines share sigma^2 equally; rounding of two FFTs
    np.testing.assert_allclose(power[inside], 9.0 / inside.sum(), rtol=1e-9)
    assert power[~inside].max() < 1e-20
    assert np.sqrt(np.mean(x**2)) == pytest.approx(3.0, rel=1e-12)


def test_chosen_lines_are_spread_over_the_band():
    power = signal.periodogram(draw(0, lines=6), detrend=False)[1]
    # from 5 to 400 in steps of 79
    np.testing.assert_array_equal(np.flatnonzero(power > 1e-12), [5, 84, 163, 242, 321, 400])


@pytest.mark.parametrize(("low", "high"), [(0.005, 0.4), (0.005, 0.03), (0.1, 0.2)])
def test_the_crest_is_below_those_of_noise_and_of_schroeders_phases(low, high):
    lines = np.arange(round(1000 * low), round(1000 * high) + 1)
    for seed in range(3):
        x = draw(seed, low=low, high=high)
        noise = band_limited_noise(np.random.default_rng(seed), 1000, 1.0, low, high, 0.4)
        assert crest(x) < crest(noise)
        assert crest(x) < crest(schroeder(lines, 1000))


def test_one_line_is_a_sine():
    x = draw(0, samples=1000, low=0.01, high=0.0105)
    assert crest(x) == pytest.approx(np.sqrt(2), rel=2e-3)  # 100 samples a period: 1 - cos(pi/100)


def test_seeds():
    np.testing.assert_array_equal(draw(5), draw(5))
    # 396 lines with other phases: 792 independent numbers
    assert abs(np.corrcoef(draw(5), draw(6))[0, 1]) < 4.5 / np.sqrt(792)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"high": 0.6}, "0.5 Hz at the highest"),
        ({"low": 0.0101, "high": 0.0109}, "0 lines from 0.0101 to 0.0109 Hz but 1 wanted"),
        ({"lines": 397}, "396 lines from 0.005 to 0.4 Hz but 397 wanted"),
        ({"lines": 0}, "396 lines .* ask for fewer lines"),
        ({"samples": 2}, "0 lines"),
    ],
)
def test_refusals(wrong, words):
    with pytest.raises(InputError, match=words):
        draw(0, **wrong)
