"""The answer of the bank, run by run: its sentences, and the same as plain JSON."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

from faultgauge.detection.answer.evidence import MOST_SHOWN
from faultgauge.detection.answer.least import least_told
from faultgauge.detection.answer.shares import shares_of
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.decisions import as_dicts as events_as_dicts
from faultgauge.detection.posterior.events import UNKNOWN, BankEvent
from faultgauge.detection.words import listed
from faultgauge.reporting.words.alternating import together, turns
from faultgauge.reporting.words.event_sentence import given_up, told_event
from faultgauge.reporting.words.silence import hidden, silence
from faultgauge.reporting.words.telling import Told
from faultgauge.reporting.words.unnamed import unnamed

__all__ = [
    "answers",
    "as_dicts",
    "first_screen",
    "headline",
    "runs_as_dicts",
    "shown_first",
    "told",
]

LINES = 5  # of a first screen


def answers(bank: FaultBank, decisions: Sequence[Decision]) -> list[str]:
    """A sentence for every event, every alarm without one and every log that ends undecided; one
    for the runs in which there is none of these."""
    return [*(each.text for each in told(bank, decisions)), *_untold(bank, decisions)]


def first_screen(bank: FaultBank, decisions: Sequence[Decision]) -> list[str]:
    """The same in a few lines: what, how big, since when, how sure; of one finding all. Of many
    the others are listed by name, and what the other logs say stands beneath."""
    found, silent = told(bank, decisions), _untold(bank, decisions)
    if len(found) <= 1:
        return [line for each in found for line in (each.head, "; ".join(each.rest)) if line] + [
            *silent
        ]
    heads = [each.head for each in found]
    if len(heads) + len(silent) <= LINES:
        return [*heads, *silent]
    last = silent[: LINES // 2]
    first = heads[: LINES - 1 - len(last)]
    more = len(heads) - len(first) + len(silent) - len(last)
    names = _listed(bank, decisions, len(first))
    return [*first, f"and {more} more (--verbose){names}", *last]


def _listed(bank: FaultBank, decisions: Sequence[Decision], said: int) -> str:
    """What is found behind the first `said`, by name: ": leak; run b: gauge and an alarm"."""
    all_told = [(one.run.name, each.brief) for one in decisions for each in _told(bank, one)]
    runs = dict[str, dict[str, None]]()
    for run, brief in all_told[said:]:
        runs.setdefault(run, {})[brief] = None
    parts = [
        listed(list(names)) if len(decisions) == 1 else f"run {run}: {listed(list(names))}"
        for run, names in runs.items()
    ]
    return f": {'; '.join(parts)}" if parts else ""


def told(bank: FaultBank, decisions: Sequence[Decision]) -> list[Told]:
    """Every event, every alarm without one, and what a log ends undecided about, run by run, in the
    order of time."""
    return [each for one in decisions for each in _told(bank, one)]


def headline(bank: FaultBank, decisions: Sequence[Decision]) -> tuple[Decision, Told] | None:
    """What a report says first, and of which run: the first event that lasts at least half as long
    as the longest one, else an alarm; None where nothing is told."""
    found = [(one, each) for one in decisions for each in _told(bank, one)]
    events = [(one, each) for one, each in found if each.event] or found
    longest = max((each.end - each.start for _, each in events), default=0.0)
    return next(((o, e) for o, e in events if e.end - e.start >= longest / 2), None)


def shown_first(
    bank: FaultBank, decisions: Sequence[Decision], asked: Sequence[BankEvent] = ()
) -> list[tuple[Decision, BankEvent]]:
    """The events whose evidence a report shows: the headline's, those `asked` for, the first."""
    said = headline(bank, decisions)
    every = [(one, event) for one in decisions for event in one.events]
    first = said[1].event if said else None
    return sorted(every, key=lambda each: (each[1] is not first, each[1] not in asked))[:MOST_SHOWN]


def _untold(bank: FaultBank, decisions: Sequence[Decision]) -> list[str]:
    """What runs do not say of faults, and what it means that nothing is told of others."""
    speaks = [bool(_told(bank, one)) for one in decisions]
    speaking = [one for one, does in zip(decisions, speaks, strict=True) if does]
    silent = [one for one, does in zip(decisions, speaks, strict=True) if not does]
    count = len(decisions)
    return [*hidden(bank, speaking, count), *silence(bank, silent, count)]


def _told(bank: FaultBank, decision: Decision) -> list[Told]:
    turning = turns(decision.events)
    found = [together(bank, own, decision.run.clock) for own in turning.values()]
    found += [told_event(bank, decision, e) for e in decision.events if e.fault not in turning]
    return sorted([*found, *unnamed(bank, decision)], key=lambda each: each[:3])


def as_dicts(bank: FaultBank, decisions: Sequence[Decision]) -> list[dict[str, Any]]:
    """Every event and what its sentence says, as plain JSON."""
    return [
        plain | _said(bank, each, event)
        for each in decisions
        for plain, event in zip(
            events_as_dicts(each.events, each.run.clock), each.events, strict=True
        )
    ]


def runs_as_dicts(
    bank: FaultBank | None, decisions: Sequence[Decision], faults: Sequence[str]
) -> dict[str, Any]:
    """What was judged of every run, the smallest size of each of `faults` that it would have told
    (None: none), and what stands in no event, as plain JSON; there is no `bank` where nothing was
    calibrated."""
    found = dict[str, Any]()
    for one in decisions:
        least = [None if bank is None else least_told(bank, one, k) for k in range(len(faults))]
        without = [] if bank is None else unnamed(bank, one)
        found[one.run.name] = {
            **shares_of(one).as_dict(dict(zip(faults, least, strict=True))),
            "unnamed": [{"from": e.start, "to": e.end, "sentence": e.text} for e in without],
            "glitches": dict(Counter(each.output for each in one.glitches)),
        }
    return found


def _said(bank: FaultBank, decision: Decision, event: BankEvent) -> dict[str, Any]:
    names = bank.model.plant.signals.fault_names
    least = None if event.fault == UNKNOWN else least_told(bank, decision, names.index(event.fault))
    return {
        "sentence": told_event(bank, decision, event).text,
        "least": least,
        "given_up": [
            {"fault": name, "from": first, "to": last}
            for name, first, last in given_up(bank, decision, event)
        ],
    }
