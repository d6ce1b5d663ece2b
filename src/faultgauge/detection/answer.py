"""The answer of the bank as a sentence: which fault, how big, since when, how sure, what it is
not, and what this log could not tell.

    friction +0.100 +- 0.004 N*m since 08:41:10 +- 6 s (p 0.98, run a); gain excluded 200:1;
    friction below 0.0012 N*m this log could not tell
"""

from collections import Counter
from collections.abc import Collection, Sequence
from datetime import datetime, timedelta
from typing import Any, NamedTuple

import numpy as np

from faultgauge.detection.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.decisions import as_dicts as events_as_dicts
from faultgauge.detection.events import FEWEST, UNKNOWN, BankEvent, pause, stretches
from faultgauge.detection.posterior import LIKELY
from faultgauge.detection.probability import probability
from faultgauge.detection.verdicts import FAULT, NAMED, NOT_JUDGED
from faultgauge.observers.branching import SCALES
from faultgauge.telemetry import Run

__all__ = [
    "EXCLUDED",
    "answer",
    "answers",
    "as_dicts",
    "beside",
    "exclusions",
    "least_told",
    "moment",
    "told",
]

EXCLUDED = 20.0  # odds from which on a cause is
NINE_IN_TEN = 1.2816  # standard deviations
MOST = 1 / FEWEST  # odds beyond which an alternative is not listed


class Told(NamedTuple):
    """What is told of a run from `start` to `end` [s], as a sentence."""

    start: float
    end: float
    text: str


def answers(bank: FaultBank, decisions: Sequence[Decision]) -> list[str]:
    """A sentence for every event, every alarm without one and every log that ends undecided; one
    for the runs in which there is none of these."""
    found = [each.text for each in told(bank, decisions)]
    silent = [one for one in decisions if not _told(bank, one)]
    if found and silent:
        return [*found, f"No fault in {', '.join(f'run {one.run.name}' for one in silent)}."]
    return found or [_silence(bank, decisions)]


def told(bank: FaultBank, decisions: Sequence[Decision]) -> list[Told]:
    """Every event, every alarm without one, and what a log ends undecided about, run by run, in the
    order of time."""
    return [each for one in decisions for each in _told(bank, one)]


def _silence(bank: FaultBank, decisions: Sequence[Decision]) -> str:
    if all(status == "NOT_JUDGED" for each in decisions for status in each.status):
        reasons = [reason for each in decisions for reason in each.reason if reason]
        return f"Nothing could be judged: {_usual(reasons)}."
    return f"No fault; {_could_not_tell(bank, decisions[0].run)}."


def _told(bank: FaultBank, decision: Decision) -> list[Told]:
    run, events = decision.run, decision.events
    found = [Told(e.start, e.end, answer(bank, decision, e)) for e in events]
    alarm = np.array(decision.status) == FAULT
    for start, stop in stretches(alarm, np.isfinite(decision.posterior.healthy), pause(bank)):
        first, last = float(run.t[start]), float(run.t[stop - 1])
        if any(min(e.onset, e.start) <= last and first <= e.end for e in events):
            continue
        why = [reason for reason in decision.reason[start:stop] if reason]
        when = f"from {moment(run.clock, first, bank.step)} to {moment(run.clock, last, bank.step)}"
        cause = f"; {_usual(why)}" if why else ""
        found.append(Told(first, last, f"An alarm {when} (run {run.name}){cause}"))
    return sorted([*found, *_undecided(bank, decision)])


def _undecided(bank: FaultBank, decision: Decision) -> list[Told]:
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
    shares["something undeclared"] = found.unknown[sampled[-1]]
    cause = max(shares, key=lambda name: np.nan_to_num(shares[name]))
    since = moment(run.clock, float(run.t[first]), bank.step)
    text = (
        f"Undecided since {since}, to the end of the log (run {run.name}): {cause} is likeliest "
        f"(p {probability(float(shares[cause]))}), no fault has p "
        f"{probability(float(found.healthy[sampled[-1]]))}"
    )
    return [Told(float(run.t[first]), float(run.t[sampled[-1]]), text)]


def _usual(reasons: Sequence[str]) -> str:
    return Counter(reasons).most_common(1)[0][0]


def answer(bank: FaultBank, decision: Decision, event: BankEvent) -> str:
    """One event."""
    run, clock = decision.run, decision.run.clock
    half = (event.onset_hi - event.onset_lo) / 2
    since = f"since {moment(clock, event.onset, half)} +- {half:.2g} s"
    until = (
        f"told at {moment(clock, event.start, half)}, seen until {moment(clock, event.end, half)}"
    )
    what = "a fault that is not declared"
    if event.size is not None and event.lo is not None and event.hi is not None:
        width = (event.hi - event.lo) / 2
        size = f"{event.size:+.{_digits(width)}f} +- {width:.2g}"
        what = f"{event.fault} {size} {_unit(bank, event.fault)}".rstrip()
    said = [f"{what} {since} (p {probability(event.p)}, run {event.run})", until]
    for cause, odds in exclusions(bank, event, beside(decision, event)).items():
        more = "more than " if odds >= MOST else ""
        verb = "excluded" if odds >= EXCLUDED else "not excluded,"
        name = "something undeclared" if cause == UNKNOWN else cause
        said.append(
            f"{name} {verb} {more}{odds:.0f}:1" if odds >= 10 else f"{name} {verb} {odds:.2g}:1"
        )
    if event.fault != UNKNOWN:
        k = bank.model.plant.signals.fault_names.index(event.fault)
        if least_told(bank, run, k) is not None:  # else it shows only as the input moves
            said.append(_could_not_tell(bank, run, (event.fault,)))
    return "; ".join(said)


