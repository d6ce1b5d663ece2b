"""`estimate --smooth`: which fault, how big, since when, with the whole log in hand, and what was
told of it while the log ran."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Float, Int
from scipy.special import logsumexp

from faultgauge.detection.answer.shares import Shares
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
from faultgauge.detection.posterior.verdicts import FAULT
from faultgauge.telemetry.clock import Clock

__all__ = [
    "NO_FAULT",
    "Retrospect",
    "SaidOnline",
    "as_dicts",
    "retrospect",
    "shares_in_hindsight",
]

NO_FAULT = "healthy"
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
    rivals = {NO_FAULT: float(own - logs[0]), UNKNOWN: float(own - logs[2])}
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
    names = (*(fault.name for fault in faults), UNKNOWN, NO_FAULT)
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
    shows = names[k] != NO_FAULT or any(size is not None for size in least.values())
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
