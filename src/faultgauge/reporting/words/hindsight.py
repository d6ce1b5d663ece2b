"""`estimate --smooth` in sentences: which fault, how big, since when, and what one would have been
told, when."""

from collections.abc import Sequence, Set
from functools import partial

import numpy as np

from faultgauge.detection.answer.shares import WHOLE
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.onset.retrospective import NO_FAULT, Retrospect, shares_in_hindsight
from faultgauge.detection.posterior.events import POSSIBLE, UNKNOWN
from faultgauge.detection.posterior.verdicts import NAMED
from faultgauge.detection.words import (
    TOLD_ODDS,
    UNDECLARED,
    Began,
    amount,
    likelihoods,
    listed,
    moment,
    would_not_show,
)
from faultgauge.plants.signals import spoken
from faultgauge.reporting.words.probability import probability, too
from faultgauge.reporting.words.reliance import headed
from faultgauge.reporting.words.silence import runs_said, why_silent

__all__ = ["onset_of", "sentences"]

CONSTANT = "constant "  # of what a fault that is not is weighed against
PLAIN = 20.0  # odds from which on it goes without saying that there is a fault


def sentences(
    bank: FaultBank, decisions: Sequence[Decision], found: Sequence[Retrospect]
) -> list[str]:
    """What the windows with a fault in them hold, in words; then the runs without one, and of
    which share each run is told."""
    faulty = [
        _sentence(bank, each, _over(each, found), _at_once(each, found))
        for each in found
        if each.cause != NO_FAULT
    ]
    speaking = {each.run for each in found if each.cause != NO_FAULT}
    shares = {one.run.name: shares_in_hindsight(one, found) for one in decisions}
    calm = [name for name, each in shares.items() if each.judged >= WHOLE and name not in speaking]
    said, alone = [], len(decisions) == 1
    if calm:
        where = f" in {runs_said(calm)}" if len(calm) < len(shares) else ""
        none = _no_fault(decisions, calm)
        said.append(f"In hindsight: {none}{where}; {_calm(bank, found, calm)}")
    for one in decisions:
        name, (judged, _, gaps) = one.run.name, shares[one.run.name]
        if judged >= WHOLE:
            continue
        log, why = "log" if alone else f"run {name}", why_silent(bank, one, gaps)
        share = f"{100 * judged:.0f} % of the {log}"
        if judged == 0:
            of = "" if alone else f" of {log}"
            said.append(f"In hindsight: nothing{of} could be judged: {why}")
        elif name in speaking:
            said.append(f"In hindsight {share} could be judged; not judged {why}")
        else:
            said.append(
                f"In hindsight: {_no_fault([one], [name])} in the {share} that could be judged; "
                f"not judged {why}; "
                f"{_calm(bank, found, [name], ' there')}"
            )
    return [headed(bank.model, each) for each in [*faulty, *said]]


def _no_fault(decisions: Sequence[Decision], runs: Sequence[str]) -> str:
    """That there was none in `runs`, but what an output's noise is told to be online."""
    noisy = {
        event.noisy: None
        for each in decisions
        if each.run.name in runs
        for event in each.events
        if event.noisy is not None
    }
    return f"no fault but the noise of {listed(list(noisy))}" if noisy else "no fault"


def _calm(
    bank: FaultBank, found: Sequence[Retrospect], runs: Sequence[str], where: str = ""
) -> str:
    """What the windows of `runs` without a fault would not have shown, `where` not all of them was
    judged, what they leave possible, and what was told in them online."""
    seen = [each for each in found if each.run in runs and each.judged > 0]
    possible, told = dict[str, tuple[float, str]](), []
    for each in seen:
        of = f", run {each.run}" if len(runs) > 1 else ""
        for cause, odds in each.alternatives:
            possible[cause] = max(possible.get(cause, (0.0, "")), (each.p / odds, of))
        if each.told.other is not None:
            cause, when = each.told.other
            at = moment(each.clock, when, float(np.median(np.diff(each.t))))
            told.append(f"{_name(cause)} at {at}{of}")
    there = [
        f"{_name(cause)} (p {probability(p)}{of})"
        for cause, (p, of) in sorted(possible.items(), key=lambda item: -item[1][0])
        if p > POSSIBLE
    ]
    said = [f"{_would_not_show(bank, seen)}{where}"]
    said += [f"there may be {listed(there, 'or')}"] if there else []
    said += [f"online you would have been told {listed(told)}"] if told else []
    return "; ".join(said)


def _name(cause: str) -> str:
    """A cause, or several together, in words."""
    return UNDECLARED if cause == UNKNOWN else cause.replace("+", " and ")


