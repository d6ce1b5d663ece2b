"""Validation: against closed forms, hand arithmetic and simulated signals of known statistics."""

import json

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm

from faultgauge.identification.samples import Samples
from faultgauge.identification.validation.band import free_run_band, given_band
from faultgauge.identification.validation.correlation import (
    correlation,
    input_test,
    integrated_time,
    residual_test,
)
from faultgauge.identification.validation.evaluation import Prediction
from faultgauge.identification.validation.operating import profile, quantile_bins
from faultgauge.identification.validation.ranges import argument_ranges
from faultgauge.identification.validation.seeds import seed_spread
from faultgauge.identification.validation.validate import validate
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant

DRIVE = """
name = "drive"
[states.q]
unit = "m"
derivative = "v"
[states.v]
unit = "m/s"
derivative = "(u - NN(abs(v), d(q)*u))/M + PP(q - NN(v, u))"
[inputs.u]
unit = "N"
[outputs.q]
unit = "m"
value = "q"
[outputs.power]
unit = "W"
value = "u*v"
[networks.NN]
hidden = 2
[networks.PP]
hidden = 2
[parameters]
M = {value = 2, unit = "kg", fixed = true}
"""
STEP = 0.01


def drive():
    return GrayBoxPlant.untrained(parse_plant(DRIVE, "drive.toml"))


def ar1(phi, count, rng):
    """x(t) = phi x(t - 1) + white noise, in its stationary state."""
    return lfilter([1.0], [1.0, -phi], rng.standard_normal(count + 1000))[1000:]


def prediction(errors, u, run="a", warmup=0, x=None, power=None):
    """A free run of the drive that is off by `errors` in q and by `power` in power."""
    count = len(errors)
    t = STEP * np.arange(count)
    x = np.stack([np.sin(t), np.cos(t)], axis=1) if x is None else x
    predicted = np.stack([x[:, 0], u * x[:, 1]], axis=1)
    off = np.stack([errors, np.full(count, np.nan) if power is None else power], axis=1)
    return Prediction(run, t, predicted + off, predicted, x, warmup, u[:, None])


def training(count=500, seed=0):
    rng = np.random.default_rng(seed)
    x, u = rng.uniform(-1, 1, (count, 2)), rng.uniform(-1, 1, (count, 1))
    return Samples(x, u, np.stack([x[:, 1], u[:, 0] / 2], 1), np.full((count, 2), np.nan))


def test_correlation_is_the_sum_over_pairs_of_every_stretch():
    rng = np.random.default_rng(0)
    a, b = ([rng.standard_normal(n) for n in (7, 12)] for _ in range(2))
    found = correlation(a, b)
    one, other = np.concatenate(a), np.concatenate(b)
    for k in range(-11, 12):
        total = sum(
            (x[t + k] - one.mean()) * (y[t] - other.mean())
            for x, y in zip(a, b, strict=True)
            for t in range(len(x))
            if 0 <= t + k < len(x)
        )
        # rounding of a short FFT
        assert found[11 + k] == pytest.approx(total / (19 * one.std() * other.std()), abs=1e-13)


def test_correlation_over_the_pairs_that_were_sampled():
    rng = np.random.default_rng(0)
    a, b = ([rng.standard_normal(n) for n in (7, 12)] for _ in range(2))
    a[0][2] = a[1][0] = a[1][5] = np.nan
    found = correlation(a, b)
    one, other = np.concatenate(a), np.concatenate(b)
    for k in range(-11, 12):
        total = sum(
            (x[t + k] - np.nanmean(one)) * (y[t] - other.mean())
            for x, y in zip(a, b, strict=True)
            for t in range(len(x))
            if 0 <= t + k < len(x) and np.isfinite(x[t + k])
        )
        # rounding of a short FFT
        assert found[11 + k] == pytest.approx(
            total / (16 * np.nanstd(one) * other.std()), abs=1e-13
        )


