"""Uniform grids and points that cover the envelope."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from faultgauge.telemetry.resampling import cover, on_grid


def test_uniform_record_is_returned_as_it_is():
    t = 5 + 0.01 * np.arange(300)
    columns = {"x": np.sin(t), "u": np.sign(np.sin(t))}
    step, grid, on = on_grid(t, columns, {"u"})
    assert step == pytest.approx(0.01, rel=1e-12)  # the difference of times near 5: rounding
    assert grid is t
    assert on is columns


def test_small_jitter_counts_as_uniform():
    t = 0.1 * np.arange(100) + 5e-6 * np.random.default_rng(0).uniform(-1, 1, 100)
    step, grid, _ = on_grid(t, {"x": t}, set())
    assert grid is t
    assert step == pytest.approx(0.1, rel=1e-5)  # two ends off by 5e-6 over 9.9 s


def irregular(seed=1, count=400):
    """Times whose steps scatter by 40 %, and a staircase that jumps at every one of them."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(0.1 * rng.uniform(0.6, 1.4, count))
    return t, rng.uniform(-1, 1, count)


def held_integral(t, u, until):
    """Integral of the staircase (t, u) from t[0], by adding up its steps."""
    ends = np.clip(np.append(t[1:], np.inf), t[0], until)
    return float(np.sum(u * (ends - np.clip(t, t[0], until))))


def test_grid_of_an_irregular_record():
    t, _ = irregular()
    step, grid, on = on_grid(t, {"x": 3 * t - 2}, set())
    assert step == np.median(np.diff(t))
    assert grid[0] == t[0]
    assert t[-1] - step < grid[-1] <= t[-1]
    np.testing.assert_allclose(np.diff(grid), step, rtol=1e-12)  # times up to 40: rounding
    np.testing.assert_allclose(on["x"], 3 * grid - 2, rtol=1e-13)  # straight lines stay straight


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_held_mean_conserves_the_integral(seed):
    """Between any two grid points the staircase carries the same impulse as the log's."""
    t, u = irregular(seed, 60)
    step, grid, on = on_grid(t, {"u": u}, {"u"})
    ours = np.concatenate([[0.0], np.cumsum(on["u"][:-1]) * step])
    log = [held_integral(t, u, until) for until in grid]
    np.testing.assert_allclose(ours, log, rtol=0, atol=1e-13)  # sums of 60 numbers below 0.2


def test_a_pulse_between_grid_points_is_not_lost():
    t = np.sort(np.concatenate([np.arange(50) * 1.0, [20.4, 20.5]]))
    u = np.where(t == 20.4, 10.0, 0.0)
    step, _, on = on_grid(t, {"u": u, "x": u}, {"u"})
    assert step == 1.0
    assert np.sum(on["u"]) * step == pytest.approx(1.0, rel=1e-12)  # 10 for 0.1 s
    assert np.all(on["x"] == 0)  # the interpolated copy shows what would have been lost


def test_last_held_value_is_the_last_one_before_the_end():
    t = np.array([0.0, 1.0, 2.5, 3.0, 4.0])
    u = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    _, grid, on = on_grid(t, {"u": u}, {"u"})
    np.testing.assert_array_equal(grid, [0.0, 1.0, 2.0, 3.0, 4.0])
    # by hand: 2 s to 3 s is half 2 and half 3; nothing is known after 4 s but its own sample
    np.testing.assert_allclose(on["u"], [1.0, 2.0, 2.5, 4.0, 5.0], rtol=1e-15)


def test_cover_of_few_points_is_all_of_them():
    points = np.random.default_rng(0).normal(size=(50, 2))
    np.testing.assert_array_equal(cover(points, 50, np.random.default_rng(1)), np.arange(50))


@pytest.mark.parametrize("features", [1, 2, 5])
def test_cover_keeps_the_count_and_draws_nothing_twice(features):
    points = np.random.default_rng(2).normal(size=(3000, features))
    kept = cover(points, 700, np.random.default_rng(3))
    assert len(kept) == 700
    assert np.all(np.diff(kept) > 0)
    np.testing.assert_array_equal(kept, cover(points, 700, np.random.default_rng(3)))


def test_cover_keeps_rare_corners():
    """20,000 points in the middle, one in each far corner: a fair draw of 500 would lose them."""
    rng = np.random.default_rng(4)
    corners = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) * 10.0
    points = np.concatenate([rng.normal(size=(10_000, 2)), corners, rng.normal(size=(10_000, 2))])
    for seed in range(10):  # by chance all four stay in with probability (500 / 20,000)^4
        kept = cover(points, 500, np.random.default_rng(seed))
        assert set(range(10_000, 10_004)) <= set(kept)
        assert len(kept) == 500


def test_cover_keeps_the_weighting_of_the_log():
    """Nine points in ten stand at rest: most of what is kept does too."""
    rng = np.random.default_rng(5)
    points = np.where(rng.random(20_000) < 0.9, 0.0, rng.uniform(-1, 1, 20_000))[:, None]
    kept = cover(points, 1000, np.random.default_rng(6))
    share = np.mean(points[kept] == 0)
    # 100 cells claim a point each, the other 900 are a fair draw (sd 1 %): 0.81 to 0.84 or so
    assert 0.76 < share < 0.9


def test_cover_of_a_constant_feature():
    points = np.stack([np.linspace(0, 1, 2000), np.full(2000, 3.0)], axis=1)
    kept = cover(points, 200, np.random.default_rng(7))
    assert len(kept) == 200
    assert points[kept, 0].max() - points[kept, 0].min() > 0.7  # both ends' cells: 2 of 4 bins
