"""One run of a campaign: what was put in and what was said of it, as one row of plain cells."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.campaigns.design import RunPlan
from faultgauge.campaigns.right import Right
from faultgauge.campaigns.schema import label
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.events import POSSIBLE, stretches
from faultgauge.detection.posterior.verdicts import FAULT, HEALTHY, log_odds
from faultgauge.rehearsal.design import Dose, RehearsalPlan
from faultgauge.rehearsal.judging import UNKNOWN, Judge, Judgement
from faultgauge.rehearsal.rehearse import score
from faultgauge.rehearsal.result import InjectedFault, Trial
from faultgauge.simulation.schedules import Schedule

__all__ = [
    "LEVELS",
    "OTHERWISE",
    "SILENT",
    "SLOTS",
    "SPLIT",
    "UNDECIDED",
    "Case",
    "Row",
    "row_of",
    "times_of",
    "trial_of",
]

# log-odds of a fault at which an alarm might begin; calibration asks for 2.9 at least
LEVELS = (
    *(-10.0, -8.0, -6.0, -5.0, -4.0, -3.0, -2.0, -1.0, 0.0, 1.0),
    *(2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 50.0, 100.0),
)
SLOTS = ("", "_2")  # of the faults of a run
SPLIT = "+"  # between names
# an answer that is no name: both of a pair and no other, several names, an alarm without one ...
OTHERWISE = BOTH, SEVERAL, UNDECIDED, SILENT, NOTHING = (
    "both", "several", "undecided", "not judged", "nothing",
)  # fmt: skip
UNJUDGED = 0.5  # of the rows with the fault: more of them unjudged, and the run was not

Row: TypeAlias = dict[str, Any]
Samples: TypeAlias = Float[np.ndarray, "samples"]


class Case(NamedTuple):
    """A run with its `faults` as schedules, what is `right` of each kind, its `constants`, and for
    every declared fault the size that is foretold from each onset on."""

    run: RunPlan
    faults: Sequence[Schedule]
    right: Sequence[Right]
    constants: Mapping[str, float]
    foretold: Sequence[Mapping[str, float | None]]


def row_of(case: Case, judge: Judge, decision: Decision) -> Row:
    """The row of one run."""
    run, said = case.run, judge.told(decision)
    seen = _Seen(judge, decision, min(run.onsets, default=np.inf))
    row: Row = {
        "run": run.number,
        "kind": label(run.kinds),
        "seed": run.seed,
        "noise": run.noise,
        **{f"plant_{name}": value for name, value in case.constants.items()},
    }
    sizes = [_foretold(case, k) for k in range(len(run.kinds))]
    for k, (kind, suffix) in enumerate(zip(run.kinds, SLOTS, strict=False)):
        row[f"fault{suffix}"] = kind.name
        row[f"size{suffix}"] = None if kind.size is None else run.sizes[k]
        row[f"onset{suffix}"] = run.onsets[k]
        row[f"foretold{suffix}"] = sizes[k]
    row |= seen.healthy_part(said)
    row |= seen.faulty_part(case.faults)
    nuisance = not run.kinds or any(not right.names for right in case.right)
    trial = None if nuisance else _trial(case, said, sizes)
    told = dict.fromkeys(each.fault for each in said.events if each.told >= seen.first)
    row["told"] = SPLIT.join(told)
    row["exact"] = (not told) if trial is None else trial.exact
    row["answer"] = BOTH if row["exact"] and len(told) == 2 else _answer(tuple(told), row)
    if trial is not None:
        for k, (answer, suffix) in enumerate(zip(trial.answers, SLOTS, strict=False)):
            row |= _said(answer, suffix)
            row |= seen.along(case.right[k], case.faults[k], answer, suffix)
    row["early"] = sum(each.told < seen.first for each in said.events)
    row["not_judged"] = said.not_judged
    return row


def trial_of(row: Row, right: Mapping[str, Right]) -> Trial | None:
    """A row as a trial, in the names that its kinds go by; None where nothing should be named."""
    kinds = [row[f"fault{suffix}"] for suffix in SLOTS if row.get(f"fault{suffix}") is not None]
    if not kinds or any(not right[kind].names for kind in kinds):
        return None
    answers = tuple(
        InjectedFault(
            right[kind].name,
            row[f"size{suffix}"] or np.nan,
            row[f"onset{suffix}"],
            times_of(row[f"size{suffix}"], row[f"foretold{suffix}"]),
            row[f"delay{suffix}"],
            row[f"estimate{suffix}"],
            row[f"size_inside{suffix}"],
            row[f"onset_inside{suffix}"],
        )
        for kind, suffix in zip(kinds, SLOTS, strict=False)
    )
    told: list[str] = [each for each in row["told"].split(SPLIT) if each]
    known = {name: right[kind].name for kind in kinds for name in right[kind].names}
    names = tuple(dict.fromkeys(known.get(each, each) for each in told))
    return Trial(
        row["run"], row["kind"], answers, names, row["alarmed"], row["early"], row["not_judged"]
    )


def _foretold(case: Case, k: int) -> float | None:
    """The sheet speaks of constant faults alone."""
    sized = case.right[k].sized
    return case.foretold[k][sized] if sized and case.run.kinds[k].constant else None


def times_of(size: float | None, foretold: float | None) -> float | None:
    """How many times as large as `foretold` a fault's `size` is; None where either is unknown."""
    return abs(size) / foretold if size and foretold else None


