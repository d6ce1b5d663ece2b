"""Alarm level and model error of the bank against closed forms, and what they do to answers."""

import re

import numpy as np
import pytest

from calibrations import for_observer
from faultgauge.detection.bank.bank import CERTAIN, build_fault_bank
from faultgauge.detection.calibration.bank_calibration import (
    _believed_less,
    calibrate_bank,
    calibrated,
    level_of,
)
from faultgauge.detection.calibration.blocks import Block
from faultgauge.detection.decisions import decide, decide_runs
from faultgauge.errors import InputError
from faultgauge.reporting.words.unjudged import unjudged_sentence
from lags import COUNT, LAG, NOISE, STEP, log, model


def taken(found, plain):
    """`plain` with what was `found`, of as much noise as there is."""
    return calibrated(plain, found._replace(noise=NOISE))


def on(healthy, **keys):
    plain = model(**keys)
    return taken(calibrate_bank(plain, healthy, NOISE), plain)


@pytest.fixture(scope="module")
def right():
    """By three healthy logs of a model that is right."""
    return calibrate_bank(model(), [log(1), log(2), log(3)], NOISE)


def test_the_level_stands_three_mean_excesses_of_the_upper_half_above_the_highest_peak():
    """Peaks 4, 2, 0 and many far below: the median is -10, the upper half 4, 2, 0, -10, so that its
    mean excess is 9; it is not taken for more than 1 + 4 beyond what was reached."""
    peaks = np.array([4.0, 2.0, 0.0, -10.0, -11.0, -12.0, -13.0])
    assert level_of(peaks, 0) == pytest.approx(4 + 3 * 5)
    near = np.array([4.0, 3.6, 3.5, 3.4])  # median 3.55, upper half 4 and 3.6: excess 0.25
    assert level_of(near, 0) == pytest.approx(4 + 3 * 0.25)
    assert level_of(near, 1) == pytest.approx(3.6 + 3 * 0.25)
    assert level_of(peaks - 20, 0) == CERTAIN


def test_the_level_says_what_the_healthy_data_prove(right):
    block = taken(right, model()).calibration.bank
    assert block.level >= CERTAIN
    assert block.alarms == 0
    # three runs of 800 less 10 samples of hold-off
    assert block.judged_s == pytest.approx(3 * 790 * STEP)
    assert block.mtbfa_s == pytest.approx(block.judged_s / 2.9957, rel=1e-4)  # -ln 0.05
    assert block.blocks >= 6
    with pytest.raises(InputError, match="at least 3 blocks"):
        calibrate_bank(model(), [log(1, samples=100)], NOISE)


def test_a_run_that_looks_faulty_is_named_and_kept():
    found = calibrate_bank(model(), [log(1), log(2), log(3, bias=1.0)], NOISE)
    (text,) = [each for each in found.warnings if "look faulty" in each]
    where = (
        r"most of all run run3 from \d+ s to \d+ s \(bias of \+(\S+), odds of more than 1000 to 1"
    )
    said = re.search(where, text)
    assert said is not None
    assert float(said[1]) == pytest.approx(1.0, abs=0.1)  # two digits
    assert {run for run, *_ in found.level.suspects} == {"run3"}
    assert found.level.level > max(b.peak for b in found.blocks)  # kept: it raises the level


def test_evidence_is_believed_as_far_as_healthy_logs_show_no_fault(right):
    """A model that is right is believed in full. One that errs by a square wave of 0.1 in x', which
    is neither white nor a rare step, would be sure of faults in healthy logs."""
    assert right.level.widened == 1.0
    assert right.noise.as_dict(model()) == NOISE.as_dict(model())
    wave = 0.1 * np.sign(np.sin(2 * np.pi * np.arange(COUNT) / 200))
    wrong = calibrate_bank(model(), [log(k, error=wave) for k in (1, 2, 3)], NOISE)
    factor = wrong.level.widened
    assert wrong.lost > right.lost == 0.0
    # what looked faulty is said with how large it looked
    assert re.search(r"\(\w+ of [+-]\d\S*( \S+)?, odds of ", wrong.warnings[0])
    # one fault in a thousand such sets of logs, and as many at the start of each of three: 4 in a
    # thousand per declared fault, 20 times which is seen by chance once in 20 times
    faults = len(model().plant.signals.faults)
    assert max(each.peak for each in wrong.blocks) <= np.log(20 * 0.004 * faults)
    for name in ("sigma", "process", "drift", "size", "share"):
        np.testing.assert_allclose(getattr(wrong.noise, name), factor * getattr(NOISE, name))
    for name in ("lasting", "settling", "shift", "spread"):
        np.testing.assert_array_equal(getattr(wrong.noise, name), getattr(NOISE, name))
    bank = build_fault_bank(calibrated(model(), wrong), [log(4)], wrong.noise)
    assert decide(bank, log(4, error=wave)).events == []
    told = decide(bank, log(5, error=wave, push=1.5)).events
    assert [each.fault for each in told] == ["push"]


