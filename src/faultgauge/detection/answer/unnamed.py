"""The sentences of alarms without a name, and of what a log ends undecided about."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from faultgauge.detection.answer.reliance import headed
from faultgauge.detection.answer.shares import WHOLE, shares_of
from faultgauge.detection.answer.telling import Told, row_time, unit_of
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.events import pause, stretches
from faultgauge.detection.posterior.posterior import LIKELY
from faultgauge.detection.posterior.probability import probability
from faultgauge.detection.posterior.verdicts import EITHER, FAULT, NEARLY, NOT_JUDGED
from faultgauge.detection.words import UNDECLARED

__all__ = ["alarms", "unnamed"]

NOTHING = 1e-4  # of a fault's widest size: no size is told of what is as good as gone
DIGITS = 6  # of p: of causes that are as likely as each other the first comes first


def unnamed(bank: FaultBank, decision: Decision) -> list[Told]:
    """Alarms without an event, and what the log ends undecided about."""
    judged = shares_of(decision).judged
    note = "" if judged >= WHOLE else f", of which {100 * judged:.0f} % could be judged"
    return [*alarms(bank, decision, note), *_undecided(bank, decision, note)]


def alarms(bank: FaultBank, decision: Decision, note: str = "") -> list[Told]:
    """Alarms without an event, with a `note` on the run."""
    run, found = decision.run, list[Told]()
    alarm = np.array(decision.status) == FAULT
    for start, stop in stretches(alarm, np.isfinite(decision.posterior.healthy), pause(bank)):
        for part in _beyond(bank, decision, start, stop):
            first, last = float(run.t[part.start]), float(run.t[part.stop - 1])
            when = f"from {row_time(bank, decision, first)} to {row_time(bank, decision, last)}"
            why, causes = _why_unnamed(bank, decision, part)
            text = headed(bank.model, f"An alarm {when} (run {run.name}{note}); {why}")
            found.append(Told(first, last, text, causes=causes, brief="an alarm"))
    return found


def _beyond(bank: FaultBank, decision: Decision, start: int, stop: int) -> list[slice]:
    """The parts of an alarm that no event tells: all of it, or what is longer than a name takes at
    most."""
    t, free = decision.run.t, np.ones(stop - start, bool)
    for each in decision.events:
        free &= (t[start:stop] < min(each.onset_lo, each.start)) | (t[start:stop] > each.end)
    if free.all():
        return [slice(start, stop)]
    return [
        slice(start + a, start + b)
        for a, b in stretches(free, np.ones_like(free), 0)
        if t[start + b - 1] - t[start + a] > bank.knowledge.memory
    ]


def _why_unnamed(bank: FaultBank, decision: Decision, part: slice) -> tuple[str, tuple[str, ...]]:
    """Why an alarm has no event; where two causes are left, what either of them would be, and
    which they are."""
    why = [reason for reason in decision.reason[part] if reason]
    if not why:
        name, begun = _named(bank, decision, part), float(decision.run.t[part.start])
        before = [e.end for e in decision.events if e.fault == name and e.end < begun]
        if before and begun - max(before) <= bank.pause:
            return f"it is not clear whether {name}, told before, was over", ()
        return f"{name}, named there, was given up", ()
    if not (usual := _usual(why)).startswith((EITHER, NEARLY)):
        return usual, ()
    rows = part.start + np.flatnonzero(np.array(decision.status[part]) == FAULT)
    found, names = decision.posterior, bank.model.plant.signals.fault_names
    p = {UNDECLARED: float(np.mean(found.unknown[rows]))}
    p |= zip(names, np.nan_to_num(found.p[rows]).mean(axis=0).tolist(), strict=True)
    there = np.maximum(found.p[rows].sum(axis=0), 1e-300)
    size = dict(zip(names, found.f[rows].sum(axis=0) / there, strict=True))
    first, second = sorted(p, key=lambda name: -round(p[name], DIGITS))[:2]

    least = dict(zip(names, NOTHING * bank.size, strict=True))

    def told(name: str) -> str:
        there = name in size and abs(size[name]) > least[name]
        of = f" of {size[name]:+.3g} {unit_of(bank, name)}".rstrip() if there else ""
        return f"{name}{of} (p {probability(p[name])})"

    if usual.startswith(NEARLY):
        return f"{NEARLY}{told(first)}", (first,)
    return f"{EITHER}{told(first)} or {told(second)}", (first, second)


def _named(bank: FaultBank, decision: Decision, part: slice) -> str:
    """What was named in rows that no event tells of: its sign is not known any more, or all of it
    turned out to be another fault."""
    p = np.nan_to_num(decision.posterior.p[part]).sum(axis=0)
    return bank.model.plant.signals.fault_names[int(np.argmax(p))]


def _undecided(bank: FaultBank, decision: Decision, note: str) -> list[Told]:
    """What stands at the end of a log, without an alarm: likelier than not, and not sure."""
    run, found = decision.run, decision.posterior
    sampled = np.flatnonzero(np.isfinite(found.healthy))
    if not len(sampled) or decision.status[sampled[-1]] != NOT_JUDGED:
        return []
    if not found.healthy[sampled[-1]] < LIKELY:
        return []
    certain = sampled[found.healthy[sampled] >= LIKELY]
    first = int(certain[-1]) + 1 if len(certain) else int(sampled[0])
    shares = dict(zip(bank.model.plant.signals.fault_names, found.p[sampled[-1]], strict=True))
    shares[UNDECLARED] = found.unknown[sampled[-1]]
    cause = max(shares, key=lambda name: np.nan_to_num(shares[name]))
    size = ""
    if cause != UNDECLARED:
        k = bank.model.plant.signals.fault_names.index(cause)
        there = found.f[sampled[-1], k] / max(found.p[sampled[-1], k], 1e-300)
        size = f", {there:+.3g} {unit_of(bank, cause)}".rstrip() + " if it is there"
    begun = row_time(bank, decision, float(run.t[first]))
    text = (
        f"Undecided from {begun} to the end of the log (run {run.name}{note}); the likeliest cause "
        f"is {cause}{size} (p {probability(float(shares[cause]))}); that nothing is wrong has p "
        f"{probability(float(found.healthy[sampled[-1]]))}"
    )
    last = float(run.t[sampled[-1]])
    return [Told(float(run.t[first]), last, headed(bank.model, text), brief="undecided")]


def _usual(reasons: Sequence[str]) -> str:
    return Counter(reasons).most_common(1)[0][0]
