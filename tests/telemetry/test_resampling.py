"""Uniform grids, lower rates, and points that cover the envelope."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import firwin, kaiser_beta, resample_poly

from faultgauge.errors import InputError
from faultgauge.telemetry import Run, read_telemetry, resampled, segments
from faultgauge.telemetry.dead_time import delayed
from faultgauge.telemetry.rates import align
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


def recording(t, **columns):
    return Run("log", "log.csv", t, columns)


MIDDLE = slice(3, -3)  # rows that the filter, five or six either side, sees whole


@pytest.mark.parametrize("rate", [20.0, 17.3])
@pytest.mark.parametrize("share", [0.69, 0.8, 1.0, 4.9])
def test_a_sine_above_it_is_gone(rate, share):
    t = np.arange(5001) / 1000
    y = np.sin(2 * np.pi * share * 1.02 * rate * t + 0.3)
    run = resampled(recording(t, y=y), rate)
    assert np.abs(run.columns["y"][MIDDLE]).max() < 1e-3  # 65 dB are 0.6e-3


@pytest.mark.parametrize("rate", [20.0, 17.3])
@pytest.mark.parametrize("share", [0.01, 0.1, 0.3])
def test_a_sine_below_the_new_nyquist_frequency_stays_and_is_not_late(rate, share):
    t = np.arange(5001) / 1000
    run = resampled(recording(t, y=np.sin(2 * np.pi * share * rate * t + 0.3)), rate)
    truth = np.sin(2 * np.pi * share * rate * run.t + 0.3)
    # the ripple of 65 dB is 0.6e-3, and the weights are scaled to let a constant pass
    np.testing.assert_allclose(run.columns["y"][MIDDLE], truth[MIDDLE], atol=1.2e-3)


def test_a_lower_rate_against_scipy():
    """The filter of `scipy.signal.resample_poly`, cut off at the same frequency, on noise."""
    y = np.random.default_rng(0).standard_normal(6001)
    # 5 rows either side
    window = firwin(201, 1.0 / 20, window=("kaiser", kaiser_beta(65.0)))  # pyright: ignore
    theirs = resample_poly(y, 1, 20, window=window)
    run = resampled(recording(np.arange(6001) / 400, y=y), 20.0)
    np.testing.assert_allclose(run.t, np.arange(3, 298) / 20, rtol=1e-12)
    # sums of 200 weights; a table of the kernel good to 1e-7
    np.testing.assert_allclose(run.columns["y"][MIDDLE], theirs[3:-3][MIDDLE], atol=1e-6)


def test_a_straight_line_stays_straight_to_its_ends():
    t = np.arange(1000) / 100
    run = resampled(recording(t, y=3 * t - 2), 8.0)
    np.testing.assert_allclose(run.columns["y"], 3 * run.t - 2, atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.7, 1.0, 3.1]))
def test_a_lower_rate_conserves_the_integral_of_a_held_input(seed, rate):
    """What lies within a run at rest at both ends is all there, on an irregular clock, too."""
    t, u = irregular(seed, 400)
    # the filter reaches 5.5 / 0.7 s either way, and three rows at each end are lost
    u[(t < 13) | (t > t[-1] - 14)] = 0.0
    run = resampled(recording(t, u=u), rate, held={"u"})
    # weights of one row add up to 1 within 1e-4 of what the filter lets through at the log's rate
    assert np.sum(run.columns["u"]) / rate == pytest.approx(held_integral(t, u, t[-1]), abs=1e-4)


def test_a_pulse_between_new_samples_is_not_lost():
    t = np.arange(4000) / 1000
    u = np.where((t >= 2.012) & (t < 2.02), 10.0, 0.0)
    run = resampled(recording(t, u=u), 20.0, held={"u"})
    assert np.sum(run.columns["u"]) / 20 == pytest.approx(0.08, rel=1e-9)
    centre = np.sum((run.t + 0.025) * run.columns["u"]) / np.sum(run.columns["u"])
    assert centre == pytest.approx(2.016, abs=1e-6)  # nor moved


def test_what_a_lag_obeys_it_obeys_afterwards():
    """x' = (u - x) / tau in the means over every new interval, wherever u jumps."""
    t, tau = np.arange(8000) / 1000, 0.4
    u = np.repeat(np.random.default_rng(0).choice([-1.0, 1.0], 8000 // 37 + 1), 37)[:8000]
    x, decay = np.zeros(8000), np.exp(-0.001 / tau)
    for k in range(7999):
        x[k + 1] = decay * x[k] + (1 - decay) * u[k]
    run = resampled(recording(t, x=x, m=x, u=u), 20.0, held={"u"}, averaged={"m"})
    columns = {name: values[MIDDLE] for name, values in run.columns.items()}
    rise = np.diff(columns["x"]) * 20
    told = (columns["u"] - columns["m"])[:-1] / tau
    # x is sampled half a fine step before the middle of its own: 1.25e-3 of u / tau
    np.testing.assert_allclose(rise, told, atol=5e-3)
    assert np.ptp(told) > 3


def test_an_empty_cell_is_bridged_and_goes_no_further():
    t = np.arange(4001) / 1000
    y = np.sin(2 * np.pi * 0.5 * t)
    u = np.where(t < 2, 1.0, 3.0)
    y[1234] = u[1500] = np.nan
    run = resampled(recording(t, y=y, u=u), 20.0, held={"u"})
    # between its neighbours y is straight within (0.5 * 2 pi)^2 / 8 * 0.002^2 = 5e-6
    np.testing.assert_allclose(run.columns["y"][MIDDLE], np.sin(np.pi * run.t)[MIDDLE], atol=1e-3)
    level = np.abs(run.t - 2) > 0.3  # six rows off the step
    expected = np.where(run.t < 2, 1.0, 3.0)
    np.testing.assert_allclose(run.columns["u"][level], expected[level], rtol=1e-12)


def test_a_hole_in_a_column_is_a_hole_afterwards():
    t = np.arange(4001) / 1000
    y, u, v = np.ones(4001), np.ones(4001), np.ones(4001)
    y[1000:1300] = np.nan
    y[1300:] = 5.0  # what comes after it must not be seen before it
    u[2010:2020] = np.nan
    run = resampled(recording(t, y=y, u=u, v=v), 20.0, held={"u"})
    # three rows of 0.05 s from its ends, 0.999 and 1.3 s
    expected = np.where(run.t < 1, 1.0, 5.0)
    expected[(run.t > 0.8491) & (run.t < 1.4499)] = np.nan
    np.testing.assert_allclose(run.columns["y"], expected, rtol=1e-12)
    lost = (run.t > 1.8591) & (run.t < 2.1699)
    np.testing.assert_array_equal(np.isnan(run.columns["u"]), lost)
    assert np.isfinite(run.columns["v"]).all()


@pytest.mark.parametrize("length", [0.01, 0.12, 30.0])
def test_a_gap_in_time_splits_whatever_its_length(length):
    """Shorter than a new interval, of a few of them, and long."""
    t = np.concatenate([np.arange(1010) / 1000, 1.009 + length + np.arange(1000) / 1000])
    y = np.where(np.arange(2010) < 1010, 1.0, 5.0)
    run = resampled(recording(t, y=y, u=y), 20.0, held={"u"})
    first, second = segments(run, ["y", "u"])
    for name in ("y", "u"):
        np.testing.assert_allclose(run.columns[name][first], 1.0, rtol=1e-12)
        np.testing.assert_allclose(run.columns[name][second], 5.0, rtol=1e-12)
    assert run.t[first][-1] == pytest.approx(0.85)
    assert 0.15 <= run.t[second][0] - 1.009 - length < 0.2
    assert len(run.t) < 45  # no row for every interval of a long gap


def test_a_row_that_stands_for_those_left_out_splits():
    t = np.arange(2000) / 1000
    y, u = np.ones(2000), np.ones(2000)
    y[1005:], u[1005:] = 5.0, 5.0
    y[1005] = u[1005] = np.nan  # as --where leaves it
    run = resampled(recording(t, y=y, u=u), 20.0, held={"u"})
    first, second = segments(run, ["y", "u"])
    np.testing.assert_allclose(run.columns["y"][first], 1.0, rtol=1e-12)
    np.testing.assert_allclose(run.columns["y"][second], 5.0, rtol=1e-12)


def test_sensors_that_are_slower_and_faster_than_the_new_rate():
    t = np.arange(4001) / 1000
    columns = {"u": np.sin(t), "slow": np.full(4001, np.nan), "fast": np.full(4001, np.nan)}
    columns["slow"][::400] = t[::400]  # 2.5 Hz
    columns["fast"][::10] = np.sin(2 * np.pi * 40 * t[::10])  # 100 Hz
    aligned = align(t, columns)
    run = resampled(replace(recording(t, **aligned.columns), sampled=aligned.sampled), 20.0)
    np.testing.assert_allclose(run.columns["slow"], run.t, atol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(run.sampled["slow"]), np.arange(5, 75, 8))
    assert "fast" not in run.sampled
    assert np.abs(run.columns["fast"][MIDDLE]).max() < 1e-3  # filtered from its own samples


def test_what_jumps_with_a_held_input_is_averaged_with_it():
    t = np.arange(2000) / 1000
    u = np.where(t < 1.02, 0.0, 1.0)
    run = resampled(recording(t, u=u, a=2 * u), 20.0, held={"u"}, averaged={"a"})
    np.testing.assert_allclose(run.columns["a"], 2 * run.columns["u"], rtol=1e-12)
    # as if it had come at once, at 1.02 s: the rest until the beginning of the first lost row
    until = run.t[-1] + 0.05
    assert np.sum(run.columns["u"]) / 20 == pytest.approx(until - 1.02, rel=1e-9)
    assert run.columns["u"].max() < 1.05  # overshoot of the filter


def test_a_delay_that_is_no_whole_number_of_the_new_steps():
    """Delayed and then averaged, or the other way round."""
    t = np.arange(4000) / 1000
    u = np.sin(2 * np.pi * t)
    late = resampled(recording(t, u=np.sin(2 * np.pi * (t - 0.02))), 20.0, held={"u"})
    run = delayed(resampled(recording(t, u=u), 20.0, held={"u"}), {"u": 0.02}, {"u"})
    # straight between two means: (2 pi 0.05)^2 / 8 = 0.012
    difference = (run.columns["u"] - late.columns["u"])[MIDDLE]
    assert np.abs(difference).max() < 0.013


def test_at_its_own_rate_a_run_stays_as_it_is():
    t = np.arange(100) / 20
    run = resampled(recording(t, y=np.sin(t)), 20.0)
    assert run.t is t
    assert run.resampled == 20.0


def test_rates_that_cannot_be_had(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,y\n" + "".join(f"{k / 100},{k}\n" for k in range(100)))
    for rate in (0.0, -5.0, np.inf, np.nan):
        with pytest.raises(InputError, match=r"--resample .* positive number of hertz"):
            read_telemetry(path, resample=rate)
    with pytest.raises(InputError, match=r"log\.csv.*only 100 samples a second"):
        read_telemetry(path, resample=200.0)
    with pytest.raises(InputError, match=r"lasts 0.99 s .* 7 new intervals are the least"):
        read_telemetry(path, resample=0.5)
    (run,) = read_telemetry(path, resample=200.0, slower="keep")
    assert run.resampled is None
    assert len(run.t) == 100
    (run,) = read_telemetry(path, resample=10.0, slower="keep")
    assert len(run.t) == 4  # three at each end are lost
