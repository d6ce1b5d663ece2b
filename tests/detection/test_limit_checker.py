"""Persistence, hysteresis and latching by hand."""

import jax
import numpy as np
import pytest

from faultgauge.detection.posterior.limit_checker import LimitChecker

T = 0.5 * np.arange(12)
#      t: 0  .5 1  1.5 2  2.5 3  3.5 4  4.5 5  5.5
OVER = "x  .  x  x   x  x   .  .   .  x   x  x"
LOW = " .  x  .  .   .  .   .  x   x  .   .  ."


def flags(text):
    return np.array([each == "x" for each in text.split()])


@pytest.mark.parametrize(
    ("persistence", "latch", "wanted"),
    [
        (0.0, False, "x  .  x  x   x  x   x  .   .  x   x  x"),  # held between the two limits
        (1.0, False, ".  .  .  .   x  x   x  .   .  .   .  x"),  # from the third sample of a run on
        (1.0, True, " .  .  .  .   x  x   x  x   x  x   x  x"),
        (2.0, False, ".  .  .  .   .  .   .  .   .  .   .  ."),  # 1.5 s is the longest
    ],
)
def test_by_hand(persistence, latch, wanted):
    found = judged(T, flags(OVER), flags(LOW), persistence, latch)
    assert found == flags(wanted).tolist()


def judged(t, over, under, persistence, latch):
    checker = LimitChecker(np.asarray(persistence), latch)
    return scan(checker.step, checker.init(), (t, over, under))[1].tolist()


def test_a_persistence_of_whole_samples_is_not_lost_to_rounding():
    over = np.ones(7, bool)
    found = judged(0.1 * np.arange(1, 8), over, ~over, 0.3, False)
    assert found == [False] * 3 + [True] * 4


def test_not_on_end_a_pause_that_is_not_under_is_left_out():
    over, under = flags("x x . . x x x . x x x x"), flags(". . . . . . . x . . . .")
    checker = LimitChecker(np.asarray(1.5), False, on_end=False)
    found = scan(checker.step, checker.init(), (T, over, under))[1].tolist()
    # 3 s since 0 s, less the 1 s of the third and fourth sample; anew from 4 s on, 1.5 s at the end
    assert found == flags(". . . . . x x . . . . x").tolist()


def test_points_are_judged_each_alone():
    over, under = np.stack([flags(OVER), flags(LOW)], 1), np.stack([flags(LOW), flags(OVER)], 1)
    checker = LimitChecker(np.asarray(1.0), False)
    both = scan(checker.step, checker.init(2), (T, over, under))[1]
    for k in range(2):
        assert both[:, k].tolist() == judged(T, over[:, k], under[:, k], 1.0, False)


def scan(step, state, rows):
    return jax.lax.scan(lambda carried, row: step(carried, *row), state, rows)
