"""Sizes and odds as they are said."""

import re
from datetime import datetime
from fractions import Fraction

import numpy as np
import pytest

from faultgauge.detection.words import (
    UNDECLARED,
    Began,
    about,
    amount,
    between,
    duration,
    less_likely,
    likelihoods,
    moment,
    number,
    would_not_show,
)
from faultgauge.telemetry.clock import Clock


@pytest.mark.parametrize(
    ("size", "low", "high", "said"),
    [
        (0.1, 0.0958, 0.1042, "+0.1000 N*m (+0.0958 to +0.1042)"),
        (-0.0288, -0.0576, 0.0, "-0.029 N*m (-0.058 to +0.000)"),
        (300.0, 280.0, 320.0, "+300 N*m (+280 to +320)"),
        (0.0020006, 0.0019937, 0.0020075, "+0.002001 N*m (+0.001994 to +0.002008)"),
        (3.25e-14, 3.1e-14, 3.4e-14, "+3.25e-14 N*m (+3.10e-14 to +3.40e-14)"),
        (3e-8, 2e-8, 4e-8, "+3.0e-08 N*m (+2.0e-08 to +4.0e-08)"),
    ],
)
def test_a_size_is_said_with_its_interval_as_fine_as_that_is(size, low, high, said):
    assert amount(size, low, high, "N*m") == said


def test_a_size_that_changed_is_said_as_fine_as_it_changed():
    assert between(-0.29999, -0.0991, "m/s") == "between -0.30 and -0.10 m/s"
    assert between(2e-8, 4e-8, "1") == "between +2.0e-08 and +4.0e-08"


def test_odds_are_said_as_times():
    assert less_likely(["leak"], 200.4) == "leak is 200 times less likely"
    assert less_likely(["leak", "gauge"], 1000.0) == (
        "leak or gauge is more than 1000 times less likely"
    )
    assert less_likely(["leak"], 1.01) == "leak is as likely"
    assert less_likely(["leak"], 2.214) == "leak is 2.2 times less likely"


def test_causes_of_the_same_odds_are_said_together():
    """The likeliest first; what is undeclared only while it is likely."""
    odds = [("gauge", 5000.0), ("pump", 1000.0), ("leak", 30.0), (UNDECLARED, 25.0)]
    assert likelihoods(odds) == [
        "leak is 30 times less likely",
        "pump or gauge is more than 1000 times less likely",
    ]
    assert likelihoods([(UNDECLARED, 12.34)]) == [f"{UNDECLARED} is only 12 times less likely"]


def test_what_would_not_have_shown():
    some = {"leak": (0.0123, "m/s"), "gauge": (None, "m"), "weak": (150.0, "")}
    assert would_not_show(some) == (
        "leak below 0.012 m/s and weak below 150 would not have shown, nor would gauge of any "
        "size to be expected"
    )
    assert would_not_show({"leak": (None, "m/s")}) == (
        "leak of any size to be expected would not have shown"
    )


def test_times_are_as_fine_as_rows_are_apart():
    assert moment(None, 332.48991, 0.01) == "332.489 s"  # never later than it was
    assert moment(None, 0.2179931, 0.000999) == moment(None, 0.2179931, 0.001) == "0.2179 s"
    assert moment(None, 1_234_567.5, 0.5) == "1234567.5 s"
    assert Began(None, 400.0, 270.0, 530.0).since() == "since 400 s +- 130 s"
    noon = Clock(datetime(2026, 5, 1, 12))
    assert Began(noon, 400.0, 377.0, 423.0).since() == "since 12:06:40 +- 23 s"
    assert Began(noon, 4000.0, 3688.0, 4312.0).since() == "since 13:06:40 +- 5.2 min"
    assert Began(noon, 7300.0, 1900.0, 12700.0).since() == "since 14:02 +- 1.5 h"
    day = 86400.0
    assert Began(noon, day, day - 60, day + 60).cell() == (
        "2026-05-02 12:00:00 (11:59:00 to 12:01:00)"
    )
    assert Began(noon, day / 2 + 5, day / 2 - 90, day / 2 + 20).since() == (
        "since 2026-05-02 00:00:05 (23:58:30 to 2026-05-02 00:00:20)"
    )