def test_independent_samples_of_an_ar1_with_empty_cells():
    """n / tau is what gives the mean its variance: that of 400 means, simulated."""
    phi, count, means, claimed = 0.9, 2000, [], []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        e = ar1(phi, count, rng)
        e[rng.random(count) < 0.5] = np.nan
        _, time = residual_test([e], 1.0)
        means.append(np.nanmean(e))
        claimed.append(np.nanvar(e) * time / np.sum(np.isfinite(e)))
    # the sd of a variance of 400 is 7 %; the sum over lags is biased by some percent
    assert np.mean(claimed) == pytest.approx(np.var(means), rel=0.25)


def test_no_correlation_of_a_signal_that_does_not_change():
    assert correlation([np.full(20, 0.1)], [np.arange(20.0)]) is None
    assert residual_test([np.full(20, 0.1)], STEP) == (None, 1.0)
    assert input_test("u", [np.arange(20.0)], [np.full(20, 0.1)], STEP, 1.0) is None


def test_five_percent_of_the_lags_of_white_residuals_are_outside():
    shares, white = [], 0
    for seed in range(100):
        e = np.random.default_rng(seed).standard_normal(1000)
        found, _ = residual_test([e[:600], e[600:]], STEP)
        assert found.bound == pytest.approx(1.96 / np.sqrt(1000), rel=1e-4)  # 1.96 is rounded
        shares.append(found.share_outside)
        white += found.white
    # 100 seeds of 25 lags or more are 2500 trials of 5 %: 3.5 standard deviations are 1.5 %
    assert np.mean(shares) == pytest.approx(0.05, abs=0.015)
    assert white >= 95  # 99 % each: six or more misses have a chance of 5e-4


def test_five_percent_are_outside_where_cells_are_empty():
    """Half of them are: pairs are a quarter, and the bound comes down with the correlation."""
    shares = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        e = rng.standard_normal(2000)
        e[rng.random(2000) < 0.5] = np.nan
        found, _ = residual_test([e[:1500], e[1500:]], STEP)
        # q is a half; the cells that are there scatter by 2 %
        assert found.bound == pytest.approx(1.96 * np.sqrt(0.5 / 1000), rel=0.1)
        shares.append(found.share_outside)
    assert np.mean(shares) == pytest.approx(0.05, abs=0.015)  # as above


@pytest.mark.parametrize("phi", [0.5, 0.9])
def test_autocorrelation_and_integrated_time_of_ar1(phi):
    e = ar1(phi, 200_000, np.random.default_rng(0))
    found, time = residual_test([e], 1.0)
    # Bartlett: var rho(k) < (1 + phi^2) / (1 - phi^2) / N; the largest of 60 lags: 4 of its sd
    sd = np.sqrt((1 + phi**2) / (1 - phi**2) / 200_000)
    np.testing.assert_allclose(found.correlation, phi**found.lags_s, rtol=0, atol=4 * sd)
    assert not found.white
    # the sum of 10 tau lags has a relative error of about sqrt(40 tau / N) = 6 % at phi = 0.9
    assert time == pytest.approx((1 + phi) / (1 - phi), rel=0.12)


def test_integrated_time_of_a_weak_slow_part_and_of_a_swing():
    k = np.arange(5000)
    slow = np.where(k == 0, 1.0, 0.05 * np.exp(-k / 100))
    # 1 + 2 * 0.05 sum_{k > 0} exp(-k / 100)
    assert integrated_time(slow) == pytest.approx(1 + 0.1 / (np.exp(0.01) - 1), rel=1e-6)
    # up to a quarter of the period of 200: 1 + 2 sum cos = sin(50.5 w) / sin(w / 2), +- a pair
    assert integrated_time(np.cos(2 * np.pi * k / 200)) == pytest.approx(200 / np.pi, rel=0.01)
    assert integrated_time(np.r_[1.0, -0.9, 0.8, -0.7]) == 1.0