def test_what_is_as_wide_to_two_digits_is_not_said_to_be_wider():
    bank = build_fault_bank(model(), [log(1)], NOISE)
    asked = [Block("day", 0.0, 9.0, 3.0, "leak")]
    assert _believed_less(bank, 1.04, asked, 100.0, {"day": None}) == []
    (said,) = _believed_less(bank, 1.06, asked, 100.0, {"day": None})
    assert "run day from 0 s to 9 s (leak," in said
    assert "all intervals are made 1.1 times as wide, and a fault must be 1.1 times" in said


def test_a_longer_time_than_the_blocks_support_is_refused():
    with pytest.raises(InputError, match="support at most"):
        calibrate_bank(model(), [log(1), log(2), log(3)], NOISE, 500.0)


def test_a_model_without_calibration_of_the_bank_judges_nothing():
    """Calibrated for an observer, or before there was a bank."""
    old = for_observer(model())
    (decision,), bank = decide_runs(old, [log(1)])
    assert bank is None
    assert set(zip(decision.status, decision.reason, strict=True)) == {
        ("NOT_JUDGED", "not calibrated for the bank")
    }
    assert decision.events == []
    assert np.isnan(decision.posterior.p).all()
    # the prior: a quarter of the range of what a fault enters, 11.8 of x in the envelope's points
    low, high = decision.posterior.lo[:, 1], decision.posterior.hi[:, 1]
    assert np.allclose(high, 1.96 * 12 / 4, rtol=0.05)
    assert np.array_equal(low, -high)
    assert "again" in unjudged_sentence(old)
    assert "again" not in unjudged_sentence(model())


def test_passive_faults_are_named_without_an_alarm_and_disabled_ones_are_not_evaluated():
    run = log(4, push=0.2)
    loud = decide(build_fault_bank(model(), [run], NOISE), run)
    assert loud.status[-1] == "FAULT"
    text = LAG.replace("[faults.bias]", '[faults.bias]\nmonitor = "disabled"')
    both = build_fault_bank(model(more='monitor = "passive"', text=text), [run], NOISE)
    passive = decide(both, run)
    assert "FAULT" not in passive.status
    assert passive.reason[-1] == "push, which is passive"
    assert [(e.fault, e.passive) for e in passive.events] == [("push", True)]
    assert passive.posterior.p[-1, 0] == pytest.approx(loud.posterior.p[-1, 0])
    off = decide(both, log(4, bias=0.3))
    assert np.isnan(off.posterior.p[:, 1]).all()
    assert "bias" not in {e.fault for e in off.events}
    off = LAG.replace("target", 'monitor = "disabled"\ntarget')
    with pytest.raises(InputError, match="disables all its"):
        build_fault_bank(model(text=off), [run], NOISE)


def test_persistence_and_hold_off_delay_and_a_latch_keeps():
    def told(rules, run):
        decision = decide(build_fault_bank(model(rules=rules), [run], NOISE), run)
        return np.array(decision.status), decision

    run = log(4, push=0.2)
    plain, _ = told("", run)
    rules = "persistence = 20\nhold_off = 30\nlatch = true"
    later, decision = told(rules, run)
    first = int(np.argmax(plain == "FAULT"))
    assert int(np.argmax(later == "FAULT")) == first + 40  # 20 s of 0.5 s
    assert set(later[:60]) == {"NOT_JUDGED"}
    assert decision.reason[0] == "too soon after a start or a gap"
    assert later[60] == "HEALTHY" or decision.reason[60] != decision.reason[0]
    gone = log(5, push=0.2, until=500)
    assert told("", gone)[0][-1] != "FAULT"
    assert told(rules, gone)[0][-1] == "FAULT"
