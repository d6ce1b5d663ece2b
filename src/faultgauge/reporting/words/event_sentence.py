"""The sentence of an event: which fault, how big, since when, how sure, what else it may be.

friction +0.100 N*m (+0.096 to +0.104) since 08:41:10 +- 6 s (p 0.998, run a); told at 08:41:21,
seen until 09:00:00; gain is 200 times less likely; friction below 0.0012 N*m would not
have shown
"""

from collections.abc import Sequence, Set

import numpy as np

from faultgauge.detection.answer.least import least_told
from faultgauge.detection.answer.shares import WHOLE, shares_of
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.events import UNKNOWN, BankEvent, pause, stretches
from faultgauge.detection.posterior.verdicts import FAULT, HEALTHY, NAMED, is_sure
from faultgauge.detection.words import (
    OLDER,
    TOLD_ODDS,
    UNDECLARED,
    Began,
    amount,
    between,
    likelihoods,
    listed,
    moment,
)
from faultgauge.reporting.words.probability import probability, too
from faultgauge.reporting.words.reliance import headed
from faultgauge.reporting.words.telling import Told, row_time, unit_of, would_not_show_in
from faultgauge.telemetry.clock import Clock

__all__ = ["called", "finding", "given_up", "onset_of", "other_cause", "told_event"]

CHANGED = 0.1  # of an event: for longer its size was another one


def told_event(bank: FaultBank, decision: Decision, event: BankEvent) -> Told:
    """One event."""
    run = decision.run
    unit, over = unit_of(bank.model, event.fault), bool(event.end < run.t[-1])
    head, times = finding(event, unit, bank.step, run.clock, over)
    rest = [times + _whether_over(bank, decision, event)]
    rest += _before_its_name(bank, decision, event)
    dropped = given_up(bank, decision, event)
    rest += _named_beside(bank, decision, dropped)
    others = {each.fault for each in _beside(decision, event)}
    once = {name for name, *_ in dropped}
    rivals = [each for each in event.rivals if each[0] not in others]
    others |= {name for name, _ in rivals}
    rest += likelihoods(
        (other_cause(event, cause, once), odds)
        for cause, odds in event.instead
        if cause not in others and (odds < TOLD_ODDS or cause not in once | {*dict(event.beside)})
    )
    rest += _left_possible(bank, rivals)
    rest += [too(name, p) for name, p in event.beside if name not in others | once]
    rest += _least_shown(bank, decision, event)
    brief = UNDECLARED if event.fault == UNKNOWN else event.fault
    head += _course(bank, decision, event)
    if rivals:
        head += f", or {listed([name for name, _ in rivals], 'or')} by the model's own error"
    head = headed(bank.model, head)
    return Told(event.start, event.end, head, tuple(rest), brief=brief, event=event)


def finding(
    event: BankEvent, unit: str, step: float, clock: Clock | None = None, over: bool = False
) -> tuple[str, str]:
    """(what, how big, since when, until when if it is `over`, and how sure; when it was told and
    seen last), of rows that are `step` [s] apart."""
    onset = onset_of(event, step, clock)
    began = onset.since()
    if event.older == "yes":
        began = OLDER
    elif event.older == "perhaps":
        began = f"since {onset.or_earlier()}, perhaps {OLDER}" + "," * over
    what = called(event)
    if event.size is not None and event.lo is not None and event.hi is not None:
        what = f"{event.fault} {amount(event.size, event.lo, event.hi, unit)}"
    how = "passive, " if event.passive else ""
    told, last = (moment(clock, t, step) for t in (event.start, event.end))
    until = f" until {last}" if over else ""
    return (
        f"{what} {began}{until} ({how}p {probability(event.p)}, run {event.run})",
        f"told at {told}, seen until {last}",
    )


def called(event: BankEvent) -> str:
    """The fault of `event`; of what is undeclared, whose noise it is, where it is that."""
    if event.fault != UNKNOWN:
        return event.fault
    if event.noisy is None:
        return UNDECLARED
    return f"{UNDECLARED} ({event.noisy} has far more noise than in healthy logs)"


def onset_of(event: BankEvent, step: float, clock: Clock | None) -> Began:
    """When `event` began, of rows that are `step` [s] apart."""
    return Began(clock, event.onset, event.onset_lo, event.onset_hi, event.start, step)


def other_cause(event: BankEvent, cause: str, named: Set[str] = frozenset()) -> str:
    """What the odds of `event` are against: of what may be there too, or was `named` beside it,
    that it is there alone."""
    if cause == UNKNOWN:
        return UNDECLARED
    return f"{cause} alone" if cause in named | {*dict(event.beside)} else cause


def _left_possible(bank: FaultBank, rivals: Sequence[tuple[str, float]]) -> list[str]:
    """What the model's own error leaves possible."""
    if not rivals:
        return []
    off = f"{100 * bank.shape:.0f} %"
    return [f"with an answer as far off as in healthy logs ({off}), {listed(likelihoods(rivals))}"]


