"""Where the size of a fault that is over is told, and when it has come again."""

import inspect
import types

import numpy as np
import pytest

from calibrations import for_bank
from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.knowledge import longest_delay
from faultgauge.detection.decisions import decide_runs
from faultgauge.detection.posterior import events as event_module
from faultgauge.detection.posterior.events import Judged, _before_its_end, _Stretch, events
from faultgauge.detection.posterior.verdicts import FAULT, HEALTHY, STATUS, Verdict
from lags import COUNT, NOISE, STEP, log, model

MODEL = for_bank(model(), NOISE)
PUSH, TOLD, GONE, STOP = 0, 100, 297, 300
SETS = build_fault_bank(MODEL, [log(0)], NOISE).sets


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
    return Judged(decision.run, found, Verdict(none, none, none > 0, named), sets, sets, sets)


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
    # what lasts for as long as a fault takes to be known is one, though shorter than half of it
    rows = int(np.ceil(bank.knowledge.memory / STEP)) + 1
    assert rows < (STOP - TOLD) / 2
    longer = each._replace(stop=STOP + 5 + rows)
    last = _before_its_end(bank, judged(COUNT, again=rows), longer, longer.stop - 1)
    assert STOP + 5 <= last < longer.stop


@pytest.mark.parametrize(
    ("between", "healthy", "parts"), [(0.3, True, 1), (0.0, False, 1), (0.0, True, 2)]
)
def test_what_rows_were_sure_was_over_has_come_again(between, healthy, parts):
    """A push that is sure twice, with p `between` that for rows that were judged or not, and each
    time is dated to before it was told first."""
    bank = build_fault_bank(MODEL, [log(0)], NOISE)
    first, pause = judged(COUNT, again=100), slice(STOP, STOP + 60)
    k = np.arange(COUNT)
    there = (k >= TOLD) & (k < STOP) | (k >= pause.stop) & (k < pause.stop + 100)
    p = np.stack([there * 1.0, 0.0 * k], axis=1)
    p[pause, PUSH] = between
    status = np.where(there, STATUS.index(FAULT), STATUS.index(HEALTHY))
    if not healthy:
        status[pause] = STATUS.index("NOT_JUDGED")
    ago = STEP * (k - (TOLD - 3.0))
    found = first.found._replace(
        p=p,
        f=0.05 * p,
        lo=0.04 * p,
        hi=0.06 * p,
        onset=np.stack([np.stack([ago, 0.0 * k + 1e-9], 1)] * 2, axis=1),
        ever=np.tile([1.0, 0.0], (COUNT, 1)),
    )
    named = np.stack([there, there & False, there & False], axis=1)
    verdict = first.verdict._replace(status=status, named=named)
    sets = np.full((COUNT, len(bank.sets) + 1), 1e-3)
    told = events(bank, first._replace(found=found, verdict=verdict, p=sets, rivals=sets))
    t = first.run.t
    ends = [t[pause.stop + 99]] if parts == 1 else [t[STOP - 1], t[pause.stop + 99]]
    assert [each.end for each in told] == pytest.approx(ends)
    assert told[0].onset == pytest.approx(t[TOLD - 3])
    if parts == 2:
        assert told[1].start == pytest.approx(t[pause.stop])
        assert told[0].end <= told[1].onset_lo < told[1].onset < told[1].onset_hi <= told[1].start
        assert told[1].onset_lo == pytest.approx(t[pause.stop - 1])  # the last row sure of that


def scene(p, f, lo, hi, ago, late):
    """A run of which the bank says so of the push, where p is 0.5 or more under alarm."""
    shape, k = (COUNT, 2), np.arange(COUNT)
    there = p >= 0.5
    columns = np.zeros((4, *shape))
    columns[:, :, PUSH] = p, f, lo, hi
    onset = np.zeros((COUNT, 2, 2))
    onset[:, PUSH] = np.stack([ago, np.broadcast_to(late, COUNT)], axis=1)
    decision = decide_runs(MODEL, [log(0)])[0][0]
    found = decision.posterior._replace(
        p=columns[0], f=columns[1], lo=columns[2], hi=columns[3], onset=onset,
        healthy=1 - p, unknown=0.0 * p, ever=np.ones(shape),
    )  # fmt: skip
    status = np.where(there, STATUS.index(FAULT), STATUS.index(HEALTHY))
    named = np.zeros((COUNT, 3), bool)
    named[:, PUSH] = p > 0.95
    sets = np.stack([1 - p, p, *np.zeros((len(SETS) - 1, COUNT))], axis=1)
    return Judged(decision.run, found, Verdict(status, 0 * k, status < 0, named), sets, sets, sets)


def test_a_fault_that_may_be_none_is_not_over():
    """From row 200 on it is there with p 0.96, so that 0 lies inside its interval of 95 %; it is
    over where p falls below one half."""
    bank = build_fault_bank(MODEL, [log(0)], NOISE)
    k = np.arange(COUNT)
    p = np.select([k < TOLD, k < 200, k < 280], [0.0, 1.0, 0.96], 0.0)
    lo = np.where(p == 1.0, 0.04, 0.0)
    (event,) = events(bank, scene(p, 0.05 * p, lo, 0.06 * (p > 0), STEP * (k - 97.0), STEP))
    assert (event.start, event.end) == (pytest.approx(TOLD * STEP), pytest.approx(279 * STEP))
    # where its sign is not known it is
    unsigned = np.where(k < 200, lo, -0.01)
    (event,) = events(bank, scene(p, 0.05 * p, unsigned, 0.06 * (p > 0), STEP * (k - 97.0), STEP))
    assert event.end == pytest.approx(199 * STEP)


