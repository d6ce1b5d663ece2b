"""A model file from before the bank knew a discrepancy, and what `estimate` wrote of it then.

Commit 5296c06: the tank, fitted to `log(1)`, calibrated on `log(2)`, estimated on `log(3, LEAK)`.
"""

from pathlib import Path

import numpy as np
import pytest

import faultgauge as fg
from tanks import LEAK, log

OLDER = Path(__file__).parents[1] / "data" / "tank_older.fgm"
COLUMNS = (
    *("run", "t", "r_x", "f_leak", "f_leak_lo", "f_leak_hi", "p_leak"),
    *("p_healthy", "p_unknown", "status", "reason"),
)
# its last row with --observer eso, to the digits that it wrote
R_X, F, LO, HI = 0.7501171881, 0.5999833976, 0.5987587589, 0.6012080363


def columns_kept(rows):
    return [name for name in rows if name in COLUMNS] == [*COLUMNS]


def test_it_is_read_and_its_observers_say_what_they_said():
    found = fg.estimate(OLDER, log(3, LEAK), observer="eso").rows
    assert columns_kept(found)
    last = [found[name][-1] for name in ("r_x", "f_leak", "f_leak_lo", "f_leak_hi")]
    np.testing.assert_allclose(last, [R_X, F, LO, HI], rtol=1e-8)


def test_its_bank_is_not_calibrated_and_says_so():
    said = fg.estimate(OLDER, log(3, LEAK))
    assert columns_kept(said.rows)
    assert {*said.rows["status"]} == {"NOT_JUDGED"}
    assert said.rows["r_x"][-1] == pytest.approx(R_X, rel=1e-8)
    (sentence,) = said.sentences
    assert "the calibration is of an older version; run `faultgauge calibrate`" in sentence


def test_with_a_calibration_of_today_it_finds_the_leak(calibrated):
    """That of a model that was fitted to the same log."""
    model = fg.load(OLDER).with_calibration(calibrated.model.calibration)
    answer = fg.estimate(model, log(3, LEAK))
    assert columns_kept(answer.rows)
    (event,) = answer.events
    assert event.fault == "leak"
    assert event.lo < LEAK < event.hi
