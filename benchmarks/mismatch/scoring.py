"""One judged log against what was injected, and the figures over many of them.

Names, onset and delay are those of `docs/figures_of_merit.md`; the unit is the log.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.events import UNKNOWN
from faultgauge.detection.posterior.verdicts import FAULT, NOT_JUDGED
from faultgauge_studies import merit
from mismatch.case import Injected

__all__ = ["Found", "Trial", "figures", "scored", "wilson"]

LIKELY = 0.5  # p of a fault from which on it stands at a log's end


@dataclass(frozen=True)
class Found:
    """A fault that acts and was named: the last event's size as a share of the truth, less 1; half
    its interval as such a share; whether the interval holds the truth (these three are None of
    what is not declared); whether the first event's onset interval holds the onset; and the delay
    [s] until it was told."""

    error: float | None
    half: float | None
    sized: bool | None
    dated: bool
    delay: float


@dataclass(frozen=True)
class Trial:
    """One log. `rule` is how its faults were sized, `truth` what acts by its right name.

    `exact`: the names told over the whole log, "unknown" among them, are those that act.
    `exact_at_end`: the faults with p >= 0.5 at the end are those that still act. `wrong`: an event
    names a declared fault that does not act, or not yet, or no more. `missed`: how many that act
    no event names. `unknown`: an event of something undeclared where nothing undeclared acts.
    `early`: an alarm before the first onset (healthy: any).
    `nameless`: an alarm, and no event.
    """

    run: str
    rule: str
    truth: dict[str, Injected]
    names: tuple[str, ...]
    exact: bool
    exact_at_end: bool
    wrong: bool
    missed: int
    unknown: bool
    early: bool
    nameless: bool
    not_judged: float
    found: dict[str, Found]


def scored(
    decision: Decision, faults: Sequence[str], truth: Mapping[str, Injected], rule: str
) -> Trial:
    """`decision` on a log in which `truth` acts; `faults` are the plant's, in its order."""
    events = decision.events
    named = {event.fault for event in events}
    status, t = np.array(decision.status), decision.run.t
    end = decision.posterior.p[-1]
    standing = [name for name, p in zip(faults, end, strict=True) if p >= LIKELY]
    lasting = {name for name, each in truth.items() if each.end > t[-1]}
    wrong = any(
        event.fault != UNKNOWN
        and (
            event.fault not in truth
            or event.end < truth[event.fault].onset
            or event.onset_lo > truth[event.fault].end
        )
        for event in events
    )
    first = min((each.onset for each in truth.values()), default=np.inf)
    alarm = status == FAULT
    early = bool(alarm[t < first].any()) or any(event.start < first for event in events)
    found = {name: _found(decision, name, each) for name, each in truth.items()}
    kept = {name: each for name, each in found.items() if each is not None}
    return Trial(
        run=decision.run.name,
        rule=rule,
        truth=dict(truth),
        names=tuple(sorted(named)),
        exact=named == set(truth) and not wrong,
        exact_at_end=merit.exact_set(standing, lasting - {UNKNOWN}),
        wrong=wrong,
        missed=len(truth) - len(kept),
        unknown=UNKNOWN in named and UNKNOWN not in truth,
        early=early,
        nameless=bool(alarm.any()) and not events,
        not_judged=float(np.mean(status == NOT_JUDGED)),
        found=kept,
    )


def _found(decision: Decision, name: str, injected: Injected) -> Found | None:
    """None where no event names it from its onset on."""
    events = [e for e in decision.events if e.fault == name and e.end >= injected.onset]
    if not events:
        return None
    dated = merit.dated(decision.events, name, injected.onset)
    assert dated is not None
    delay = max(min(event.start for event in events) - injected.onset, 0.0)
    last, scale = max(events, key=lambda event: event.end), abs(injected.size)
    if last.size is None or last.lo is None or last.hi is None:
        return Found(None, None, None, dated.inside, delay)
    return Found(
        error=(last.size - injected.size) / scale,
        half=(last.hi - last.lo) / 2 / scale,
        sized=bool(last.lo <= injected.size <= last.hi),
        dated=dated.inside,
        delay=delay,
    )


def wilson(right: Sequence[bool]) -> dict[str, Any]:
    """A share with Wilson's 95 % interval (J. Am. Stat. Assoc. 22 (1927)); None for none."""
    if not right:
        return {"hits": 0, "of": 0, "share": None, "lo": None, "hi": None}
    hits, count = int(sum(right)), len(right)
    interval = binomtest(hits, count).proportion_ci(method="wilson")
    lo, hi = float(interval.low), float(interval.high)
    return {"hits": hits, "of": count, "share": hits / count, "lo": lo, "hi": hi}


def figures(healthy: Sequence[Trial], faulty: Sequence[Trial]) -> dict[str, Any]:
    """The case's figures as plain JSON: shares of logs, and of named faults."""
    found = [each for trial in faulty for each in trial.found.values()]
    errors = [abs(each.error) for each in found if each.error is not None]
    halves = [each.half for each in found if each.half is not None]
    groups: dict[str, Callable[[Trial], bool]] = {
        "singles": lambda trial: len(trial.truth) == 1,
        "pairs": lambda trial: len(trial.truth) == 2,
    }
    for rule in sorted({trial.rule for trial in faulty}):
        groups[f"sized {rule}"] = lambda trial, rule=rule: trial.rule == rule
    return {
        "exact": wilson([trial.exact for trial in faulty]),
        "exact_of": {
            name: wilson([trial.exact for trial in faulty if holds(trial)])
            for name, holds in groups.items()
        },
        "exact_at_end": wilson([trial.exact_at_end for trial in faulty]),
        "wrong": wilson([trial.wrong for trial in faulty]),
        "missed": wilson([trial.missed > 0 for trial in faulty]),
        "unknown": wilson([trial.unknown for trial in faulty]),
        "nameless": wilson([trial.nameless for trial in faulty]),
        "early": wilson([trial.early for trial in faulty]),
        "healthy_alarm": wilson([trial.early for trial in healthy]),
        "not_judged": {
            "healthy": _quantile([trial.not_judged for trial in healthy], None),
            "faulty": _quantile([trial.not_judged for trial in faulty], None),
        },
        "size_error": {
            "median": _quantile(errors, 0.5),
            "p90": _quantile(errors, 0.9),
        },
        "half_width": {"median": _quantile(halves, 0.5)},
        "size_covered": wilson([each.sized for each in found if each.sized is not None]),
        "onset_covered": wilson([each.dated for each in found]),
        "delay_s": {"median": _quantile([each.delay for each in found], 0.5)},
    }


def _quantile(values: Sequence[float], q: float | None) -> float | None:
    """The quantile, or the mean for None; None of nothing."""
    if not values:
        return None
    return float(np.mean(values) if q is None else np.quantile(values, q))