@pytest.mark.parametrize(("phi_e", "phi_u"), [(0.9, 0.9), (0.95, 0.98)])
def test_bound_of_the_cross_correlation_of_independent_coloured_signals(phi_e, phi_u):
    """Both are AR(1): 1.96 / sqrt(N) fails by far, Bartlett's bound holds 95 %."""
    plain, held, dependent, count = [], [], 0, 3000
    for seed in range(100):
        rng = np.random.default_rng(seed)
        e, u = ar1(phi_e, count, rng), ar1(phi_u, count, rng)
        _, time = residual_test([e], STEP)
        found = input_test("u", [e], [u], STEP, time)
        plain.append(np.mean(np.abs(found.correlation) > 1.96 / np.sqrt(count)))
        held.append(np.mean(np.abs(found.correlation) > found.bound))
        dependent += found.dependent or found.feedback
    assert np.mean(plain) > 0.4
    # about 12 independent lags per seed: 1200 trials, 3.5 sd = 2.2 %; the sums are estimates, +1 %
    assert np.mean(held) == pytest.approx(0.05, abs=0.032)
    assert dependent <= 8  # both sides 1 % each; nine or more of 100 at 2 % have a chance of 3e-4


def test_bound_of_the_cross_correlation_in_closed_form():
    rng = np.random.default_rng(0)
    e, u = ar1(0.8, 200_000, rng), ar1(0.7, 200_000, rng)
    found = input_test("u", [e], [u], STEP, 9.0)
    # sum_j (0.8 * 0.7)^|j| = (1 + 0.56) / (1 - 0.56)
    sd = np.sqrt(1.56 / 0.44 / 200_000)
    assert found.bound == pytest.approx(norm.isf(0.025) * sd, rel=0.05)  # both rho are estimates


def test_the_side_of_the_lags_tells_missing_dynamics_from_feedback():
    rng = np.random.default_rng(0)
    u, noise = rng.standard_normal(2000), rng.standard_normal(2000)
    follows = input_test("u", [0.3 * np.roll(u, 3) + noise], [u], STEP, 1.0)
    assert (follows.dependent, follows.feedback) == (True, False)
    assert follows.peak_lag_s == pytest.approx(3 * STEP, rel=1e-12)
    # r = 0.3 / sqrt(1.09); its standard deviation is 1 / sqrt(2000) = 0.022
    assert follows.peak == pytest.approx(0.3 / np.sqrt(1.09), abs=0.07)
    leads = input_test("u", [noise], [u - 0.5 * np.roll(noise, 2)], STEP, 1.0)
    assert (leads.dependent, leads.feedback) == (False, True)


def test_band_of_independent_errors():
    rng = np.random.default_rng(0)
    errors = [rng.uniform(-1, 1, 4000) for _ in range(5)]
    found = free_run_band([np.linspace(0, 10, 4000)] * 5, errors, 1.0)
    # 95 % of |e| below 0.95 in each of 12 bins of 1667: sd 0.0053, 4 of them
    np.testing.assert_allclose(found.half_width, 0.95, atol=0.022)
    assert len(found.half_width) == 12
    assert (found.level, found.holds) == (0.95, True)
    assert found.share_inside == pytest.approx(0.95, abs=0.01)  # 20,000 samples: 6 sd


def test_band_grows_with_an_error_that_drifts():
    t = np.linspace(0, 10, 1000)
    errors = [t * rate for rate in (-1.0, -0.5, 0.5, 1.0)]
    found = free_run_band([t] * 4, errors, 10.0)
    assert len(found.half_width) == 10  # 4000 samples are worth 400, 40 a bin
    # |e| at the end of bin k is k + 1 for two of four runs, so its 95 % is in the last tenth
    np.testing.assert_allclose(found.half_width, np.arange(1.0, 11.0), atol=0.15)


