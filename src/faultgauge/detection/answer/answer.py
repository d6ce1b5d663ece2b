"""The answer of the bank as a sentence: which fault, how big, since when, how sure, what else it
may be, and what this log would not have shown.

    friction +0.100 N*m (+0.096 to +0.104) since 08:41:10 +- 6 s (p 0.998, run a); told at 08:41:21,
    seen until 09:00:00; gain is 200 times less likely; friction below 0.0012 N*m would not
    have shown
"""

from collections import Counter, deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from faultgauge.detection.answer.reliance import headed
from faultgauge.detection.answer.shares import WHOLE, Shares, Silent, shares_of
from faultgauge.detection.answer.smallest import smallest_along
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.decisions import as_dicts as events_as_dicts
from faultgauge.detection.posterior.events import UNKNOWN, BankEvent, pause, stretches
from faultgauge.detection.posterior.posterior import LIKELY
from faultgauge.detection.posterior.probability import probability, too
from faultgauge.detection.posterior.uncalibrated import level_in, uncalibrated
from faultgauge.detection.posterior.verdicts import (
    EITHER,
    FAULT,
    HEALTHY,
    NAMED,
    NEARLY,
    NOT_JUDGED,
)
from faultgauge.detection.words import (
    MOST,
    OLDER,
    PURE,
    UNDECLARED,
    amount,
    between,
    likelihoods,
    listed,
    moment,
    number,
    or_earlier,
    since,
    would_not_show,
)
from faultgauge.telemetry.clock import Clock

__all__ = [
    "alarms",
    "answer",
    "answers",
    "as_dicts",
    "finding",
    "first_screen",
    "given_up",
    "least_told",
    "other_cause",
    "runs_as_dicts",
    "told",
]

CHANGED = 0.1  # of an event: for longer its size was another one
SPOKEN = 3  # silent stretches that a sentence names, or reasons of more of them
LITTLE = 0.005  # of a log: what would be said as 0 %
LINES = 4  # of a first screen
SELDOM = 0.5  # of the rows: of a fault that shows in fewer, that is said
# what was asked last: every sentence asks anew
_SMALLEST: deque[tuple[FaultBank, Decision, list[float | None]]] = deque(maxlen=32)


class Told(NamedTuple):
    """What is told of a run from `start` to `end` [s], as a sentence: what a first screen says,
    and the rest; the `causes` that are left of an alarm without a name."""

    start: float
    end: float
    head: str
    rest: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        return "; ".join((self.head, *self.rest))


def answers(bank: FaultBank, decisions: Sequence[Decision]) -> list[str]:
    """A sentence for every event, every alarm without one and every log that ends undecided; one
    for the runs in which there is none of these."""
    found = [each.text for each in told(bank, decisions)]
    return [*found, *_silence(bank, decisions)]


def first_screen(bank: FaultBank, decisions: Sequence[Decision]) -> list[str]:
    """The same in a few lines: what, how big, since when, how sure; of one finding all."""
    found, silent = told(bank, decisions), _silence(bank, decisions)
    if len(found) <= 1:
        return [line for each in found for line in (each.head, "; ".join(each.rest)) if line] + [
            *silent
        ]
    lines = [*(each.head for each in found), *silent]
    more = len(lines) - LINES
    return lines if more <= 0 else [*lines[: LINES - 1], f"and {more + 1} more (--verbose)"]


def told(bank: FaultBank, decisions: Sequence[Decision]) -> list[Told]:
    """Every event, every alarm without one, and what a log ends undecided about, run by run, in the
    order of time."""
    return [each for one in decisions for each in _told(bank, one)]


def _silence(bank: FaultBank, decisions: Sequence[Decision]) -> list[str]:
    """What it means that nothing is told of a run."""
    silent = [one for one in decisions if not _told(bank, one)]
    shares = {one.run.name: shares_of(one) for one in silent}
    whole = [one for one in silent if shares[one.run.name].judged >= WHOLE]
    said = []
    alone = len(decisions) == 1
    if whole:
        where = "" if len(whole) == len(decisions) else f" in {_runs(whole)}"
        seldom = _seldom(bank, [shares[one.run.name] for one in whole])
        text = f"No fault{where}; {_would_not_show(bank, whole)}{seldom}"
        said.append(headed(bank.model, text))
    for one in silent:
        judged, _, gaps = shares[one.run.name]
        log = "log" if alone else f"run {one.run.name}"
        if judged >= WHOLE:
            continue
        why = _why(bank, one, gaps)
        if judged == 0:
            of = "" if alone else f" of {log}"
            said.append(f"Nothing{of} could be judged: {why}{_wide(bank)}")
            continue
        text = (
            f"No fault in the {100 * judged:.0f} % of the {log} that could be judged; not judged "
            f"{why}; {_would_not_show(bank, [one])} there"
        )
        said.append(headed(bank.model, text))
    return said