def _would_not_show(bank: FaultBank, found: Sequence[Retrospect]) -> str:
    least = dict[str, tuple[float | None, str]]()
    for fault in bank.model.plant.signals.faults:
        sizes = [each.least[fault.name] for each in found]
        shown = [size for size in sizes if size is not None]
        size = max(shown) if len(shown) == len(sizes) else None
        least[fault.name] = size, spoken(fault.unit)
    return would_not_show(least)


def _over(one: Retrospect, found: Sequence[Retrospect]) -> float | None:
    """When [s] the fault of `one` is no more what it was: in its window, or where the next one
    begins; None where none follows, or where that is nothing that is declared."""
    if one.end < one.t[-1]:
        return one.end
    later = (each for each in found if each.run == one.run and each.start > one.start)
    then = next((each for each in later if each.judged > 0), None)
    if then is None or {*one.cause.split("+"), UNKNOWN} & {*then.cause.split("+")}:
        return None
    return then.start


def _at_once(one: Retrospect, found: Sequence[Retrospect]) -> set[str]:
    """The faults that are told of the same time as `one`."""
    return {
        each.cause
        for each in found
        if each is not one and each.run == one.run and each.cause not in (NO_FAULT, UNKNOWN)
        if each.start < one.end and one.start < each.end
    }


def onset_of(found: Retrospect) -> Began | None:
    """When the fault began, where there is one."""
    if found.onset is None or found.onset_lo is None or found.onset_hi is None:
        return None
    told = np.inf if found.told.start is None else found.told.start
    step = float(np.median(np.diff(found.t)))
    return Began(found.clock, found.onset, found.onset_lo, found.onset_hi, told, step)


def _sentence(
    bank: FaultBank, found: Retrospect, over: float | None = None, others: Set[str] = frozenset()
) -> str:
    """ "In hindsight: friction +0.100 N*m (+0.096 to +0.104) since 41 s +- 6 s until 80 s (p 0.98,
    run 1); leak is 200 times less likely; online you would have been told at 52 s, then as ..." """
    units = {fault.name: fault.unit for fault in bank.model.plant.signals.faults}
    onset = onset_of(found)
    assert onset is not None
    began = onset.since()
    if onset.low <= found.start:
        began = f"since {onset.or_earlier()}"
    if found.size is None or found.lo is None or found.hi is None:
        what = f"{UNDECLARED} or not constant"
    else:
        what = f"{found.cause} {amount(found.size, found.lo, found.hi, units[found.cause])}"
    if over is not None:
        began += f" until {moment(found.clock, over, float(np.median(np.diff(found.t))))}"
    head = "In hindsight:" if found.p >= NAMED else "In hindsight undecided; the likeliest is"
    said = [f"{head} {what} {began} (p {probability(found.p)}, run {found.run})"]
    labels = {NO_FAULT: "no fault", UNKNOWN: UNDECLARED}
    constant, beside = CONSTANT if found.cause == UNKNOWN else "", dict(found.beside)
    labels |= {name: f"{name} alone" for name in {*beside, *others}}
    # whoever is undecided says between what: no name falls while a rival is that likely
    most = PLAIN if found.p >= NAMED else 1 / (1 - NAMED)
    rivals = likelihoods(
        (
            (labels.get(cause, f"{constant}{cause.replace('+', ' and ')}"), odds)
            for cause, odds in found.alternatives
            if (cause != NO_FAULT or odds < most) and (odds < TOLD_ODDS or cause not in beside)
        ),
        most,
    )
    # of causes that are as likely the word is said once
    said += [
        each.replace(f", {CONSTANT}", ", ").replace(f"or {CONSTANT}", "or ")
        if each.startswith(CONSTANT)
        else each
        for each in rivals
    ]
    said += [too(name, p) for name, p in found.beside]
    told = found.told
    step = float(np.median(np.diff(found.t)))
    at = partial(moment, found.clock, resolution=step)
    if told.start is None and told.other is not None:
        cause, when = told.other
        said.append(f"online you would have been told {labels.get(cause, cause)} at {at(when)}")
    elif told.start is None and told.alarm is not None:
        said.append(f"online an alarm would have begun at {at(told.alarm)}")
    elif told.start is None:
        said.append("online you would not have been told")
    elif told.start < onset.low:
        said.append(f"online you would have been told before, at {at(told.start)}")
    else:
        then = ""
        if told.size is not None and told.lo is not None and told.hi is not None:
            then = f", then as {amount(told.size, told.lo, told.hi, units[found.cause])}"
        said.append(f"online you would have been told at {at(told.start)}{then}")
    return "; ".join(said)
