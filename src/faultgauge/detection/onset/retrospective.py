"""`estimate --smooth`: which fault, how big, since when, with the whole log in hand, and what one
would have been told, when."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float, Int
from scipy.special import logsumexp

from faultgauge.detection.answer.reliance import headed
from faultgauge.detection.answer.shares import WHOLE, Shares
from faultgauge.detection.answer.silence import runs_said, why_silent
from faultgauge.detection.answer.smallest import smallest_along
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.onset.change_points import total, windows_of
from faultgauge.detection.onset.changes import ChangeHistory, Sized, changes_of
from faultgauge.detection.onset.hindsight_shares import hindsight_shares, readable
from faultgauge.detection.onset.window import Causes, Window
from faultgauge.detection.posterior.events import POSSIBLE, UNKNOWN, pause, stretches
from faultgauge.detection.posterior.inexact import acting
from faultgauge.detection.posterior.over_onsets import onset_over, size_over
from faultgauge.detection.posterior.probability import probability, too
from faultgauge.detection.posterior.verdicts import FAULT, NAMED
from faultgauge.detection.words import (
    MOST,
    UNDECLARED,
    Began,
    amount,
    likelihoods,
    listed,
    moment,
    would_not_show,
)
from faultgauge.plants.signals import spoken
from faultgauge.telemetry.clock import Clock

__all__ = [
    "HEALTHY",
    "Retrospect",
    "SaidOnline",
    "as_dicts",
    "onset_of",
    "retrospect",
    "sentences",
    "shares_in_hindsight",
]

HEALTHY = "healthy"
CONSTANT = "constant "  # of what a fault that is not is weighed against
PLAIN = 20.0  # odds from which on it goes without saying that there is a fault
MOST_ODDS = 1e6  # nobody's priors are better than that

Curve: TypeAlias = Float[np.ndarray, "samples"]
# mean and the ends of its interval [s]
Onset: TypeAlias = tuple[float, float, float] | tuple[None, None, None]


@dataclass(frozen=True)
class SaidOnline:
    """What the bank said while the log ran: `alarm` [s], its first FAULT of the window; `start`
    [s], when it named this cause, and the `size` with its interval that it gave then (None where
    that was before this change of it); `other` and when [s], what it named where it never named
    this."""

    alarm: float | None
    start: float | None
    size: float | None
    lo: float | None
    hi: float | None
    other: tuple[str, float] | None = None


@dataclass(frozen=True)
class Retrospect:
    """A fault in a window of a run from its onset until `end`, or that there is none; all figures
    given that `cause` is right but `p`.

    Times in s, size in the fault's unit, intervals of 95 %; None where there is none: onset and
    size of a healthy window, the size of an undeclared fault. An onset lies between two samples,
    so its interval spans both. `least` is for each declared fault the size that would have been
    named had it begun in the middle of what was judged of the window, which is a share `judged` of
    its run; None where nothing would have shown it. `beside` are faults that may be there too, each
    with its p if what is told of the window is there.
    `density` is the posterior of the onset per sample of `t`, and `given` the size for each onset:
    an onset at sample n acts from sample n - 1 on; `white` the innovations of the
    healthy filter and `fit` the fault's part of them, in standard deviations; NaN where an output
    was not sampled or not believed.
    """

    run: str
    start: float
    end: float
    cause: str
    p: float
    onset: float | None
    onset_lo: float | None
    onset_hi: float | None
    size: float | None
    lo: float | None
    hi: float | None
    alternatives: tuple[tuple[str, float], ...]
    least: dict[str, float | None]
    judged: float
    told: SaidOnline
    t: Curve
    density: Curve
    given: Curve
    white: Float[np.ndarray, "samples outputs"]
    fit: Float[np.ndarray, "samples outputs"]
    clock: Clock | None = None
    beside: tuple[tuple[str, float], ...] = ()


def retrospect(bank: FaultBank, decision: Decision) -> list[Retrospect]:
    """What every window of a judged run holds, in order."""
    found = []
    for window in windows_of(bank, decision):
        found += _answers(bank, decision, window, changes_of(bank, decision, window))
    return found


def _answers(
    bank: FaultBank, decision: Decision, window: Window, changes: ChangeHistory
) -> list[Retrospect]:
    """The likeliest of: nothing; the declared changes; something undeclared, be it beside them."""
    declared = len(bank.onset)
    alien = total(changes.alone.weight[:, declared:])
    beside = changes.weight + total(changes.more.weight[:, declared:])
    single = len(changes.found) < 2  # then each single change is weighed
    change = total(changes.alone.weight[:, :declared]) if single else changes.weight
    logs = np.array([0.0, change, np.logaddexp(alien, beside)])
    best = int(np.argmax(logs)) if changes.found else 2 * int(logs[2] > 0)
    own = changes.weight if best == 1 else logs[best]
    share = float(np.exp(own - total(logs)))
    rivals = {HEALTHY: float(own - logs[0]), UNKNOWN: float(own - logs[2])}
    if best == 1:
        sure = [1.0 if single else _among(each, declared) for each in changes.found]
        beside = _beside(bank, changes)
        return _until(
            [
                replace(
                    _answer(bank, decision, window, each.causes, each, share * p, rivals),
                    beside=beside,
                )
                for each, p in zip(changes.found, sure, strict=True)
            ]
        )
    names = bank.model.plant.signals.fault_names
    # what is beside a declared change is in `best`: one change alone is weighed against that, too
    rivals |= {name: float(own - total(changes.alone.weight[:, k])) for k, name in enumerate(names)}
    if not single:
        rivals[_together(names, changes)] = float(own - changes.weight)
    which = None if best == 0 else _begun(changes, declared, float(np.exp(beside - logs[2])))
    return [_answer(bank, decision, window, changes.alone, which, share, rivals)]


def _beside(bank: FaultBank, changes: ChangeHistory) -> tuple[tuple[str, float], ...]:
    """Faults that may be there besides those that are known to change, each with its p: one of
    them, something undeclared, or none of all is there."""
    names = bank.model.plant.signals.fault_names
    known = {each.change.fault for each in changes.found}
    legal = [k for k in range(len(names)) if k not in known and _legal(bank, {*known, k})]
    more = [total(changes.more.weight[:, k]) for k in legal]
    every = total(np.array([0.0, *more, total(changes.more.weight[:, len(names) :])]))
    p = np.exp(np.array(more) - every)
    return tuple(
        (names[k], float(each)) for k, each in zip(legal, p, strict=True) if each > POSSIBLE
    )


def _legal(bank: FaultBank, faults: set[int]) -> bool:
    """Whether these may be present together."""
    return tuple(sorted(faults)) in bank.sets


def _among(each: Sized, declared: int) -> float:
    """How likely a change beside others is that one, and no other nor none."""
    weights = each.causes.weight
    logs = [*(total(column) for column in weights.T[:declared]), total(weights[:, declared:]), 0.0]
    return float(np.exp(logs[each.change.fault] - total(np.array(logs))))


def _begun(changes: ChangeHistory, declared: int, beside: float) -> Curve:
    """When it began, if something undeclared is there: beside the declared changes, of which the
    first may be earlier, or else alone."""
    alone = _density(changes.alone.weight[:, declared:])
    if not changes.found:
        return alone
    there = [_density(each.causes.weight[:, each.change.fault]) for each in changes.found]
    both = _earliest([*there, _density(changes.more.weight[:, declared:])])
    return beside * both + (1 - beside) * alone


def _density(weight: Float[np.ndarray, "samples ..."]) -> Curve:
    """The posterior of one onset per sample, of ln weights of onsets, or onsets and causes."""
    by_onset = weight if weight.ndim == 1 else logsumexp(weight, axis=1)
    return np.exp(by_onset - total(by_onset))


def _earliest(densities: Sequence[Curve]) -> Curve:
    """That of the first of several onsets."""
    later = np.prod([np.cumsum(each[::-1])[::-1] for each in densities], axis=0)  # P(none before n)
    return np.clip(later - np.append(later[1:], 0.0), 0.0, None)


def _together(names: Sequence[str], changes: ChangeHistory) -> str:
    """The faults that change, once each: "leak", "leak+gauge"."""
    return "+".join(dict.fromkeys(names[each.change.fault] for each in changes.found))


def _answer(
    bank: FaultBank,
    decision: Decision,
    window: Window,
    causes: Causes,
    which: Sized | Curve | None,
    share: float,
    rivals: dict[str, float],
) -> Retrospect:
    """One change; `which` is it, or when what is undeclared began, or None: healthy."""
    faults, count = bank.model.plant.signals.faults, len(window.t)
    names = (*(fault.name for fault in faults), UNKNOWN, HEALTHY)
    columns = [*causes.weight.T[: len(faults)], logsumexp(causes.weight[:, len(faults) :], axis=1)]
    logs = np.array([*(total(column) for column in columns), 0.0])
    density, given, size = np.zeros(count), np.zeros(count), (None,) * 3
    fit = np.zeros((count, len(bank.model.plant.signals.outputs)))
    k = len(faults) + 1 if which is None else len(faults)
    if isinstance(which, Sized):
        k, fit = which.change.fault, which.fit
    if isinstance(which, np.ndarray):
        density = which
    if isinstance(which, Sized):
        density = np.exp(columns[k] - logs[k])
        given = causes.mean[:, k] + which.before
        own = bank.gain * acting(faults)[k] * np.abs(given)
        sd = np.hypot(causes.sd[:, k] * which.wider, own)
        size = size_over(density, given, sd, faults[k].min, faults[k].max)
    onset = onset_over(window.t, density)
    onset = _since_its_alarm(bank, decision, window, onset) if names[k] == UNKNOWN else onset
    heard = np.isfinite(window.record.y[:count])
    alike = bank.like(k) if isinstance(which, Sized) else set[int]()
    used = np.flatnonzero(readable(decision)[window.part])
    least = _least(bank, decision, window, used)
    # where no size of anything would show, that nothing showed says nothing
    shows = names[k] != HEALTHY or any(size is not None for size in least.values())
    data = causes.seen[min(k, len(faults))]
    return Retrospect(
        run=decision.run.name,
        start=float(window.t[0]),
        end=float(window.t[-1]),
        cause=names[k],
        p=share / (1 + len(alike)),
        onset=onset[0],
        onset_lo=onset[1],
        onset_hi=onset[2],
        size=size[0],
        lo=size[1],
        hi=size[2],
        alternatives=_alternatives(names, logs, which, k, rivals, alike),
        least=least,
        judged=len(used) / len(decision.run.t) if shows else 0.0,
        told=_told(bank, decision, window.part, names[k], onset, size[0]),
        t=window.t,
        density=density,
        given=given,
        white=np.where(heard, (np.asarray(data.white) + np.asarray(data.fit))[:count], np.nan),
        fit=np.where(heard, fit, np.nan),
        clock=decision.run.clock,
    )


def _since_its_alarm(bank: FaultBank, decision: Decision, window: Window, onset: Onset) -> Onset:
    """The `onset` of what is undeclared or not constant, which dates the likeliest jump of it: one
    that lies amid an alarm is as old as that, as `events` has it."""
    t, (_, low, high) = window.t, onset
    if low is None or high is None:
        return onset
    alarm = np.array(decision.status[window.part]) == FAULT
    sampled = np.isfinite(decision.posterior.healthy[window.part])
    for first, stop in stretches(alarm, sampled, pause(bank)):
        begun = float(t[first])
        if begun < low <= t[stop - 1]:
            return begun, max(begun - bank.knowledge.memory, float(t[0])), high
    return onset


def _alternatives(
    names: tuple[str, ...],
    logs: Float[np.ndarray, "causes"],
    which: Sized | Curve | None,
    k: int,
    rivals: dict[str, float],
    alike: set[int],
) -> tuple[tuple[str, float], ...]:
    """(cause, odds of cause `k` against it), the likeliest first: by the `rivals` of the whole
    answer; of one change beside known ones also against what else it may be, even with what is
    `alike`."""
    apart = {name: gap for name, gap in rivals.items() if name != names[k]}
    if isinstance(which, Sized):
        for m in range(len(names)):
            if m != k:
                gap = 0.0 if m in alike else float(logs[k] - logs[m])
                apart[names[m]] = min(apart.get(names[m], gap), gap)
    odds = {name: min(float(np.exp(min(gap, 100.0))), MOST_ODDS) for name, gap in apart.items()}
    return tuple(sorted(odds.items(), key=lambda item: item[1]))


def _until(found: list[Retrospect]) -> list[Retrospect]:
    """Each level until the next change of its fault; a change back to nothing only ends one."""
    kept = []
    for j, each in enumerate(found):
        gone = each.lo is not None and each.hi is not None and each.lo <= 0 <= each.hi
        if gone and any(other.cause == each.cause for other in found[:j]):
            continue
        later = [o.onset for o in found[j + 1 :] if o.cause == each.cause and o.onset is not None]
        kept.append(replace(each, end=min([each.end, *later])))
    return kept


def _least(
    bank: FaultBank, decision: Decision, window: Window, used: Int[np.ndarray, "_"]
) -> dict[str, float | None]:
    """The size of each fault that would have been named by the samples that were `used` had it
    begun in the middle of them."""
    rows = np.zeros(len(decision.run.t), bool)
    rows[window.part.start + used] = True
    faults = bank.model.plant.signals.fault_names
    return dict(zip(faults, smallest_along(bank, decision.acting, rows), strict=True))


def _told(
    bank: FaultBank,
    decision: Decision,
    part: slice,
    cause: str,
    onset: Onset,
    size: float | None,
) -> SaidOnline:
    """What was told of `cause`: of its events with the sign of `size` the one that is dated nearest
    to the `onset`."""
    t, found = decision.run.t, decision.posterior
    alarms = np.flatnonzero(np.array(decision.status[part]) == FAULT)
    alarm = float(t[part][alarms[0]]) if len(alarms) else None
    first, last = t[part][0], t[part][-1]
    inside = [e for e in decision.events if first <= e.start <= last]
    named = [
        e
        for e in inside
        if e.fault == cause and (size is None or e.size is None or e.size * size >= 0)
    ]
    if onset[0] is None or not named:
        began = onset[0] or 0.0
        at = sorted(inside, key=lambda e: abs(e.onset - began))
        other = next(((e.fault, e.start) for e in at if e.fault != cause), None)
        return SaidOnline(alarm, None, None, None, None, other)
    middle, low, _ = onset
    start = min(named, key=lambda e: abs(e.onset - middle)).start
    if cause == UNKNOWN or start < low:
        return SaidOnline(alarm, start, None, None, None)
    k = bank.model.plant.signals.fault_names.index(cause)
    n = int(np.searchsorted(t, start))
    size = float(found.f[n, k] / found.p[n, k])
    return SaidOnline(alarm, start, size, float(found.lo[n, k]), float(found.hi[n, k]))


def shares_in_hindsight(decision: Decision, found: Sequence[Retrospect]) -> Shares:
    """How much of a run hindsight judged, by what was `found` in its windows."""
    run = decision.run.name
    return hindsight_shares(
        decision,
        [(float(e.t[0]), float(e.t[-1]), e.judged > 0) for e in found if e.run == run],
    )


def sentences(
    bank: FaultBank, decisions: Sequence[Decision], found: Sequence[Retrospect]
) -> list[str]:
    """What the windows with a fault in them hold, in words; then the runs without one, and of
    which share each run is told."""
    after = [*found[1:], None]
    faulty = [
        _sentence(bank, each, _over(each, then))
        for each, then in zip(found, after, strict=True)
        if each.cause != HEALTHY
    ]
    speaking = {each.run for each in found if each.cause != HEALTHY}
    shares = {one.run.name: shares_in_hindsight(one, found) for one in decisions}
    calm = [name for name, each in shares.items() if each.judged >= WHOLE and name not in speaking]
    said, alone = [], len(decisions) == 1
    if calm:
        where = f" in {runs_said(calm)}" if len(calm) < len(shares) else ""
        said.append(f"In hindsight: no fault{where}; {_calm(bank, found, calm)}")
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
                f"In hindsight: no fault in the {share} that could be judged; not judged {why}; "
                f"{_calm(bank, found, [name], ' there')}"
            )
    return [headed(bank.model, each) for each in [*faulty, *said]]


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


def _over(found: Retrospect, then: Retrospect | None) -> float | None:
    """When [s] a window begins in which its fault is over; None where none follows."""
    calm = then is not None and then.cause == HEALTHY and then.judged > 0
    if then is None or then.run != found.run or not calm:
        return None
    return then.start


def onset_of(found: Retrospect) -> Began | None:
    """When the fault began, where there is one."""
    if found.onset is None or found.onset_lo is None or found.onset_hi is None:
        return None
    told = np.inf if found.told.start is None else found.told.start
    step = float(np.median(np.diff(found.t)))
    return Began(found.clock, found.onset, found.onset_lo, found.onset_hi, told, step)


def _sentence(bank: FaultBank, found: Retrospect, over: float | None = None) -> str:
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
    labels = {HEALTHY: "no fault", UNKNOWN: UNDECLARED}
    constant, beside = CONSTANT if found.cause == UNKNOWN else "", dict(found.beside)
    labels |= {name: f"{name} alone" for name in beside}
    # whoever is undecided says between what: no name falls while a rival is that likely
    most = PLAIN if found.p >= NAMED else 1 / (1 - NAMED)
    rivals = likelihoods(
        (
            (labels.get(cause, f"{constant}{cause.replace('+', ' and ')}"), odds)
            for cause, odds in found.alternatives
            if (cause != HEALTHY or odds < most) and (odds < MOST or cause not in beside)
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

    def at(t: float) -> str:
        return moment(found.clock, t, step)

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


def as_dicts(found: Sequence[Retrospect]) -> list[dict[str, Any]]:
    """Without curves and clock, as plain JSON; of a window in which nothing could be judged there
    is no cause."""
    left = ("t", "density", "given", "white", "fit", "clock")
    return [
        {name: value for name, value in asdict(each).items() if name not in left}
        | {"alternatives": [{"cause": c, "odds": o} for c, o in each.alternatives]}
        | {"beside": dict(each.beside)}
        | ({} if each.judged > 0 else {"cause": None, "p": None, "alternatives": []})
        for each in found
    ]