def _seldom(bank: FaultBank, found: Sequence[Shares]) -> str:
    """Which faults show in few rows only."""
    shares = np.mean([each.faults for each in found], axis=0).tolist()
    names = zip(bank.model.plant.signals.fault_names, shares, strict=True)
    rare = [f"{name} ({100 * share:.0f} %)" for name, share in names if 0 < share < SELDOM]
    return f"; few rows could have shown {listed(rare)}" if rare else ""


def _why(bank: FaultBank, one: Decision, gaps: Sequence[Silent]) -> str:
    """When and why not, of few stretches; of many which share for what reason."""
    if len(gaps) <= SPOKEN:
        return listed([_part(bank, one, each) for each in gaps])
    shares = dict[str, float]()
    for each in gaps:
        reason = each.reason.partition("; ")[0]  # without what the columns were there
        shares[reason] = shares.get(reason, 0.0) + each.share
    largest = sorted(shares.items(), key=lambda each: -each[1])[:SPOKEN]
    parts = [f"{100 * share:.0f} % ({reason})" for reason, share in largest if share >= LITTLE]
    rest = sum(shares.values()) - sum(share for _, share in largest)
    return listed([*parts, "the rest for other reasons"] if rest >= LITTLE else parts)


def _wide(bank: FaultBank) -> str:
    """Why a calibration may leave nothing that shows."""
    if uncalibrated(bank.model) or level_in(bank.model).widened <= 1:
        return ""
    times = number(level_in(bank.model).widened, 2)
    return (
        "; by the healthy logs the model errs more than its noise covers, and a fault must be "
        f"{times} times as large to be told"
    )


def _part(bank: FaultBank, one: Decision, part: Silent) -> str:
    first, last = (_at(bank, one, t) for t in (part.start, part.end))
    return f"from {first} to {last} ({part.reason})"


def _at(bank: FaultBank, one: Decision, t: float) -> str:
    """A row's time, as fine as rows are apart."""
    return moment(one.run.clock, t, bank.step)


def _runs(decisions: Sequence[Decision]) -> str:
    return ", ".join(f"run {one.run.name}" for one in decisions)


def _told(bank: FaultBank, decision: Decision) -> list[Told]:
    found = [answer(bank, decision, each) for each in decision.events]
    return sorted([*found, *_unnamed(bank, decision)])


def _unnamed(bank: FaultBank, decision: Decision) -> list[Told]:
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
            when = f"from {_at(bank, decision, first)} to {_at(bank, decision, last)}"
            why, causes = _why_unnamed(bank, decision, part)
            text = headed(bank.model, f"An alarm {when} (run {run.name}{note}); {why}")
            found.append(Told(first, last, text, causes=causes))
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
            return f"whether {name}, told before, was over is not clear in it", ()
        return f"{name}, named there, was given up", ()
    if not (usual := _usual(why)).startswith((EITHER, NEARLY)):
        return usual, ()
    rows = part.start + np.flatnonzero(np.array(decision.status[part]) == FAULT)
    found, names = decision.posterior, bank.model.plant.signals.fault_names
    p = {UNDECLARED: float(np.mean(found.unknown[rows]))}
    p |= zip(names, np.nan_to_num(found.p[rows]).mean(axis=0).tolist(), strict=True)
    there = np.maximum(found.p[rows].sum(axis=0), 1e-300)
    size = dict(zip(names, found.f[rows].sum(axis=0) / there, strict=True))
    first, second = sorted(p, key=lambda name: -p[name])[:2]

    def told(name: str) -> str:
        of = f" of {size[name]:+.3g} {_unit(bank, name)}".rstrip() if name in size else ""
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
        size = f", {there:+.3g} {_unit(bank, cause)}".rstrip() + " if it is there"
    begun = _at(bank, decision, float(run.t[first]))
    text = (
        f"Undecided from {begun} to the end of the log (run {run.name}{note}): the likeliest fault "
        f"is {cause}{size} (p {probability(float(shares[cause]))}); that nothing is wrong has p "
        f"{probability(float(found.healthy[sampled[-1]]))}"
    )
    return [Told(float(run.t[first]), float(run.t[sampled[-1]]), headed(bank.model, text))]