def test_a_clock_within_a_second_is_as_fine_as_seconds_are():
    morning = Clock(datetime(2026, 5, 1, 8, 40))
    t = 359.947  # 08:45:59.947
    onset = Began(morning, t, t - 0.7, t + 0.7)
    assert onset.since() == "since 08:45:59.95 +- 0.7 s"
    assert onset.cell() == "08:45:59.95 (08:45:59.25 to 08:46:00.65)"
    assert onset._replace(told=359.948).since() == "since 08:45:59.94 +- 0.7 s"
    assert onset._replace(low=t - 0.002, high=t + 0.05).since() == (
        "since 08:45:59.947 (08:45:59.945 to 08:45:59.997)"
    )
    assert moment(morning, t, 0.1) == "08:45:59.94"  # never later than it was
    assert moment(morning, 359.9, 0.1) == "08:45:59.9"
    assert moment(morning, t) == "08:45:59.947"
    assert moment(morning, 360.0, 0.1) == "08:46:00"
    assert about(morning, 359.996, 0.5) == "08:46:00"


def test_an_onset_is_rounded_to_the_nearest_and_never_behind_what_was_told():
    assert Began(None, 19.99, 4.6, 34.9).since() == "since 20 s +- 15 s"
    assert Began(None, 19.99, 4.6, 34.9, told=19.995).since() == "since 19 s +- 15 s"
    assert Began(None, 19.0, 3.0, 19.99).or_earlier() == "20 s or earlier"
    assert Began(None, 9.0, 9.0, 10.4).cell() == "9 s (9 s to 10.4 s)"
    noon = Clock(datetime(2026, 5, 1, 12, 0, 40))
    late = Began(noon, 40.7, 10.7, 70.7, told=100.0)
    assert late.since() == "since 12:01:21 +- 30 s"
    assert late._replace(told=40.8).since() == "since 12:01:20 +- 30 s"
    hours = Began(noon, 55.0, -5000.0, 5110.0)
    assert hours.since() == "since 12:02 +- 1.4 h"
    assert hours._replace(told=60.0).since() == "since 12:01 +- 1.4 h"
    # what it shows as it is put back, and not 03:00
    back = Clock(datetime(2026, 10, 25, 2, 59, 58), ((2.0, -3600.0),))
    assert Began(back, 1.6, -3.4, 6.6).since() == "since 02:00:00 (winter time) +- 5 s"


def test_a_time_between_rows_is_said_alike_by_the_one_that_ends_there_and_the_one_that_begins():
    t = 300.2499
    assert about(None, t, 0.5) == "300.25 s"
    assert Began(None, t, 300.0, 300.5).since() == "since 300.25 s +- 0.25 s"
    assert moment(None, t, 0.5) == "300.24 s"


def test_a_rounded_onset_is_the_nearest_of_all_that_could_be_said_by_then():
    """Against a search over the times of the last figure, in exact fractions."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        low, t, high, told = np.sort(rng.uniform(0.0, 100.0, 4)).tolist()
        at, first, last = (
            Fraction(each.removesuffix(" s"))
            for each in re.findall(r"[\d.]+ s", Began(None, t, low, high, told, 0.5).cell())
        )
        half = max((high - low) / 2, 0.5)
        # two figures of half, where 9.8 is 10
        unit = Fraction(10) ** -(0 if half > 9.772 else 1 if half > 0.9772 else 2)
        sayable = [k * unit for k in range(int(Fraction(told) / unit) + 1)]
        assert at == min(sayable, key=lambda each: abs(each - Fraction(t)))
        assert first <= at <= last <= told


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(0.012, "0.012 s"), (98.0, "98 s"), (99.7, "1.7 min"), (5400.0, "1.5 h"), (3e5, "3.5 days")],
)
def test_how_long_is_said_in_the_unit_in_which_it_is_a_small_number(seconds, said):
    assert duration(seconds) == said


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (518.2, "520"),
        (0.00026, "0.00026"),
        (3.21e-6, "3.2e-06"),
        (1.2e7, "1.2e+07"),
        (-1590.0, "-1600"),
    ],
)
def test_numbers_are_plain_unless_they_are_very_small_or_large(value, said):
    assert number(value, 2) == said
