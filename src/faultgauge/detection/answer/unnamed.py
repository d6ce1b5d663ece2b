"""Alarms that no event tells of, and what is sure to be beside an event and has no name: when, and
what their rows say of the cause."""

from collections import Counter
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.events import (
    POSSIBLE,
    UNKNOWN,
    Cause,
    Unnamed,
    pause,
    stretches,
)
from faultgauge.detection.posterior.verdicts import EITHER, FAULT, NAMED, NEARLY
from faultgauge.detection.words import UNDECLARED

__all__ = ["unnamed_alarms"]

NOTHING = 1e-4  # of a fault's widest size: no size is told of what is as good as gone
DIGITS = 6  # of p: of causes that are as likely as each other the first comes first


def unnamed_alarms(bank: FaultBank, decision: Decision) -> list[Unnamed]:
    """Alarms without an event, and what is beside events without a name, in order."""
    alarm = np.array(decision.status) == FAULT
    alone = [
        _unnamed(bank, decision, part)
        for start, stop in stretches(alarm, np.isfinite(decision.posterior.healthy), pause(bank))
        for part in _beyond(bank, decision, start, stop)
    ]
    return sorted([*alone, *_beside(bank, decision, alarm)], key=lambda each: each.start)


def _beside(
    bank: FaultBank, decision: Decision, alarm: Bool[np.ndarray, "samples"]
) -> list[Unnamed]:
    """Where rows under `alarm` are as sure as of a name that there is one more fault than events
    tell, for longer than a name takes at most, and not sure which."""
    t, found = decision.run.t, decision.posterior
    names = (*bank.model.plant.signals.fault_names, UNDECLARED)
    p = np.nan_to_num(np.column_stack([found.p, found.unknown]))
    told, there = np.zeros(len(t), bool), np.zeros(p.shape, bool)
    for each in decision.events:
        told |= (t >= each.start) & (t <= each.end)
        began = min(each.onset_lo, each.start)
        name = UNDECLARED if each.fault == UNKNOWN else each.fault
        there[(t >= began) & (t <= each.end), names.index(name)] = True
    more = p.sum(axis=1) - there.sum(axis=1)
    rows = alarm & told & (more >= NAMED) & (np.where(there, 0.0, p).max(axis=1) < NAMED)
    found_more = []
    for start, stop in stretches(rows, np.isfinite(found.healthy), pause(bank)):
        if t[stop - 1] - t[start] <= bank.knowledge.memory:
            continue
        part = slice(start, stop)
        beside = tuple(names[k] for k in np.flatnonzero(there[part].any(axis=0)))
        likely = [c for c in _likeliest(bank, decision, part) if c.name not in beside]
        causes = tuple(each for each in likely if each.p >= POSSIBLE)
        run = decision.run.name
        span = float(t[start]), float(t[stop - 1])
        found_more.append(Unnamed(run, *span, causes=causes, beside=beside))
    return found_more


def _beyond(bank: FaultBank, decision: Decision, start: int, stop: int) -> list[slice]:
    """The parts of an alarm that no event tells: all of it, or what is longer than a name takes at
    most."""
    t, free = decision.run.t, np.ones(stop - start, bool)
    for each in decision.events:
        began = min(each.onset_lo, each.start)
        if t[start] < began and t[stop - 1] < each.start:  # it was over when that one's began
            continue
        free &= (t[start:stop] < began) | (t[start:stop] > each.end)
    if free.all():
        return [slice(start, stop)]
    return [
        slice(start + a, start + b)
        for a, b in stretches(free, np.ones_like(free), 0)
        if t[start + b - 1] - t[start + a] > bank.knowledge.memory
    ]


def _unnamed(bank: FaultBank, decision: Decision, part: slice) -> Unnamed:
    """Why an alarm has no event; where two causes are left, what either of them would be."""
    run = decision.run
    first, last = float(run.t[part.start]), float(run.t[part.stop - 1])
    why = [reason for reason in decision.reason[part] if reason]
    if not why:
        name = _named(bank, decision, part)
        before = [e.end for e in decision.events if e.fault == name and e.end < first]
        again = bool(before) and first - max(before) <= bank.pause
        return Unnamed(run.name, first, last, named=name, again=again)
    usual = _usual(why)
    for reason, count in ((EITHER, 2), (NEARLY, 1)):
        if usual.startswith(reason):
            causes = _likeliest(bank, decision, part)
            # one that has no rival in the whole of the alarm lacks time, whatever most rows say
            if causes[0].name != UNDECLARED and causes[1].p < 1 - NAMED:
                reason, count = NEARLY, 1
            return Unnamed(run.name, first, last, reason=reason, causes=causes[:count])
    return Unnamed(run.name, first, last, reason=usual)


def _likeliest(bank: FaultBank, decision: Decision, part: slice) -> tuple[Cause, ...]:
    """All causes in the rows of an alarm, the likeliest first."""
    rows = part.start + np.flatnonzero(np.array(decision.status[part]) == FAULT)
    found, names = decision.posterior, bank.model.plant.signals.fault_names
    p = {UNDECLARED: float(np.mean(found.unknown[rows]))}
    p |= zip(names, np.nan_to_num(found.p[rows]).mean(axis=0).tolist(), strict=True)
    there = np.maximum(found.p[rows].sum(axis=0), 1e-300)
    sizes = (found.f[rows].sum(axis=0) / there).tolist()
    least = (NOTHING * bank.size).tolist()
    size = {
        name: size
        for name, size, least in zip(names, sizes, least, strict=True)
        if abs(size) > least
    }
    order = sorted(p, key=lambda name: -round(p[name], DIGITS))
    return tuple(Cause(name, p[name], size.get(name)) for name in order)


def _named(bank: FaultBank, decision: Decision, part: slice) -> str:
    """What was named in rows that no event tells of: its sign is not known any more, or all of it
    turned out to be another fault."""
    p = np.nan_to_num(decision.posterior.p[part]).sum(axis=0)
    return bank.model.plant.signals.fault_names[int(np.argmax(p))]


def _usual(reasons: Sequence[str]) -> str:
    return Counter(reasons).most_common(1)[0][0]