def beside(decision: Decision, event: BankEvent) -> frozenset[str]:
    """The faults that are told for the same time as `event`."""
    return frozenset(
        each.fault
        for each in decision.events
        if each.fault != event.fault and each.onset <= event.end and event.onset <= each.end
    )


def exclusions(bank: FaultBank, event: BankEvent, told: Collection[str] = ()) -> dict[str, float]:
    """Odds of the best explanation at the event's end against each other declared fault alone, and
    against an undeclared one, but for those that are `told` beside it; those beyond 1000 stand at
    1000."""
    names = (*bank.model.plant.signals.fault_names, UNKNOWN)
    others = [n for n in names if n != event.fault and n not in told]
    listed = dict(event.alternatives)
    return {name: min(listed.get(name, MOST), MOST) for name in others}


def least_told(bank: FaultBank, run: Run, fault: int) -> float | None:
    """The size [the fault's unit] that would have been named by the end of `run` had the fault
    begun in its middle; None where none would.

    A fault of size f leaves f^2 / (2 sd^2) of log-likelihood (`knowledge`), which must outweigh the
    prior odds of an onset, and what not knowing the size costs, by the level of an alarm or a name;
    beside the fault that is most like it, as much must be left as a name takes. One that does so 9
    times in 10 is 1.3 sd larger.
    """
    if (fault,) not in bank.sets:
        return None
    half = float(run.t[-1] - run.t[0]) / 2
    others = {k: float(s) for k, s in enumerate(bank.size) if k != fault and (k,) in bank.sets}
    sd, apart = bank.knowledge.at(fault, half), bank.knowledge.apart(fault, half, others)
    size = float(bank.size[fault])
    if not max(sd, apart) < size:
        return None
    named = float(np.log(NAMED / (1 - NAMED)))
    prior = np.log(len(SCALES) / (bank.onset[fault] * 2 * half))
    occam = np.log1p((SCALES[-1] * size / sd) ** 2) / 2
    there = sd * (np.sqrt(2 * max(max(bank.level, named) + prior + occam, 1.0)) + NINE_IN_TEN)
    return float(max(there, apart * (np.sqrt(2 * named) + NINE_IN_TEN)))


def moment(clock: datetime | None, t: float, resolution: float) -> str:
    """`t` [s] as a clock that showed `clock` at 0 s shows it, or as seconds; as fine as
    `resolution` [s] is. With the date where that is another day."""
    if clock is None:
        return f"{round(t, _digits(resolution)):.12g} s"
    at = clock + timedelta(seconds=t)
    date = "" if at.date() == clock.date() else f"{at.date().isoformat()} "
    return date + at.time().isoformat("seconds" if resolution >= 1 else "milliseconds")


def as_dicts(bank: FaultBank, decisions: Sequence[Decision]) -> list[dict[str, Any]]:
    """Every event and what its sentence says, as plain JSON."""
    return [
        plain | _said(bank, each, event)
        for each in decisions
        for plain, event in zip(events_as_dicts(each.events), each.events, strict=True)
    ]


def _said(bank: FaultBank, decision: Decision, event: BankEvent) -> dict[str, Any]:
    clock, run = decision.run.clock, decision.run
    names = bank.model.plant.signals.fault_names
    least = None if event.fault == UNKNOWN else least_told(bank, run, names.index(event.fault))
    return {
        "sentence": answer(bank, decision, event),
        "onset_clock": clock and (clock + timedelta(seconds=event.onset)).isoformat(),
        "excluded": exclusions(bank, event, beside(decision, event)),
        "least": least,
    }


def _could_not_tell(bank: FaultBank, run: Run, only: Sequence[str] = ()) -> str:
    signals = bank.model.plant.signals
    least = []
    for k, name in enumerate(signals.fault_names):
        if only and name not in only:
            continue
        size = least_told(bank, run, k)
        shown = f" below {size:.2g} {_unit(bank, name)}".rstrip() if size is not None else ""
        least.append(f"{name}{shown}" if size is not None else f"any {name}")
    return f"{', '.join(least)} this log could not tell"


def _unit(bank: FaultBank, fault: str) -> str:
    return next(each.unit for each in bank.model.plant.signals.faults if each.name == fault)


def _digits(width: float) -> int:
    """Decimals that show two figures of `width`."""
    return min(max(0, int(np.ceil(-np.log10(width))) + 1), 12) if width > 0 else 6
