"""Band-limited noise: where its power is, how much, and how it is distributed."""

import numpy as np
import pytest
from scipy import signal, stats

from faultgauge.errors import InputError
from faultgauge.excitation import band_limited_noise


def draw(seed, samples, dt=1.0, low=0.005, high=0.4, sigma=0.4):
    return band_limited_noise(np.random.default_rng(seed), samples, dt, low, high, sigma)


@pytest.mark.parametrize(("dt", "low", "high"), [(1.0, 0.05, 0.4), (0.01, 5.0, 20.0)])
def test_the_power_lies_in_the_band_and_is_flat_there(dt, low, high):
    x = draw(0, 200_000, dt, low, high, 2.0)
    f, power = signal.welch(x, 1 / dt, nperseg=2000, detrend=False)
    guard = 0.005 / dt  # ten bins of Welch's window: its side lobes, -31 dB and falling 18 dB/oct
    outside = (f < low - guard) | (f > high + guard)
    assert power[outside].sum() < 1e-6 * power.sum()
    inside = power[(f > low + guard) & (f < high - guard)]
    # 199 half-overlapping segments scatter by 1/sqrt(199*0.95) = 7 %; 680 bins stay within 5 of it
    np.testing.assert_allclose(inside, 2.0**2 / (high - low), rtol=0.36)


@pytest.mark.parametrize(
    ("samples", "dt", "low", "high"),
    [(1, 1.0, 0.005, 0.4), (7, 1.0, 0.1, 0.2), (64, 0.5, 0.0, 1.0), (50, 1.0, 0.1, 0.105)],
)
def test_every_sample_has_the_variance_asked_for(samples, dt, low, high):
    """Over 4000 draws: the first and the last sample, whatever the record and the band."""
    x = np.array([draw(seed, samples, dt, low, high, 3.0)[[0, -1]] for seed in range(4000)])
    # a variance estimated from 4000 Gaussian samples scatters by sqrt(2/4000) = 2.2 %; 4.5 of it
    np.testing.assert_allclose((x**2).mean(axis=0), 9.0, rtol=0.1)
    assert np.abs(x.mean(axis=0)).max() < 4.5 * 3.0 / np.sqrt(4000)


def test_the_samples_are_gaussian():
    """One sample per draw, so that they are independent as the test of normality asks."""
    x = [draw(seed, 40)[13] for seed in range(2000)]
    assert stats.kstest(x, stats.norm(0, 0.4).cdf).pvalue > 1e-3  # one seed in 1000 would fail


def test_the_record_is_not_periodic():
    """A signal that repeats itself after the record has nearly equal ends."""
    ends = np.array([draw(seed, 1024, low=0.005, high=0.05)[[0, -1]] for seed in range(500)])
    # at a lag of 1023 samples the band (0.045 Hz) is uncorrelated: 500 draws scatter by 0.045
    assert abs(np.corrcoef(ends.T)[0, 1]) < 4.5 / np.sqrt(500)


def test_seeds():
    np.testing.assert_array_equal(draw(5, 300), draw(5, 300))
    one, two = draw(5, 20_000), draw(6, 20_000)
    # a flat band of 0.395 Hz leaves 0.79 independent samples per sample
    assert abs(np.corrcoef(one, two)[0, 1]) < 4.5 / np.sqrt(0.79 * 20_000)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"high": 0.6}, "0.5 Hz at the highest"),
        ({"low": 0.3, "high": 0.2}, "band 0.3 to 0.2 Hz"),
        ({"low": -0.1}, "from 0 Hz at the lowest"),
        ({"high": float("nan")}, "change low, high or dt"),
        ({"dt": 0.0}, "sampling time is 0 s"),
        ({"sigma": -1.0}, "standard deviation is -1"),
        ({"samples": 0}, "0 samples"),
        ({"low": 0.1, "high": 0.1000001}, "too narrow"),
    ],
)
def test_refusals(wrong, words):
    with pytest.raises(InputError, match=words):
        draw(0, **{"samples": 100, **wrong})
