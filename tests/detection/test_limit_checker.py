"""Persistence, hysteresis and latching by hand, all samples at once and one at a time."""

import numpy as np
import pytest

from faultgauge.detection.limit_checker import LimitChecker

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
def test_by_hand_and_in_any_pieces(persistence, latch, wanted):
    over, low = flags(OVER), flags(LOW)
    found = LimitChecker(persistence, latch).judge(T, over, low)
    assert found.tolist() == flags(wanted).tolist()
    for size in (1, 5):
        checker = LimitChecker(persistence, latch)
        pieces = [slice(k, k + size) for k in range(0, len(T), size)]
        parts = [checker.judge(T[p], over[p], low[p]) for p in pieces]
        assert np.concatenate(parts).tolist() == found.tolist()


def test_a_persistence_of_whole_samples_is_not_lost_to_rounding():
    t = 0.1 * np.arange(1, 8)
    over = np.ones(7, bool)
    found = LimitChecker(0.3, False).judge(t, over, ~over)
    assert found.tolist() == [False] * 3 + [True] * 4
