"""Figures of merit against hand arithmetic and SciPy."""

import numpy as np
import pytest
from scipy.stats import binomtest, poisson

from faultgauge_studies import merit

T = np.arange(0.0, 10.0, 0.5)
TRUTH = np.where(T >= 2.0, 1.0, 0.0) + np.where(T >= 6.0, 1.0, 0.0)
EDGES = merit.edges_of(TRUTH)


def test_edges_and_settled_samples():
    assert T[EDGES].tolist() == [2.0, 6.0]
    scored = merit.settled(T, EDGES, 1.0)
    assert T[scored].tolist() == [1.0, 1.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 7.0, 7.5, 8.0, 8.5, 9.0,
                                  9.5]  # fmt: skip


def test_settling_overshoot_and_error():
    f = TRUTH.copy()
    f[4], f[5], f[6] = 0.0, 1.2, 0.97  # 2.0 s, 2.5 s, 3.0 s: inside 5 % from 3.0 s on
    f[-1] = 1.9  # and 10 % off at the very end of the second level
    assert merit.settling_times(T, f, TRUTH, EDGES).tolist() == [1.0, np.inf]
    assert merit.overshoots(T, f, TRUTH, EDGES, 2.0) == pytest.approx([0.2, 0.0])
    assert merit.rmse(f, TRUTH, np.arange(len(T)) == 5) == pytest.approx(0.2)


def test_alarms_are_stretches_and_a_delay_is_to_the_first_naming_after_the_onset():
    assert merit.alarms(["HEALTHY", "FAULT", "FAULT", "NOT_JUDGED", "FAULT"]) == 2
    assert merit.found_after([1.0, 7.5, 9.0], 7.0) == pytest.approx(0.5)
    assert merit.found_after([1.0], 7.0) == np.inf


def test_every_settled_sample_of_a_stretch_must_be_right():
    status = ["FAULT" if d else "HEALTHY" for d in TRUTH]
    status[10] = "NOT_JUDGED"
    everything = np.ones(len(T), bool)
    assert merit.intervals_right(status, TRUTH, EDGES, everything).tolist() == [True, False, True]


@pytest.mark.parametrize("count", [0, 3, 17])
def test_the_interval_of_a_rate_has_its_tails(count):
    rate = merit.alarm_rate(count, 2.0)
    assert poisson.cdf(count, 2.0 * rate.hi) == pytest.approx(0.025)
    if count:
        assert poisson.sf(count - 1, 2.0 * rate.lo) == pytest.approx(0.025)
    else:
        assert rate.lo == 0.0


@pytest.mark.parametrize("hits", [0, 5, 8])
def test_the_interval_of_a_share_is_scipys(hits):
    found = merit.share([True] * hits + [False] * (8 - hits))
    expected = binomtest(hits, 8).proportion_ci(method="exact")
    assert (found.lo, found.hi) == pytest.approx((expected.low, expected.high))


def test_a_mean_over_runs_weighs_them_and_its_interval_is_of_runs():
    rng = np.random.default_rng(3)
    x = rng.normal(2.0, 1.0, 200)
    found = merit.mean_of_runs(x)
    half = 1.96 * x.std(ddof=1) / np.sqrt(200)
    assert (found.lo, found.hi) == pytest.approx((x.mean() - half, x.mean() + half), abs=0.03)
    assert merit.mean_of_runs(np.array([1.0, 3.0, np.nan]), np.array([3.0, 1.0, 9.0])).value == 1.5


def test_coverage_names_and_sets():
    lo, hi = TRUTH - 0.1, TRUTH + 0.1
    hi[0] = -0.05
    assert merit.coverage(lo, hi, TRUTH, T < 2.0) == pytest.approx(0.75)
    assert np.isnan(merit.coverage(lo, hi, TRUTH, T < -1.0))
    assert merit.exact_set(["a", "b"], {"b", "a"})
    assert not merit.exact_set(["a"], ["a", "b"])
    assert merit.wrong_names(["a", "c"], ["a"])