def _usual(reasons: Sequence[str]) -> str:
    return Counter(reasons).most_common(1)[0][0]


def answer(bank: FaultBank, decision: Decision, event: BankEvent) -> Told:
    """One event."""
    run = decision.run
    unit, over = _unit(bank, event.fault), bool(event.end < run.t[-1])
    head, times = finding(event, unit, bank.step, run.clock, over)
    rest = [times + _whether_over(bank, decision, event)]
    rest += [*_before_its_name(bank, decision, event), *_course(bank, decision, event)]
    rest += [
        f"{UNDECLARED if name == UNKNOWN else name} was named beside it from "
        f"{_at(bank, decision, first)} to {_at(bank, decision, last)}, and given up"
        for name, first, last in given_up(bank, decision, event)
    ]
    others = {each.fault for each in _beside(decision, event)}
    rest += likelihoods(
        (other_cause(event, cause), odds)
        for cause, odds in event.instead
        if cause not in others and (odds < MOST or cause not in dict(event.beside))
    )
    rest += [too(name, p) for name, p in event.beside if name not in others]
    rest += _least_shown(bank, decision, event)
    return Told(event.start, event.end, headed(bank.model, head), tuple(rest))


def finding(
    event: BankEvent, unit: str, step: float, clock: Clock | None = None, over: bool = False
) -> tuple[str, str]:
    """(what, how big, since when, until when if it is `over`, and how sure; when it was told and
    seen last), of rows that are `step` [s] apart."""
    half = (event.onset_hi - event.onset_lo) / 2
    began = since(clock, event.onset, event.onset_lo, event.onset_hi)
    if event.older == "yes":
        began = OLDER
    elif event.older == "perhaps":
        began = f"{or_earlier(clock, event.onset_hi, half)}, perhaps {OLDER}"
    what = UNDECLARED
    if event.size is not None and event.lo is not None and event.hi is not None:
        what = f"{event.fault} {amount(event.size, event.lo, event.hi, unit)}"
    how = "passive, " if event.passive else ""
    told, last = (moment(clock, t, step) for t in (event.start, event.end))
    until = f" until {last}" if over else ""
    return (
        f"{what} {began}{until} ({how}p {probability(event.p)}, run {event.run})",
        f"told at {told}, seen until {last}",
    )


def other_cause(event: BankEvent, cause: str) -> str:
    """What the odds of `event` are against: of what may be there too, that it is there alone."""
    if cause == UNKNOWN:
        return UNDECLARED
    return f"{cause} alone" if cause in dict(event.beside) else cause


def _least_shown(bank: FaultBank, decision: Decision, event: BankEvent) -> list[str]:
    """Below what the fault would not have shown, and in which share of the log; nothing of one that
    shows only as the input moves."""
    judged, names = shares_of(decision).judged, bank.model.plant.signals.fault_names
    share = f"{100 * judged:.0f} % of the log"
    if event.fault == UNKNOWN or least_told(bank, decision, names.index(event.fault)) is None:
        return [f"{share} could be judged"] if judged < WHOLE else []
    small = _would_not_show(bank, [decision], (event.fault,))
    return [f"{small} in the {share} that could be judged" if judged < WHOLE else small]


def given_up(
    bank: FaultBank, decision: Decision, event: BankEvent
) -> list[tuple[str, float, float]]:
    """(fault, from, to [s]) of what rows within `event` name beside it, and no event tells of: of
    its `beside` it is not, at the end."""
    t, found = decision.run.t, decision.posterior
    columns = dict(zip(bank.model.plant.signals.fault_names, found.p.T, strict=True))
    columns[UNKNOWN] = found.unknown
    telling = np.array([why == "" for why in decision.reason]) & (
        np.array(decision.status) == FAULT
    )
    telling &= (t >= event.onset_lo) & (t <= event.end)
    said = []
    for name, p in columns.items():
        rows = telling & (np.nan_to_num(p) >= NAMED) & (name != event.fault)
        for each in decision.events:
            rows &= (each.fault != name) | (t < each.onset_lo) | (t > each.end)
        said += [
            (name, float(t[a]), float(t[b - 1]))
            for a, b in stretches(rows, np.isfinite(found.healthy), pause(bank))
            if b - a > 1
        ]
    return said