def test_band_promises_no_more_than_its_samples_allow():
    t, e = np.linspace(0, 1, 400), np.random.default_rng(0).standard_normal(400)
    found = free_run_band([t], [e], 100.0)
    assert found.level == pytest.approx(4 / 5, rel=1e-12)  # four independent ones: n / (n + 1)
    assert found.half_width == pytest.approx(np.abs(e).max(), rel=1e-12)
    assert found.held_against == "the other half of the run"


def test_band_of_errors_with_memory_covers_new_ones():
    """|e| < w holds with erf(w / sqrt(2)) for a unit normal e, whatever its memory."""
    covered = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        errors = [np.sqrt(1 - 0.9**2) * ar1(0.9, 1000, rng) for _ in range(5)]
        _, time = residual_test([np.abs(e) for e in errors], STEP)
        found = free_run_band([np.arange(1000.0)] * 5, errors, time)
        covered.append(np.mean(1 - 2 * norm.sf(found.half_width)))
        assert found.holds
    # not below the promise; above it by the conformal 1 / (n + 1), n = 50 a bin, and some caution
    assert 0.95 <= np.mean(covered) <= 0.985


def test_a_run_unlike_the_others_breaks_the_band():
    rng, t = np.random.default_rng(0), np.linspace(0, 1, 300)
    errors = [rng.uniform(-1, 1, 300) for _ in range(2)] + [np.full(300, 5.0)]
    found = free_run_band([t] * 3, errors, 1.0)
    assert found.worst == 0.0
    assert found.share_inside == pytest.approx(2 / 3, rel=1e-12)  # its own band holds the others
    assert not found.holds


def test_given_band_by_hand():
    e = np.r_[np.zeros(60), np.full(40, 2.0)]
    found = given_band([np.arange(50.0), np.arange(50.0)], [e[:50], e[50:]], 1.0, 1.0)
    assert (found.share_inside, found.worst, found.holds) == (0.6, 0.2, False)
    assert found.independent == 100.0
    # Wilson's interval of 60 out of 100
    middle, z2 = 0.6, norm.isf(0.025) ** 2
    half = np.sqrt(z2 * (0.24 / 100 + z2 / 40_000))
    assert found.low == pytest.approx((middle + z2 / 200 - half) / (1 + z2 / 100), rel=1e-12)


def test_quantile_bins_by_hand():
    x = np.array([5.0, 1.0, 2.0, 8.0, 3.0, 4.0, 7.0, 6.0])
    np.testing.assert_array_equal(quantile_bins(x, 4), [2, 0, 0, 3, 1, 1, 3, 2])
    np.testing.assert_array_equal(quantile_bins(np.array([0.0, 5, 5, -5]), 4), [1, 2, 2, 0])


def test_profile_by_hand():
    x = np.repeat([0.0, 1.0], 10)
    e = np.r_[np.tile([1.0, -1.0], 5), np.tile([4.0, 2.0], 5)]
    found = profile("x", "m", x, e, 2.0)
    np.testing.assert_array_equal(
        [found.low, found.high, found.samples], [[0, 1], [0, 1], [10] * 2]
    )
    np.testing.assert_allclose(found.mean, [0.0, 3.0], atol=1e-15)
    np.testing.assert_allclose(found.rms, [1.0, np.sqrt(10.0)], rtol=1e-15)
    np.testing.assert_allclose(found.mean_sd, np.sqrt(2 / 10), rtol=1e-15)
    assert found.explained == pytest.approx(1.5**2 / (1.5**2 + 1), rel=1e-14)
    # chi-square with one degree of freedom is a normal variable's square
    assert found.by_chance == pytest.approx(norm.isf(0.025) ** 2 * 2 / 20, rel=1e-9)


def test_profiles_of_an_independent_error_stay_below_chance():
    beyond = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        found = profile("x", "", rng.standard_normal(500), rng.standard_normal(500), 1.0)
        beyond += found.explained > found.by_chance
    assert beyond == pytest.approx(10, abs=11)  # 5 % of 200, 3.5 sd


