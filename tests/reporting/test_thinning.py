"""Thinning keeps what a reader looks for."""

import itertools

import numpy as np
import pytest

from faultgauge.reporting.thinning import stretches, thin, thin_band


def noisy(samples: int) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(samples) * 0.01
    return t, np.sin(t) + np.random.default_rng(3).normal(0.0, 0.1, samples)


def test_extremes_of_every_bin_survive():
    t, y = noisy(100_000)
    y[[137, 77_777]] = 9.0, -8.0  # one-sample spikes
    kept_t, kept_y = thin(t, y, 500)
    assert kept_t.size <= 2 * 500 + 2  # two per bin and the two ends of the curve
    assert set(zip(kept_t, kept_y, strict=True)) <= set(zip(t, y, strict=True))
    edges = np.linspace(t[0], t[-1], 501)
    for low, high in itertools.pairwise(edges):
        # The middle of the bin: at its edges rounding may put a sample on either side.
        inner = (t > low + 0.005) & (t < high - 0.005)
        near = (kept_t > low - 0.015) & (kept_t < high + 0.015)
        assert kept_y[near].max() >= y[inner].max()
        assert kept_y[near].min() <= y[inner].min()
    assert kept_y.max() == 9.0
    assert kept_y.min() == -8.0


def test_time_stays_in_order():
    kept_t, _ = thin(*noisy(100_000), 500)
    assert (np.diff(kept_t) > 0.0).all()


def test_short_curve_is_left_alone():
    t, y = noisy(200)
    kept_t, kept_y = thin(t, y, 500)
    np.testing.assert_array_equal(kept_t, t)
    np.testing.assert_array_equal(kept_y, y)


@pytest.mark.parametrize("samples", [1000, 100_000])
def test_gap_breaks_the_line_once(samples: int):
    t, y = noisy(samples)
    y[samples // 2 : samples // 2 + samples // 10] = np.nan
    _, kept_y = thin(t, y, 500)
    assert np.isnan(kept_y).sum() == 1


def test_missing_rows_break_the_line_like_nan():
    t, y = noisy(1000)
    there = np.r_[0:400, 500:1000]
    with_nan = y.copy()
    with_nan[400:500] = np.nan
    for got, expected in zip(thin(t[there], y[there], 600), thin(t, with_nan, 600), strict=True):
        np.testing.assert_array_equal(got, expected)


def test_slow_channel_in_a_fast_table_stays_one_line():
    t, y = noisy(10_000)
    y[np.arange(10_000) % 20 != 0] = np.nan  # sampled in every 20th row
    kept_t, kept_y = thin(t, y, 500)
    assert not np.isnan(kept_y).any()
    np.testing.assert_array_equal(kept_t, t[::20])


def test_lone_sample_becomes_a_dot():
    t = np.r_[np.arange(20.0), 100.0, np.arange(200.0, 220.0)]
    kept_t, kept_y = thin(t, np.ones_like(t), 100)
    # A line from the sample to itself, between the two gaps.
    assert (np.isfinite(kept_y) & (kept_t == 100.0)).sum() == 2
    assert np.isnan(kept_y).sum() == 2


def test_values_too_large_to_draw_are_left_out():
    t, y = noisy(1000)
    y[500:] = np.logspace(0.0, 300.0, 500)
    y[-1] = np.inf
    assert np.nanmax(np.abs(thin(t, y, 500)[1])) <= 1e100  # what matplotlib can still scale


@pytest.mark.parametrize("y", [np.array([]), np.full(3, np.nan)])
def test_nothing_to_draw(y: np.ndarray):
    kept_t, kept_y = thin(np.arange(float(y.size)), y, 10)
    assert kept_t.size == kept_y.size == 0


def test_band_covers_every_sample():
    t, y = noisy(50_000)
    lo, hi = y - 0.1, y + 0.2
    kept_t, kept_lo, kept_hi = thin_band(t, lo, hi, 300)
    assert kept_t.size <= 300
    group = np.searchsorted(kept_t, t, side="right") - 1
    assert (kept_lo[group] <= lo).all()
    assert (kept_hi[group] >= hi).all()
    assert kept_hi.max() == hi.max()
    assert kept_lo.min() == lo.min()


def test_band_breaks_at_a_gap():
    t, y = noisy(1000)
    y[400:500] = np.nan
    _, kept_lo, kept_hi = thin_band(t, y - 1.0, y + 1.0, 600)
    assert np.isnan(kept_lo).sum() == np.isnan(kept_hi).sum() == 1


def test_stretches_last_to_the_first_sample_after():
    t = np.arange(10.0)
    mask = np.zeros(10, dtype=bool)
    mask[[0, 1, 5, 9]] = True
    assert stretches(t, mask, 100) == [(0.0, 2.0), (5.0, 6.0), (9.0, 9.0)]


def test_stretches_too_close_to_tell_apart_are_one():
    t = np.arange(10_000.0)
    mask = np.arange(10_000) % 2 == 0
    assert stretches(t, mask, 100) == [(0.0, 9999.0)]