def _whether_over(bank: FaultBank, decision: Decision, event: BankEvent) -> str:
    """Of a fault that was not seen to end, why it is not; of one that changed its sign, when that
    was seen: until then rows have it as it was."""
    t = decision.run.t
    turned = [
        each.start
        for each in decision.events
        if each.fault == event.fault and (each.size or 0.0) * (event.size or 0.0) < 0
        if event.end < each.start and abs(each.onset - event.end) <= bank.pause
    ]
    if turned:
        return f", where its sign changed, as was told at {_at(bank, decision, min(turned))}"
    if event.end >= t[-1]:
        return ", the end of the log"
    judged = t[np.isin(decision.status, [HEALTHY, FAULT])]
    return "" if np.any(judged > event.end) else ", and nothing was judged from then on"


def _before_its_name(bank: FaultBank, decision: Decision, event: BankEvent) -> list[str]:
    """Of an alarm that went on for longer than a name takes before the event had one."""
    told = int(np.searchsorted(decision.run.t, event.start))
    status, reason = decision.status[:told], decision.reason[:told]
    over = [k for k in range(told) if status[k] != FAULT or not reason[k]]
    first = over[-1] + 1 if over else 0
    if event.start - decision.run.t[first] <= bank.knowledge.memory:
        return []
    return [f"an alarm without a name came before, at {_at(bank, decision, decision.run.t[first])}"]


def _course(bank: FaultBank, decision: Decision, event: BankEvent) -> list[str]:
    """Between what sizes a fault was told that was of another size for long: rows and event hold
    each other's size for wrong."""
    if event.size is None or event.lo is None or event.hi is None:
        return []
    t, found = decision.run.t, decision.posterior
    k = bank.model.plant.signals.fault_names.index(event.fault)
    sure = (t >= event.start) & (t <= event.end) & (np.nan_to_num(found.p[:, k]) >= NAMED)
    sizes = found.f[sure, k] / found.p[sure, k]
    other = (sizes < event.lo) | (sizes > event.hi)
    other &= (found.lo[sure, k] > event.size) | (found.hi[sure, k] < event.size)
    if np.sum(other) <= CHANGED * len(sizes):
        return []
    low, high = np.quantile(sizes, [0.05, 0.95])
    return [f"after it was told {between(low, high, _unit(bank, event.fault))}"]


def _beside(decision: Decision, event: BankEvent) -> list[BankEvent]:
    """The events of other faults that are told for the same time as `event`."""
    return [
        each
        for each in decision.events
        if each.fault != event.fault and each.onset <= event.end and event.onset <= each.end
    ]


def least_told(bank: FaultBank, decision: Decision, fault: int) -> float | None:
    """The size [the fault's unit] that would have been named by the judged rows of a run had the
    fault begun in the middle of them; None where none would, or it would show in no row."""
    for one, other, sizes in _SMALLEST:
        if one is bank and other is decision:
            return sizes[fault]
    found = smallest_along(bank, decision.run, np.isin(decision.status, [HEALTHY, FAULT]))
    shown = shares_of(decision).faults
    sizes = [size if share else None for size, share in zip(found, shown, strict=True)]
    _SMALLEST.append((bank, decision, sizes))
    return sizes[fault]


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
        unnamed = [] if bank is None else _unnamed(bank, one)
        found[one.run.name] = {
            **shares_of(one).as_dict(dict(zip(faults, least, strict=True))),
            "unnamed": [{"from": e.start, "to": e.end, "sentence": e.text} for e in unnamed],
            "glitches": dict(Counter(each.output for each in one.glitches)),
        }
    return found


def _said(bank: FaultBank, decision: Decision, event: BankEvent) -> dict[str, Any]:
    names = bank.model.plant.signals.fault_names
    least = None if event.fault == UNKNOWN else least_told(bank, decision, names.index(event.fault))
    return {
        "sentence": answer(bank, decision, event).text,
        "least": least,
        "given_up": [
            {"fault": name, "from": first, "to": last}
            for name, first, last in given_up(bank, decision, event)
        ],
    }


def _would_not_show(
    bank: FaultBank, decisions: Sequence[Decision], only: Sequence[str] = ()
) -> str:
    """Below what each fault would not have shown in the least telling of some runs."""
    least = dict[str, tuple[float | None, str]]()
    for k, name in enumerate(bank.model.plant.signals.fault_names):
        if only and name not in only:
            continue
        sizes = [least_told(bank, one, k) for one in decisions]
        shown = [size for size in sizes if size is not None]
        least[name] = max(shown) if len(shown) == len(sizes) else None, _unit(bank, name)
    return would_not_show(least)


def _unit(bank: FaultBank, fault: str) -> str:
    units = {each.name: each.unit for each in bank.model.plant.signals.faults}
    return "" if units.get(fault, "") in PURE else units.get(fault, "")