def test_ranges_of_every_network_argument_by_hand():
    plant = drive()
    x = np.array([[0.0, -1.0], [1.0, 2.0], [0.5, 0.5]])
    u, dx = np.array([[1.0], [-1.0], [2.0]]), np.array([[-1.0, 0.0], [2.0, 0.0], [0.5, 0.0]])
    seen = Samples(x, u, dx, np.full((3, 2), np.nan))
    unseen_x = np.array([[9.0, 9.0], [0.5, -3.0], [2.0, 0.0], [1.0, 1.0], [0.0, 2.0]])
    unseen = prediction(np.zeros(5), np.array([9.0, 1.0, -2.0, 2.0, 1.0]), warmup=1, x=unseen_x)
    found = {(r.where, r.name): r for r in argument_ranges(plant, seen, [unseen])}
    # NN stands twice: (abs(v), d(q)*u) and (v, u); each place has one range over both
    first, second = found["NN", "abs(v) and v"], found["NN", "d(q)*u and u"]
    assert (first.unit, first.training, first.unseen) == ("m/s", (-1.0, 2.0), (-3.0, 3.0))
    # abs(v): 3, 0, 1, 2 and v: -3, 0, 1, 2 against -1 to 2
    assert (first.share_outside, first.beyond) == (2 / 8, 2 / 3)
    # d(q)*u: -1, -2, 1 and u: 1, -1, 2; unseen d(q) = v: -3, 0, 2, 2 and u: 1, -2, 2, 1
    assert (second.training, second.unseen) == ((-2.0, 2.0), (-3.0, 2.0))
    assert (second.share_outside, second.unit) == (1 / 8, "")
    # the networks are untrained, so PP's argument is q itself
    nested = found["PP", "q - NN(v, u)"]
    assert (nested.training, nested.unseen) == ((0.0, 1.0), (0.0, 2.0))
    assert found["state", "q"].share_outside == 1 / 4
    assert found["input", "u"].share_outside == 1 / 4


def test_spread_over_starts_by_hand():
    measured = np.zeros(4)
    runs = [np.array([1.0, 1, 1, 1]), np.array([3.0, 3, 3, 3]), np.full(4, np.inf)]
    found = seed_spread(measured, runs)
    np.testing.assert_array_equal(found.rmse, [1.0, 3.0, np.nan])
    assert found.spread == pytest.approx(np.sqrt(2), rel=1e-15)  # of 1 and 3
    assert found.explained == pytest.approx(1 / 5, rel=1e-15)  # mean square 5 = 2^2 + 1
    assert seed_spread(measured, runs[1:]) is None


def test_validate_finds_what_was_put_in():
    rng = np.random.default_rng(0)
    u = [rng.standard_normal(1500) for _ in range(4)]
    e = [0.02 * rng.standard_normal(1500) + 0.005 * np.roll(each, 4) + 0.01 for each in u]
    runs = [prediction(a, b, warmup=50) for a, b in zip(e, u, strict=True)]
    found = validate(drive(), runs, training(), others=[runs])
    (output,) = found.outputs  # power has no telemetry
    assert (output.name, output.samples, output.stretches) == ("q", 5800, 4)
    assert output.bias == pytest.approx(0.01, abs=2 * output.bias_95)
    assert output.inputs[0].dependent
    assert output.inputs[0].peak_lag_s == pytest.approx(4 * STEP, rel=1e-12)
    assert [each.name for each in output.profiles] == ["q", "v", "u"]
    assert output.seeds.spread == 0.0
    text = json.dumps(found.to_dict(), allow_nan=False)
    assert json.loads(text)["outputs"][0]["residual"]["white"] is output.residual.white


