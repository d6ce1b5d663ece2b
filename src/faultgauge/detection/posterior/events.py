"""The events of a run: the stretches in which a fault was named, and what is told of each.

A fault that stays is one event, however its estimate is refined and whatever interrupts the log: a
stretch belongs to the one before where the posterior holds that the fault began before that ended,
unless rows between the two are sure that it was over.
It ends where the posterior lets it go, or no longer knows which sign it has. Where it gets the
other sign, or jumps to another size, another one begins, and the first ends where that one's onset
lies; what is undeclared ends with the alarm that nothing else explains.
An event begins and ends in rows that were judged.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.bank.knowledge import longest_delay
from faultgauge.detection.posterior.jumps import Sizes, jumps
from faultgauge.detection.posterior.posterior import LIKELY, WIDE, Posterior
from faultgauge.detection.posterior.verdicts import (
    FAULT,
    HEALTHY,
    NAMED,
    STATUS,
    Reason,
    Verdict,
    is_sure,
)
from faultgauge.detection.words import POSSIBLE_ODDS, TOLD_ODDS
from faultgauge.telemetry import Run

__all__ = [
    "POSSIBLE",
    "UNKNOWN",
    "Alarm",
    "BankEvent",
    "Judged",
    "Cause",
    "Unnamed",
    "events",
    "pause",
    "stretches",
    "telling",
]

UNKNOWN = "unknown"
POSSIBLE = 0.05  # p of a fault beside another from which on it is told


@dataclass(frozen=True)
class BankEvent:
    """A stretch in which a fault was named. Times in s; size in the fault's unit with its 95 %
    interval, given that the fault is there (None for an undeclared one).

    `start` is when it was told, `onset` when it began, which may have been before the log did:
    `older`. Size, p and the rest stand at the last sample at which the fault was sure; of a
    fault that is over, before its end may have begun to show.
    `alternatives` are other sets of faults, with the odds of the best set against them; `beside`
    other faults that may be there too, with their probabilities if this one is; `instead` every
    other cause, with the odds of this fault against it, at most 1000: against it without this
    fault where it is `beside`, else against it alone or with others. `rivals` are other causes that
    would be possible were the model's answers as far off as in healthy logs, with the odds then. Of
    an undeclared one `noisy` is the output whose noise has grown, where that is what it is. A
    `passive` fault raised no alarm.
    """

    run: str
    fault: str
    start: float
    end: float
    size: float | None
    lo: float | None
    hi: float | None
    p: float
    onset: float
    onset_lo: float
    onset_hi: float
    alternatives: tuple[tuple[str, float], ...]
    instead: tuple[tuple[str, float], ...] = ()
    beside: tuple[tuple[str, float], ...] = ()
    rivals: tuple[tuple[str, float], ...] = ()
    noisy: str | None = None
    passive: bool = False
    older: Literal["no", "perhaps", "yes"] = "no"


@dataclass(frozen=True)
class Alarm:
    """On a stream: a fault was named at `start` [s], as large as it is then, in its unit (None for
    an undeclared one). How large it was in the end, and since when, its event tells. `fault` is
    None where an alarm begins before anything can be named, for the `reason` that is given."""

    run: str
    fault: str | None
    start: float
    size: float | None
    reason: str = ""


class Cause(NamedTuple):
    """What an alarm may be due to, how likely, and how large it would be [the fault's unit]; None
    where it has no size."""

    name: str
    p: float
    size: float | None


@dataclass(frozen=True)
class Unnamed:
    """An alarm from `start` to `end` [s] of which no event tells, or what is there `beside` the
    faults of events. `reason` is why it has no name, and `causes` those that it is left between;
    where `named` was named there and is no event, it was given up, or may be what was told before
    (`again`)."""

    run: str
    start: float
    end: float
    reason: str = ""
    causes: tuple[Cause, ...] = ()
    named: str = ""
    again: bool = False
    beside: tuple[str, ...] = ()


class Judged(NamedTuple):
    """Samples of a run, their inputs as they act, with what the bank says of them: `p` of all sets
    and, last, of the unknown; the same by which `rivals` are told; that of noise far beyond the
    usual of every measured output."""

    run: Run
    found: Posterior
    verdict: Verdict
    p: Float[np.ndarray, "samples sets"]
    rivals: Float[np.ndarray, "samples sets"]
    noisy: Float[np.ndarray, "samples measured"]


class _Stretch(NamedTuple):
    """Cause `k` from sample `begun`, `told`, until before `stop`; where its size jumped to what it
    is there, when (likeliest, earliest, latest [s])."""

    k: int
    begun: int
    told: int
    stop: int
    jumped: tuple[float, float, float] | None = None


def events(bank: FaultBank, judged: Judged, begun: float | None = None) -> list[BankEvent]:
    """The stretches in which a fault was named, but for those that were another one's: which the
    posterior, by the last sample, is sure were never there. What is undeclared in the end has no
    faults before it, as no hypothesis has it come beside declared ones, and tells nothing of them.
    The log `begun` [s], by default at the first sample of `judged`."""
    sampled = np.flatnonzero(np.isfinite(judged.found.healthy))
    begun = float(judged.run.t[0]) if begun is None else begun
    found = sorted(_stretches(bank, judged, begun), key=lambda each: (each.told, each.k))
    if not found:
        return []
    declared = sampled[judged.found.unknown[sampled] < LIKELY]
    last = int(declared[-1] if len(declared) else sampled[-1])
    ever = judged.found.ever[last] / (1 - judged.found.unknown[last] if len(declared) else 1.0)
    told = [
        _event(bank, judged, each, begun)
        for each in found
        if each.k == len(ever) or ever[each.k] > 1 - NAMED
    ]
    kept = [each for each in told if each.fault != UNKNOWN or not _renamed(each, told)]
    return _lasting(bank, judged, _after_each_other(bank, judged, kept))


def _after_each_other(bank: FaultBank, judged: Judged, told: list[BankEvent]) -> list[BankEvent]:
    """`told`, where a fault that had gone, and came again, began after the last row that was sure
    of that, whatever date the posterior gives what lasts: where all of that lies before, no more
    is known than when it was told."""
    kept: list[BankEvent] = []
    t, names = judged.run.t, bank.model.plant.signals.fault_names
    for each in told:
        within = [o.end for o in kept if o.fault == each.fault != UNKNOWN
                  and o.end < each.start and each.onset < o.end]  # fmt: skip
        if within:
            p = judged.found.p[:, names.index(each.fault)]
            over = t[(t > max(within)) & (t < each.start) & (p < 1 - NAMED)]
            low = max(each.onset_lo, *within, *over[-1:].tolist())
            high = each.onset_hi if each.onset_hi > low else each.start
            high = max(high, low + bank.step)
            mean = each.onset if low < each.onset < high else (low + high) / 2
            each = replace(each, onset=mean, onset_lo=low, onset_hi=high, older="no")
        kept.append(each)
    return kept


def _lasting(bank: FaultBank, judged: Judged, told: list[BankEvent]) -> list[BankEvent]:
    """`told`, where what is undeclared is one event until the alarm that no declared fault explains
    is over, however sure of it the rows in between are."""
    t, verdict = judged.run.t, judged.verdict
    open_ = verdict.status == STATUS.index(FAULT)
    for each in told:
        if each.fault != UNKNOWN:
            open_ = open_ & ((t < each.start) | (t > each.end))
    spans = [(t[a], t[b - 1]) for a, b in stretches(open_, _judged(verdict), pause(bank))]
    kept, until = [], -np.inf
    for each in told:
        if each.fault == UNKNOWN:
            if each.start <= until:
                continue
            until = float(max([each.end, *(b for a, b in spans if a <= each.end <= b)]))
            each = replace(each, end=until)
        kept.append(each)
    return kept


def _renamed(unknown: BankEvent, told: list[BankEvent]) -> bool:
    """Whether what was undeclared for a while has turned out to be a fault that was told later."""
    return any(
        each.fault != UNKNOWN
        and each.start >= unknown.start
        and each.onset_lo <= unknown.end <= each.start + (each.start - unknown.start)
        for each in told
    )


def telling(bank: FaultBank, verdict: Verdict) -> Bool[np.ndarray, "samples causes"]:
    """Rows that may speak of a cause: those under alarm, and of a passive fault all judged ones."""
    passive = np.append(bank.with_monitor("passive"), False)
    alarm = verdict.status == STATUS.index(FAULT)
    return alarm[:, None] | (_judged(verdict)[:, None] & passive)


def _judged(verdict: Verdict) -> Bool[np.ndarray, "samples"]:
    passive = verdict.reason % len(Reason) == Reason.PASSIVE
    return passive | np.isin(verdict.status, [STATUS.index(each) for each in (HEALTHY, FAULT)])


def _stretches(bank: FaultBank, judged: Judged, log: float) -> list[_Stretch]:
    found, verdict = judged.found, judged.verdict
    columns = np.concatenate([found.p, found.unknown[:, None]], axis=1)
    release = bank.model.plant.signals.detection.release
    there = (np.nan_to_num(columns) >= release) & telling(bank, verdict)
    unsigned = np.ones((len(columns), 1))
    # known as long as it is for a name (`verdicts`), also where the fault may be none
    signed = ~((found.lo < 0) & (found.hi > 0))
    signs = np.concatenate([np.sign(found.f) * signed, unsigned], axis=1)
    everyone = []
    for k in range(columns.shape[1]):
        own = []
        for side in (-1, 1):
            here = there[:, k] & (signs[:, k] == side)
            parts = []
            for start, stop in stretches(here, _judged(verdict), pause(bank)):
                named = np.flatnonzero((verdict.named[:, k] & here)[start:stop])
                if len(named):
                    parts.append(_Stretch(k, start, start + int(named[0]), stop))
            own += _joined(bank, judged, parts, log)
        own = [each for each in own if not any(_within(each, other) for other in own)]
        own = [each for each in own if not any(_going(bank, judged, o, each) for o in own)]
        for each in _in_turn(bank, judged, there[:, k], own, log):
            everyone += _at_jumps(bank, judged, each)
    return everyone


def _at_jumps(bank: FaultBank, judged: Judged, each: _Stretch) -> list[_Stretch]:
    """`each`, divided where the size of a declared fault jumps."""
    found, t, k = judged.found, judged.run.t, each.k
    if k == found.p.shape[1]:
        return [each]
    sure = _sure(bank, judged, k, each.told, each.stop - 1)
    rows = each.told + np.flatnonzero(sure)
    size, since = found.f[rows, k] / found.p[rows, k], found.onset[rows, k].copy()
    since[:, 0] = t[rows] - since[:, 0]
    sizes = Sizes(t[rows], found.lo[rows, k], found.hi[rows, k], since)
    parts, rest = [], each
    for jump in jumps(sizes, bank.knowledge.memory):
        last, first = rows[jump.last], rows[jump.first]
        by = float(size[jump.first] - size[jump.steady])
        late = longest_delay(bank.knowledge, k, by, float(bank.onset[k]), bank.level)
        earliest = max(min(float(t[last]), jump.began) - late, float(t[rest.told]))
        began = min(max(jump.began, earliest), float(t[first]) - bank.step / 2)
        stop = min(int(np.searchsorted(t, began, "right")), int(last) + 1)
        parts.append(rest._replace(stop=stop))
        rest = _Stretch(k, stop, int(first), each.stop, (began, earliest, float(t[first])))
    return [*parts, rest]


def _in_turn(
    bank: FaultBank,
    judged: Judged,
    there: Bool[np.ndarray, "samples"],
    own: list[_Stretch],
    log: float,
) -> list[_Stretch]:
    """Stretches of one cause, which is `there`; one that has another sign ends the one before it
    at its onset."""
    own = sorted(own, key=lambda each: each.told)
    for at, (before, after) in enumerate(pairwise(own)):
        if after.k == judged.found.p.shape[1]:  # nobody dates what is undeclared
            break
        if np.sum(~there[before.stop : after.begun]) > pause(bank):  # it went in between
            continue
        last = _settled(bank, judged, after.k, after.told, after.stop - 1)
        onset = _onset(bank, judged, after, last, log)[0]
        rows = np.arange(before.told, before.stop)
        until = rows[there[rows] & (judged.run.t[rows] <= onset)]
        if len(until):
            own[at] = before._replace(stop=int(until[-1]) + 1)
    return own


def _within(each: _Stretch, other: _Stretch) -> bool:
    """Whether it is an excursion of one that the posterior has it stayed, to the other sign."""
    return each is not other and other.begun <= each.begun and each.stop <= other.stop


def _going(bank: FaultBank, judged: Judged, each: _Stretch, other: _Stretch) -> bool:
    """Whether the `other` sign is what the mean has as `each` goes: it begins where that ends, and
    no row is sure that there is a fault."""
    if other.k == judged.found.p.shape[1]:  # what is undeclared has none
        return False
    behind = 0 <= other.begun - each.stop <= pause(bank)
    return behind and bool((judged.found.p[other.told : other.stop, other.k] < NAMED).all())


def _joined(bank: FaultBank, judged: Judged, own: list[_Stretch], log: float) -> list[_Stretch]:
    """Stretches of one cause and sign; one that began before the last one ended is part of it, but
    where that was surely over."""
    kept, sampled = own[:1], _judged(judged.verdict)
    for each in own[1:]:
        before = kept[-1]
        if each.k == judged.found.p.shape[1]:  # nobody dates what is undeclared
            kept.append(each)
            continue
        last = _settled(bank, judged, each.k, each.told, each.stop - 1)
        between = slice(before.stop, each.begun)
        over = judged.found.p[between, each.k] < 1 - NAMED
        surely = np.sum(over & sampled[between]) > pause(bank)
        began = _onset(bank, judged, each, last, log)[0]
        if not surely and began <= judged.run.t[before.stop - 1]:
            kept[-1] = before._replace(stop=each.stop)
        else:
            kept.append(each)
    return kept


def _event(bank: FaultBank, judged: Judged, each: _Stretch, log: float) -> BankEvent:
    found, t, k = judged.found, judged.run.t, each.k
    declared = k < found.p.shape[1]
    p = found.p[:, k] if declared else found.unknown
    last = _settled(bank, judged, k, each.told, each.stop - 1)
    if declared:
        last = _before_its_end(bank, judged, each, last)
    size = float(found.f[last, k] / found.p[last, k]) if declared else None
    lo, hi = (None, None) if size is None else _interval(bank, found, k, last, size)
    onset, low, high = each.jumped or _onset(bank, judged, each, last, log)
    held = log + bank.hold_off
    return BankEvent(
        judged.run.name,
        bank.model.plant.signals.fault_names[k] if declared else UNKNOWN,
        float(t[each.told]),
        float(t[each.stop - 1]),
        size,
        lo,
        hi,
        float(p[last]),
        onset,
        low,
        high,
        _alternatives(bank, judged.p[last]),
        *_others(bank, k, judged.p[last].astype(float)),
        _rivals(bank, k, judged.p[last].astype(float), judged.rivals[last].astype(float)),
        None if declared else _noisy(bank, judged.noisy[each.told : each.stop]),
        declared and bool(bank.with_monitor("passive")[k]),
        "yes" if high <= held else "perhaps" if low <= log else "no",
    )


def _noisy(bank: FaultBank, noisy: Float[np.ndarray, "samples measured"]) -> str | None:
    """The output whose noise explains most of these rows of something undeclared better than all
    else does."""
    share = np.nan_to_num(noisy).mean(axis=0)
    return bank.outputs[int(np.argmax(share))] if share.max(initial=0.0) > LIKELY else None


def _interval(
    bank: FaultBank, found: Posterior, k: int, last: int, size: float
) -> tuple[float, float]:
    """95 % of fault `k`, given that it is there: where its p is below that of a name the row's
    interval is of there being none, too, and reaches 0."""
    lo, hi = found.lo[last, k], found.hi[last, k]
    if found.p[last, k] < NAMED:
        fault, half = bank.model.plant.signals.faults[k], WIDE * float(found.sd[last, k])
        lo, hi = max(size - half, fault.min), min(size + half, fault.max)
    return float(min(lo, size)), float(max(hi, size))


def _onset(
    bank: FaultBank, judged: Judged, each: _Stretch, last: int, log: float
) -> tuple[float, float, float]:
    """(mean, lower, upper), at least a step wide and not after the fault was told; of an unknown
    fault, from the bank's memory before it was likely, which no alarm told at once, until then.

    Where the fault changed since, the posterior at `last` dates the change; then the best of the
    dates before is the fault's. A fault that is dated into an alarm that had no name, and may have
    been its, is perhaps what raised it, smaller or still growing: then it is as old as that may be.
    """
    t, told = judged.run.t, float(judged.run.t[each.told])

    def raised(at: int, until: float) -> tuple[float, float, float]:
        return float(t[at]), max(float(t[at]) - bank.knowledge.memory, log), until

    if each.k == judged.found.p.shape[1]:
        unlikely = np.flatnonzero(judged.found.unknown[: each.begun] < LIKELY)
        return raised(int(unlikely[-1]) + 1 if len(unlikely) else 0, told)
    ago, sd = judged.found.onset[:, each.k].T
    if t[last] - ago[last] > told:
        rows = np.arange(each.told, last + 1)
        first = rows[t[rows] - ago[rows] <= told]
        last = int(first[np.argmin(sd[first])]) if len(first) else last
    mean = min(float(t[last] - ago[last]), told - bank.step / 2)
    half = max(WIDE * float(sd[last]), bank.step / 2)
    low, high = mean - half, min(mean + half, told)
    alarm = _nameless(judged, each.k, each.told)
    return raised(alarm, high) if t[alarm] < low else (mean, low, high)


def _nameless(judged: Judged, k: int, told: int) -> int:
    """The first row of the alarm without the name of a declared fault that lasts until `told`; that
    row itself where there is none, or where neither fault `k` nor something undeclared was likely:
    that alarm is another one's."""
    alarm = judged.verdict.status == STATUS.index(FAULT)
    open_ = alarm & ~judged.verdict.named[:, :-1].any(axis=1)
    broken = np.flatnonzero(~open_[:told] & np.isfinite(judged.found.healthy[:told]))
    first = int(broken[-1]) + 1 if len(broken) else 0
    rows = first + np.flatnonzero(open_[first:told])
    own = judged.found.p[rows, k] + judged.found.unknown[rows]
    return int(rows[0]) if len(rows) and np.mean(own) >= LIKELY else told


def _sure(
    bank: FaultBank, judged: Judged, k: int, told: int, last: int
) -> Bool[np.ndarray, "rows"]:
    """Where fault `k`, or what is undeclared behind the last, was sure from `told` to `last`; given
    that there was one, where no row was sure of it in all, as none has an interval without 0."""
    found, rows = judged.found, slice(told, last + 1)
    declared = k < found.p.shape[1]
    p, calm = (found.p[rows, k] if declared else found.unknown[rows]), found.calm[rows]
    passive = declared and bool(bank.with_monitor("passive")[k])
    plain = p >= NAMED
    return plain if plain.any() else np.asarray(is_sure(p, calm, passive))


def _settled(bank: FaultBank, judged: Judged, k: int, told: int, last: int) -> int:
    """The last sample from `told` to `last` at which the fault was sure."""
    rows = np.flatnonzero(_sure(bank, judged, k, told, last))
    return told + int(rows[-1]) if len(rows) else last


def _before_its_end(bank: FaultBank, judged: Judged, each: _Stretch, last: int) -> int:
    """`last`, or, where a fault is over by then, as long before as it may take to see that it is,
    but for half of the event: until then its end would be told as a smaller size."""
    found, t, k = judged.found, judged.run.t, each.k
    if not np.isfinite(found.healthy[each.stop :]).any():
        return last
    sure = _sure(bank, judged, k, each.told, last).astype(int)
    stretches = each.told + np.flatnonzero(np.diff(sure, prepend=0, append=0)).reshape(-1, 2)
    if not len(stretches):
        return each.told
    # what flares up once more as the fault goes, for less than it takes to be known, is no size
    lasted = np.diff(stretches)[:, 0]
    enough = min(lasted.max() / 2, bank.knowledge.memory / bank.step)
    first, stop = stretches[np.flatnonzero(lasted >= enough)[-1]]
    size, end = float(found.f[stop - 1, k] / found.p[stop - 1, k]), float(t[stop - 1])
    late = longest_delay(bank.knowledge, k, size, float(bank.onset[k]), bank.level)
    late = min(late, (end - float(t[first])) / 2)
    return int(first + np.flatnonzero(t[first:stop] <= end - late)[-1])


def _alternatives(bank: FaultBank, p: Float[np.ndarray, "sets"]) -> tuple[tuple[str, float], ...]:
    names = bank.model.plant.signals.fault_names
    labels = ["+".join(names[k] for k in each) or "healthy" for each in bank.sets] + [UNKNOWN]
    total = dict(zip(labels, p.tolist(), strict=True))
    (_, most), *others = sorted(total.items(), key=lambda item: -item[1])
    return tuple((label, most / each) for label, each in others[:3] if each > most / TOLD_ODDS)


def _others(
    bank: FaultBank, k: int, p: Float[np.ndarray, "sets"]
) -> tuple[tuple[tuple[str, float], ...], tuple[tuple[str, float], ...]]:
    """(odds of cause `k` against every other one, p of those that may be beside it)."""
    names = (*bank.model.plant.signals.fault_names, UNKNOWN)
    holds = np.zeros((len(p), len(names)), bool)
    for at, each in enumerate(bank.sets):
        holds[at, list(each)] = True
    holds[len(bank.sets) :, -1] = True
    own = float(p @ holds[:, k])
    instead, beside = [], []
    for other in np.flatnonzero(np.arange(len(names)) != k):
        if holds[:, other].any():
            without = float(p @ (holds[:, other] & ~holds[:, k]))
            too = float(p @ (holds[:, other] & holds[:, k]))
            if too > POSSIBLE * own:
                beside.append((names[other], too / own))
            else:  # what is not told beside it must not seem ruled out
                without += too
            instead.append((names[other], min(own / max(without, 1e-300), TOLD_ODDS)))
    return tuple(instead), tuple(beside)


def _rivals(
    bank: FaultBank, k: int, p: Float[np.ndarray, "sets"], doubted: Float[np.ndarray, "sets"]
) -> tuple[tuple[str, float], ...]:
    """(cause, odds) of the faults that act on the plant which p leaves aside, and the model's own
    error does not; at least even ones, as it makes no other cause the likelier."""
    acting = {fault.name for fault in bank.model.plant.signals.faults if fault.acts}
    (plain, beside), (found, _) = _others(bank, k, p), _others(bank, k, doubted)
    told = {name: odds for name, odds in plain if odds >= POSSIBLE_ODDS}
    asked = told.keys() & acting - dict(beside).keys()
    return tuple(
        (name, max(odds, 1.0)) for name, odds in found if odds < POSSIBLE_ODDS and name in asked
    )


def pause(bank: FaultBank) -> int:
    """Samples below `release` that do not end an event, at most."""
    return int(np.ceil(bank.pause / bank.step))


def stretches(
    above: Bool[np.ndarray, "samples"], sampled: Bool[np.ndarray, "samples"], pause: int
) -> list[tuple[int, int]]:
    """(first sample, the one behind the last) wherever it is `above`; gaps, and pauses that are too
    short to be one, are bridged."""
    filled = above.copy()
    for start, stop in _edges(~above):
        if start > 0 and stop < len(above) and sampled[start:stop].sum() <= pause:
            filled[start:stop] = True
    return _edges(filled)


def _edges(above: Bool[np.ndarray, "samples"]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(above, prepend=False, append=False)).reshape(-1, 2)
    return [(int(a), int(b)) for a, b in edges]