@pytest.mark.parametrize(("sure", "parts"), [(0.97, 1), (0.99, 2)])
def test_the_other_sign_for_a_moment_as_a_fault_goes_is_no_event(sure, parts):
    """In one row it is there with a p of `sure`, negative, and dated to the middle of what was
    positive until then; where that is more than 0.98 it is an event of its own."""
    bank = build_fault_bank(MODEL, [log(0)], NOISE)
    k = np.arange(COUNT)
    p = np.select([k < TOLD, k < STOP, k == STOP], [0.0, 1.0, sure], 0.0)
    side = np.where(k < STOP, 1, -1)
    ends = np.sort(np.stack([0.04 * p * side, 0.06 * p * side]), axis=0)
    ago = STEP * (k - np.where(k < STOP, 97.0, 200.0))
    told = events(bank, scene(p, 0.05 * p * side, *ends, ago, STEP))
    assert [np.sign(each.size) for each in told] == [1, -1][:parts]
    assert told[0].end == pytest.approx((STOP - 1 if parts == 1 else 200) * STEP)


@pytest.mark.parametrize(("cause", "onset"), [("another fault", 97), ("undeclared", 20)])
def test_an_alarm_that_another_fault_explains_is_not_where_a_later_one_began(cause, onset):
    """An alarm without a name from row 20 on; the push is named at TOLD, and dated to row 97."""
    bank = build_fault_bank(MODEL, [log(0)], NOISE)
    k = np.arange(COUNT)
    p = np.where((k >= TOLD) & (k < STOP), 1.0, 0.0)
    given = scene(p, 0.05 * p, 0.04 * p, 0.06 * p, STEP * (k - 97.0), 1e-9)
    before = (k >= 20) & (k < TOLD)
    other = given.found.p.copy()
    other[before, 1] = 0.9 if cause == "another fault" else 0.0
    unknown = np.where(before & (cause == "undeclared"), 0.9, 0.0)
    found = given.found._replace(p=other, unknown=unknown)
    status = np.where(before, STATUS.index(FAULT), given.verdict.status)
    verdict = given.verdict._replace(status=status)
    (event,) = events(bank, given._replace(found=found, verdict=verdict))
    assert event.onset == pytest.approx(onset * STEP)
    assert event.start == pytest.approx(TOLD * STEP)


def test_an_event_that_is_not_quite_sure_has_an_interval_given_that_it_is():
    """p 0.96, the rest being that nothing is there: the row's interval reaches 0, and the event's
    is 0.05 +- 1.96 times 0.002, of which the fault's limits, if it has any, take their part."""
    bank = build_fault_bank(MODEL, [log(0)], NOISE)
    first, k = judged(STOP), np.arange(COUNT)
    there = (k >= TOLD) & (k < STOP)
    p = np.stack([0.96 * there, 0.0 * k], axis=1)
    calm, none = 1 - p[:, 0], np.zeros_like(p)
    found = first.found._replace(
        p=p, f=0.05 * p, lo=none, hi=0.06 * p, sd=none + 0.002, calm=calm, ever=p
    )
    status = np.where(there, STATUS.index(FAULT), STATUS.index(HEALTHY))
    named = np.stack([there, none[:, 0] > 0, none[:, 0] > 0], axis=1)
    verdict = Verdict(status, 0 * k, there, named)
    sets = np.zeros((COUNT, len(SETS) + 1))
    sets[:, SETS.index(())], sets[:, SETS.index((PUSH,))] = calm, p[:, 0]
    (told,) = events(bank, Judged(first.run, found, verdict, sets, sets, sets))
    assert (told.fault, told.p) == ("push", 0.96)
    assert told.size == pytest.approx(0.05)
    half = 1.959964 * 0.002
    assert (told.lo, told.hi) == (pytest.approx(0.05 - half), pytest.approx(0.05 + half))


def test_rivals_are_faults_that_act_which_the_models_own_error_does_not_leave_aside(monkeypatch):
    """A leak of 0.92, a loss of 1e-6 that would be 0.3, a sensor's bias and the unknown, whose
    odds fall only because the leak's p does."""
    faults = [
        types.SimpleNamespace(name=name, acts=name != "gauge") for name in ("leak", "loss", "gauge")
    ]
    signals = types.SimpleNamespace(faults=faults, fault_names=("leak", "loss", "gauge"))
    plant = types.SimpleNamespace(signals=signals)
    bank = types.SimpleNamespace(
        model=types.SimpleNamespace(plant=plant), sets=((), (0,), (1,), (2,))
    )
    p = np.array([0.0, 0.92, 1e-6, 0.04, 0.04])
    doubted = np.array([0.0, 0.6, 0.3, 0.04, 0.04])
    monkeypatch.setattr(event_module, "_others", inspect.unwrap(event_module._others))
    told = inspect.unwrap(event_module._rivals)(bank, 0, p, doubted)
    assert told == (("loss", pytest.approx(2.0)),)
    assert inspect.unwrap(event_module._rivals)(bank, 0, p, p) == ()