def test_validate_where_nothing_can_be_tested():
    u = np.linspace(-1, 1, 200)
    blown = prediction(np.sin(u), u, power=np.zeros(200))
    blown.predicted[100:, 1] = np.inf
    runs = [blown, prediction(np.sin(u), u)]
    q, power = validate(drive(), runs, training(), band={"q": 2.0}).outputs
    assert (q.band.held_against, q.band.share_inside) == ("other data", 1.0)
    assert (power.diverges, power.stretches, power.rmse) == (True, 1, None)
    short = validate(drive(), [prediction(np.sin(u[:19]), u[:19])], training())
    assert (short.outputs[0].samples, short.outputs[0].band) == (19, None)
    json.dumps(short.to_dict(), allow_nan=False)


def test_stretches_sampled_at_another_rate_are_left_out_of_the_lags():
    rng = np.random.default_rng(0)
    usual = prediction(rng.standard_normal(2000), rng.standard_normal(2000))
    slow = prediction(np.tile([9.0, -9.0], 200), np.tile([1.0, -1.0], 200))
    slow = slow._replace(t=10 * slow.t)
    (output,) = validate(drive(), [slow, usual], training()).outputs
    assert output.samples == 2400
    assert output.residual.bound == pytest.approx(norm.isf(0.025) / np.sqrt(2000), rel=1e-12)
    assert output.residual.lags_s[0] == pytest.approx(STEP, rel=1e-12)


def test_empty_cells_are_not_tested_and_do_not_split():
    """A tenth of the cells is empty: the tests are of the rest, in one stretch."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal(3000)
    e = 0.02 * rng.standard_normal(3000) + 0.01 * np.roll(u, 4) + 0.01
    empty = rng.random(3000) < 0.1
    run = prediction(np.where(empty, np.nan, e), u, warmup=50)
    other = run._replace(predicted=run.predicted + 0.01)
    (found,) = validate(drive(), [run], training(), others=[[other]]).outputs
    kept = e[50:][~empty[50:]]
    assert (found.samples, found.stretches, found.diverges) == (len(kept), 1, False)
    assert found.rmse == pytest.approx(np.sqrt(np.mean(kept**2)), rel=1e-12)
    assert found.bias == pytest.approx(kept.mean(), rel=1e-12)
    assert found.inputs[0].peak_lag_s == pytest.approx(4 * STEP, rel=1e-12)
    # 0.01 / sqrt(0.02^2 + 0.01^2); its standard deviation is 1 / sqrt(2655) = 0.019
    assert found.inputs[0].peak == pytest.approx(0.447, abs=0.07)
    # a tenth less of the pairs; how many of them by chance: 1 / sqrt(25 * 2950 * 0.8) of it
    bound = norm.isf(0.025) * np.sqrt(0.9 / len(kept))
    assert found.residual.bound == pytest.approx(bound, rel=0.01)
    assert sum(found.profiles[0].samples) == len(kept)
    assert found.seeds.spread == pytest.approx(0.01 / np.sqrt(2), rel=1e-9)  # two, 0.01 apart
    assert 0.9 < found.band.share_inside < 0.99


def test_a_sensor_slower_than_the_log_has_lags_of_its_own():
    """Every tenth row is an AR(1) sample: its memory is (1 + phi) / (1 - phi) of its own steps."""
    rng = np.random.default_rng(0)
    e = np.full(100_000, np.nan)
    e[3::10] = ar1(0.5, 10_000, rng)
    (found,) = validate(drive(), [prediction(e, rng.standard_normal(len(e)))], training()).outputs
    assert found.samples == 10_000
    assert found.residual.lags_s[0] == pytest.approx(10 * STEP, rel=1e-9)
    assert found.residual.correlation[0] == pytest.approx(0.5, abs=0.04)  # 4 sd of 1 / sqrt(10,000)
    assert found.time_s == pytest.approx(3 * 10 * STEP, rel=0.15)
    assert found.independent == pytest.approx(10_000 / 3, rel=0.15)
