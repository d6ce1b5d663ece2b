"""Intervals and interpolation against closed forms and arithmetic by hand."""

import math

import numpy as np
import pytest

from faultgauge.rehearsal.shares import over_runs, poisson, smallest_found, wilson

Z2 = 3.841458820694124  # the 0.95 quantile of chi-square with one degree of freedom


def test_wilson_at_the_ends_is_z2_over_n_plus_z2():
    none, every = wilson(0, 10), wilson(10, 10)
    assert (none.lo, none.hi) == (0.0, pytest.approx(Z2 / (10 + Z2)))
    assert (every.lo, every.hi) == (pytest.approx(10 / (10 + Z2)), 1.0)


def test_wilson_ends_solve_the_score_equation():
    """|p - P| = z sqrt(P (1 - P) / n) at both ends P."""
    found = wilson(9, 10)
    for end in (found.lo, found.hi):
        assert (0.9 - end) ** 2 == pytest.approx(Z2 * end * (1 - end) / 10)
    assert found.lo < found.value == 0.9 < found.hi


def test_no_trial_proves_nothing():
    assert (wilson(0, 0).lo, wilson(0, 0).hi) == (0.0, 1.0)
    assert math.isnan(wilson(0, 0).value)


def test_poisson_ends_leave_a_fortieth_on_either_side():
    def at_most(count, mean):
        return sum(math.exp(-mean) * mean**k / math.factorial(k) for k in range(count + 1))

    nothing = poisson(0, 2.0)
    assert (nothing.lo, nothing.hi) == (0.0, pytest.approx(-math.log(0.025) / 2.0))
    some = poisson(3, 2.0)
    assert at_most(3, 2.0 * some.hi) == pytest.approx(0.025)
    assert 1 - at_most(2, 2.0 * some.lo) == pytest.approx(0.025)
    assert some.value == 1.5


def test_the_smallest_size_lies_between_two_by_hand():
    """0.5 at 2, 1 at 4: 0.9 is 0.8 of the way, in the logarithm."""
    found = smallest_found([1.0, 2.0, 4.0], [0, 2, 4], [4, 4, 4])
    assert found is not None
    assert found.size == pytest.approx(2**1.8)
    assert not found.at_most


def test_shares_that_fall_again_are_pooled():
    """1/2 and 0/2 are 1/4 together; the 6 of 6 above them reach 0.9 at 13/15 of the way."""
    found = smallest_found([1.0, 2.0, 8.0], [1, 0, 6], [2, 2, 6])
    assert found is not None
    assert found.size == pytest.approx(2.0 * 4.0 ** ((0.9 - 0.25) / 0.75))


def test_the_smallest_size_beyond_the_grid():
    assert smallest_found([1.0, 2.0], [1, 7], [4, 8]) is None
    assert smallest_found([], [], []) is None
    found = smallest_found([1.0, 2.0], [9, 10], [10, 10])
    assert found is not None
    assert (found.size, found.at_most) == (1.0, True)


def test_intervals_hold_the_truth_about_as_often_as_they_say():
    """Wilson's coverage at p = 0.9, n = 20 is 0.957 by summing the binomial (`expected`)."""
    p, n = 0.9, 20
    held = [k for k in range(n + 1) if wilson(k, n).lo <= p <= wilson(k, n).hi]
    expected = sum(math.comb(n, k) * p**k * (1 - p) ** (n - k) for k in held)
    drawn = np.random.default_rng(0).binomial(n, p, 20_000)
    share = np.mean(np.isin(drawn, held))
    assert share == pytest.approx(expected, abs=0.006)  # four standard deviations
    assert 0.93 < expected < 0.98


def test_drawing_runs_anew_finds_the_interval_of_a_mean():
    """That of 400 normal values is +- 1.96 / 20; its ends are known to a tenth of that."""
    values = np.random.default_rng(1).standard_normal(400)
    lo, hi = over_runs(400, lambda k: values[k].mean(axis=1))
    half = 1.96 * values.std() / 20
    assert lo == pytest.approx(values.mean() - half, abs=0.02)
    assert hi == pytest.approx(values.mean() + half, abs=0.02)
    assert np.isnan(over_runs(0, lambda k: k.mean(axis=1))).all()


def test_what_never_comes_is_an_end_of_an_interval():
    delays = np.array([1.0, 2.0, np.inf, np.inf])
    lo, hi = over_runs(4, lambda k: np.median(delays[k], axis=1))
    assert (lo, hi) == (1.0, np.inf)
