"""Where the size of a fault that is over is told."""

import numpy as np

from calibrations import for_bank
from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.knowledge import longest_delay
from faultgauge.detection.decisions import decide_runs
from faultgauge.detection.posterior.events import Judged, _before_its_end, _Stretch
from faultgauge.detection.posterior.verdicts import Verdict
from lags import COUNT, NOISE, STEP, log, model

MODEL = for_bank(model(), NOISE)
PUSH, TOLD, GONE, STOP = 0, 100, 297, 300


def judged(until, again=0):
    """A push of 0.05 that is sure from TOLD until STOP, and goes at GONE, from where on the
    estimate slides; rows are judged `until` there; some rows behind a pause in which it is not
    sure it flares up `again` for so many rows."""
    k = np.arange(COUNT)
    f = np.where(k < GONE, 0.05, 0.05 - 0.01 * (k - GONE))
    there = (k >= TOLD) & (k < STOP) | (k >= STOP + 5) & (k < STOP + 5 + again)
    healthy = np.where(k < until, np.where(there, 0.0, 1.0), np.nan)
    p = np.stack([there * 1.0, 0.0 * k], axis=1)
    decision = decide_runs(MODEL, [log(0)])[0][0]
    found = decision.posterior._replace(p=p, f=p * f[:, None], healthy=healthy)
    none, named = np.zeros(COUNT, int), np.zeros((COUNT, 3), bool)
    sets = np.zeros((COUNT, 4))
    return Judged(decision.run, found, Verdict(none, none, none > 0, named), sets)


def test_the_end_of_a_fault_is_not_told_as_a_smaller_size():
    bank = build_fault_bank(MODEL, [log(0)], NOISE)
    each = _Stretch(PUSH, TOLD, TOLD, STOP)
    late = longest_delay(bank.knowledge, PUSH, 0.03, float(bank.onset[PUSH]), bank.level)
    last = _before_its_end(bank, judged(COUNT), each, STOP - 1)
    # as long before its end as it may take to see that it is over
    assert last == STOP - 1 - int(np.ceil(late / STEP - 1e-9))
    assert last < GONE
    # of one that the log ends with nothing is over
    assert _before_its_end(bank, judged(STOP), each, STOP - 1) == STOP - 1


def test_what_flares_up_as_a_fault_goes_is_no_size_of_it():
    bank = build_fault_bank(MODEL, [log(0)], NOISE)
    each = _Stretch(PUSH, TOLD, TOLD, STOP + 9)
    once = _before_its_end(bank, judged(COUNT), each._replace(stop=STOP), STOP - 1)
    assert _before_its_end(bank, judged(COUNT, again=4), each, STOP + 8) == once