def _least_shown(bank: FaultBank, decision: Decision, event: BankEvent) -> list[str]:
    """Below what the fault would not have shown, and in which share of the log; nothing of one that
    shows only as the input moves."""
    judged, names = shares_of(decision).judged, bank.model.plant.signals.fault_names
    share = f"{100 * judged:.0f} % of the log"
    least = None if event.fault == UNKNOWN else least_told(bank, decision, names.index(event.fault))
    # one that was told is no smaller than what shows, whatever is foretold
    if least is None or event.size is None or abs(event.size) < least:
        return [f"{share} could be judged"] if judged < WHOLE else []
    small = would_not_show_in(bank, [decision], (event.fault,))
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


def _named_beside(
    bank: FaultBank, decision: Decision, dropped: Sequence[tuple[str, float, float]]
) -> list[str]:
    """What was `given_up`, each cause once."""
    spans = dict[str, list[tuple[float, float]]]()
    for name, first, last in dropped:
        spans.setdefault(UNDECLARED if name == UNKNOWN else name, []).append((first, last))
    said = []
    for name, each in spans.items():
        first, last = (row_time(bank, decision, t) for t in (each[0][0], each[-1][1]))
        when = f"from {first} to {last}"
        if len(each) > 1:
            when = f"{len(each)} times between {first} and {last}"
        said.append(f"{name} was named beside it {when}, and given up")
    return said


def _whether_over(bank: FaultBank, decision: Decision, event: BankEvent) -> str:
    """Of a fault that was not seen to end, why it is not; of one that changed its sign, when that
    was seen: until then rows have it as it was; of one that another fault took the place of, as no
    more are told at once, which."""
    t = decision.run.t
    turned = [
        each.start
        for each in decision.events
        if each.fault == event.fault and (each.size or 0.0) * (event.size or 0.0) < 0
        if event.end < each.start and abs(each.onset - event.end) <= bank.pause
    ]
    if turned:
        return f", where its sign changed, as was told at {row_time(bank, decision, min(turned))}"
    if event.end >= t[-1]:
        return ", the end of the log"
    instead = _in_its_place(bank, decision, event)
    if instead == UNKNOWN:
        return (
            f", where {UNDECLARED} came, beside which no fault is followed, so {event.fault} may "
            "have gone on"
        )
    if instead:
        most = max(map(len, bank.sets))
        at_once = f"{most} faults are" if most > 1 else "one fault is"
        return (
            f", where {instead} came: no more than {at_once} told at once, as max_simultaneous "
            f"has it, so {event.fault} may have gone on"
        )
    judged = t[np.isin(decision.status, [HEALTHY, FAULT])]
    return "" if np.any(judged > event.end) else ", and nothing was judged from then on"


def _in_its_place(bank: FaultBank, decision: Decision, event: BankEvent) -> str:
    """What came as `event` ended: something undeclared, or the fault since when as many are told as
    the bank follows."""
    others = [each for each in decision.events if event.fault not in (each.fault, UNKNOWN)]
    came = [each for each in others if each.onset_lo <= event.end <= each.start + bank.pause]
    if any(each.fault == UNKNOWN for each in came):
        return UNKNOWN
    for each in came:
        there = {e.fault for e in others if e.fault != UNKNOWN and e.start <= each.start <= e.end}
        if len(there) >= max(map(len, bank.sets)):
            return each.fault
    return ""


def _before_its_name(bank: FaultBank, decision: Decision, event: BankEvent) -> list[str]:
    """Of an alarm that was without a name for longer than one takes before the event had it; one
    that was before the fault began is another one's."""
    told = int(np.searchsorted(decision.run.t, event.start))
    status, reason = decision.status[:told], decision.reason[:told]
    over = [k for k in range(told) if status[k] != FAULT or not reason[k]]
    first = over[-1] + 1 if over else 0
    begun = float(decision.run.t[first])
    if begun < event.onset_lo or event.start - begun <= bank.knowledge.memory:
        return []
    return [f"from {row_time(bank, decision, begun)} until it was told the alarm had no name"]


def _course(bank: FaultBank, decision: Decision, event: BankEvent) -> str:
    """Between what sizes a fault was told that was of another size for long: rows and event hold
    each other's size for wrong."""
    if event.size is None or event.lo is None or event.hi is None:
        return ""
    t, found = decision.run.t, decision.posterior
    k = bank.model.plant.signals.fault_names.index(event.fault)
    sure = is_sure(np.nan_to_num(found.p[:, k]), found.calm, event.passive)
    sure = (t >= event.start) & (t <= event.end) & np.asarray(sure)
    sizes = found.f[sure, k] / found.p[sure, k]
    other = (sizes < event.lo) | (sizes > event.hi)
    other &= (found.lo[sure, k] > event.size) | (found.hi[sure, k] < event.size)
    if np.sum(other) <= CHANGED * len(sizes):
        return ""
    low, high = np.quantile(sizes, [0.05, 0.95])
    return f", after it was told {between(low, high, unit_of(bank.model, event.fault))}"


def _beside(decision: Decision, event: BankEvent) -> list[BankEvent]:
    """The events of other faults that are told for the same time as `event`."""
    return [
        each
        for each in decision.events
        if each.fault != event.fault and each.onset <= event.end and event.onset <= each.end
    ]