def _trial(case: Case, said: Judgement, foretold: Sequence[float | None]) -> Trial:
    """What `said` makes of the faults: every name that counts as right becomes the first of them,
    and only a name of the very fault has a size."""
    run = case.run
    known = {name: right for right in case.right for name in right.names}
    events = []
    for event in said.events:
        right = known.get(event.fault)
        sized = right is not None and event.fault == right.sized
        nothing = {} if sized else {"size": None, "lo": None, "hi": None}
        name = event.fault if right is None else right.name
        events.append(event._replace(fault=name, **nothing))
    doses = tuple(
        Dose(right.name, size if right.sized else np.nan, times_of(size, least))
        for right, size, least in zip(case.right, run.sizes, foretold, strict=True)
    )
    planned = RehearsalPlan(0, doses, run.onsets)
    return score(run.number, label(run.kinds), planned, said._replace(events=tuple(events)))


def _said(answer: InjectedFault, suffix: str) -> Row:
    return {
        f"delay{suffix}": answer.delay,
        f"estimate{suffix}": answer.estimate,
        f"error{suffix}": answer.error,
        f"size_inside{suffix}": answer.size_covered,
        f"onset_inside{suffix}": answer.onset_covered,
    }


def _answer(told: tuple[str, ...], row: Row) -> str:
    """What the run comes to, in a word: a name, or one of `OTHERWISE`."""
    if told:
        return told[0] if len(told) == 1 else SEVERAL
    if row["alarmed"]:
        return UNDECIDED
    return SILENT if (row["silent"] or 0.0) > UNJUDGED else NOTHING


class _Seen:
    """What a decision holds before and after the `first` onset [s]."""

    def __init__(self, judge: Judge, decision: Decision, first: float) -> None:
        self.judge, self.decision, self.first = judge, decision, first
        self.t, self.step = decision.run.t, decision.run.step
        self.judged = np.isin(decision.status, [HEALTHY, FAULT])
        scores = np.asarray(log_odds(decision.posterior.calm), float)
        self.scores: Samples = np.where(self.judged, scores, -np.inf)
        self.names = (*judge.model.plant.signals.fault_names, UNKNOWN)

    def healthy_part(self, said: Judgement) -> Row:
        """Before the first onset: hours that were judged and alarms, also at every level."""
        before = self.t < self.first
        return {
            "healthy_hours": float(np.sum(self.judged & before)) * self.step / 3600,
            "false_alarms": sum(start < self.first for start, _ in said.alarms),
            **{f"false_at_{level:g}": self._alarms(before, level) for level in LEVELS},
        }

    def _alarms(self, rows: Bool[np.ndarray, "samples"], level: float) -> int:
        """In `rows`: one begins at `level` and ends below `release`, or below a lower level."""
        release = self.judge.model.plant.signals.detection.release
        above = (self.scores >= min(level, np.log(release / (1 - release)))) & rows
        sampled = np.isfinite(self.decision.posterior.healthy)
        parts = stretches(above, sampled, self.judge.pause)
        return sum(bool(self.scores[start:stop].max() >= level) for start, stop in parts)

    def faulty_part(self, faults: Sequence[Schedule]) -> Row:
        """From the first onset on: alarms, also at every level, and what was believed at the last
        judged row at which all faults act (of a healthy run at its last)."""
        after = self.t >= self.first
        status = np.array(self.decision.status)
        alarm = np.flatnonzero(after & (status == FAULT))
        row: Row = {"alarmed": bool(len(alarm)), "alarm_after": self._since(alarm)}
        for level in LEVELS:
            there = np.flatnonzero(after & (self.scores >= level))
            row[f"alarm_after_at_{level:g}"] = self._since(there)
        row["silent"] = float(np.mean(~self.judged[after])) if after.any() else None
        at = self._last(faults)
        found = self.decision.posterior
        p = [*found.p[at], found.unknown[at]] if at is not None else [np.nan] * len(self.names)
        row |= {f"p_{name}": _cell(each) for name, each in zip(self.names, p, strict=True)}
        row["p_healthy"] = None if at is None else _cell(found.healthy[at])
        possible = [name for name, each in zip(self.names, p, strict=True) if each >= POSSIBLE]
        row["possible"] = SPLIT.join(possible)
        return row

    def along(self, right: Right, fault: Schedule, answer: InjectedFault, suffix: str) -> Row:
        """Rows in which the fault acts since it was named, how many of their intervals hold its
        size, and their median width."""
        if right.sized is None or answer.delay is None:
            return {f"rows{suffix}": 0, f"rows_inside{suffix}": 0, f"width{suffix}": None}
        k = self.names.index(right.sized)
        named = self.t >= answer.onset + answer.delay
        here = self.judged & named & fault.profile.active(self.t)
        lo, hi = self.decision.posterior.lo[here, k], self.decision.posterior.hi[here, k]
        size = fault.profile.sizes(self.t[here])
        return {
            f"rows{suffix}": int(here.sum()),
            f"rows_inside{suffix}": int(np.sum((lo <= size) & (size <= hi))),
            f"width{suffix}": _cell(np.median(hi - lo)) if here.any() else None,
        }

    def _since(self, rows: np.ndarray) -> float | None:
        return float(self.t[rows[0]] - self.first) if len(rows) else None

    def _last(self, faults: Sequence[Schedule]) -> int | None:
        acting = self.judged.copy()
        for each in faults:
            acting &= each.profile.active(self.t)
        rows = np.flatnonzero(acting)
        return int(rows[-1]) if len(rows) else None


def _cell(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
