"""Figures of merit, each defined once; `docs/figures_of_merit.md` says them in words.

The unit is the run: samples of one run are not independent, so intervals are over runs.
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.stats import beta, chi2

from faultgauge.detection.posterior.events import BankEvent

__all__ = [
    "Dated",
    "Interval",
    "alarm_rate",
    "alarms",
    "coverage",
    "dated",
    "edges_of",
    "exact_set",
    "found_after",
    "intervals_right",
    "mean_of_runs",
    "overshoots",
    "rms",
    "rmse",
    "settled",
    "settling_times",
    "share",
    "wrong_names",
]

CONFIDENCE = 0.95
DRAWS = 2000  # of runs, for the interval of a mean over runs

Samples: TypeAlias = Float[np.ndarray, "samples"]
Mask: TypeAlias = Bool[np.ndarray, "samples"]


class Interval(NamedTuple):
    """A figure and its 95 % interval over runs."""

    value: float
    lo: float
    hi: float


def edges_of(truth: Samples) -> Int[np.ndarray, "edges"]:
    """The samples at which a piecewise constant fault jumps."""
    return np.flatnonzero(np.diff(truth)) + 1


def settled(t: Samples, edges: Int[np.ndarray, "edges"], after: float) -> Mask:
    """Samples at least `after` [s] behind the last jump and behind the run's first sample."""
    starts = np.array([0, *edges], int)
    last = starts[np.searchsorted(starts, np.arange(len(t)), side="right") - 1]
    return t - t[last] >= after


def rms(x: Float[Array | np.ndarray, "*n"]) -> float:
    """sqrt(mean x^2)."""
    return float(np.sqrt(np.mean(np.square(x))))


def rmse(f: Samples, truth: Samples, scored: Mask) -> float:
    """Root mean square of estimate less truth over the samples `scored`, in the fault's unit."""
    return rms((f - truth)[scored])


def settling_times(
    t: Samples, f: Samples, truth: Samples, edges: Int[np.ndarray, "edges"], band: float = 0.05
) -> Float[np.ndarray, "edges"]:
    """Seconds from each jump until |f - truth| stays within `band` of the jump, to the next jump
    or the end; inf where it never does."""
    found = np.full(len(edges), np.inf)
    for k, (start, stop) in enumerate(zip(edges, [*edges[1:], len(t)], strict=True)):
        jump = truth[start] - truth[start - 1]
        outside = np.flatnonzero(np.abs((f - truth)[start:stop]) > band * abs(jump))
        after = start + (outside[-1] + 1 if len(outside) else 0)
        if after < stop:
            found[k] = t[after] - t[start]
    return found


def overshoots(
    t: Samples, f: Samples, truth: Samples, edges: Int[np.ndarray, "edges"], within: float
) -> Float[np.ndarray, "edges"]:
    """The farthest that the estimate goes beyond each jump in the first `within` [s] after it, as
    a share of the jump; 0 where it does not."""
    found = np.zeros(len(edges))
    for k, (start, stop) in enumerate(zip(edges, [*edges[1:], len(t)], strict=True)):
        jump = truth[start] - truth[start - 1]
        beyond = ((f - truth)[start:stop] / jump)[t[start:stop] < t[start] + within]
        found[k] = max(float(beyond.max()), 0.0)
    return found


def found_after(told: Sequence[float], onset: float) -> float:
    """Delay [s] from the onset until the fault is first named: `told` are the times at which an
    event of this fault was told; inf where none comes at or after the onset."""
    return min((t for t in told if t >= onset), default=np.inf) - onset


class Dated(NamedTuple):
    """Whether an event's 95 % onset interval holds the true onset, and its length [s]."""

    inside: bool
    width: float


def dated(
    events: Sequence[BankEvent], fault: str, onset: float, until: float = np.inf
) -> Dated | None:
    """The first event that names `fault`, told before `until` and not over before its `onset` [s];
    None where there is none."""
    for event in sorted(events, key=lambda event: event.start):
        if event.fault == fault and event.end >= onset and event.start < until:
            inside = event.onset_lo <= onset <= event.onset_hi
            return Dated(bool(inside), event.onset_hi - event.onset_lo)
    return None


def alarms(status: Sequence[str]) -> int:
    """Alarms of a run: uninterrupted stretches of the status FAULT, each counted once."""
    alarm = np.array([each == "FAULT" for each in status], int)
    return int(np.sum(np.diff(alarm, prepend=0) == 1))


def alarm_rate(count: int, exposure: float) -> Interval:
    """False alarms per unit of healthy `exposure` (hours, samples); the interval is Garwood's
    (Biometrika 28 (1936)), exact for a Poisson count: none in N proves only a rate below 3.7/N,
    or 3/N as a one-sided bound."""
    tail = (1 - CONFIDENCE) / 2
    low = chi2.ppf(tail, 2 * count) / 2 if count else 0.0
    return Interval(
        count / exposure,
        float(low) / exposure,
        float(chi2.ppf(1 - tail, 2 * count + 2) / 2) / exposure,
    )


def share(right: Sequence[bool]) -> Interval:
    """The share of runs of which something holds; the interval is Clopper's and Pearson's
    (Biometrika 26 (1934))."""
    count, hits, tail = len(right), int(sum(right)), (1 - CONFIDENCE) / 2
    low = beta.ppf(tail, hits, count - hits + 1) if hits else 0.0
    high = beta.ppf(1 - tail, hits + 1, count - hits) if hits < count else 1.0
    return Interval(hits / count, float(low), float(high))


def coverage(lo: Samples, hi: Samples, truth: Samples | float, scored: Mask) -> float:
    """The share of one run's samples `scored` whose interval holds the truth; NaN for none."""
    inside = (lo <= truth) & (truth <= hi)
    return float(inside[scored].mean()) if scored.any() else np.nan


def mean_of_runs(
    values: Float[np.ndarray, "runs"], weights: Float[np.ndarray, "runs"] | None = None
) -> Interval:
    """Mean of a figure over runs (`weights`: samples behind each); runs without one are left out.

    The interval is the percentile bootstrap's, which draws whole runs (Efron, "Bootstrap
    Methods", Ann. Statist. 7 (1979)).
    """
    kept = np.isfinite(values)
    x, w = values[kept], (np.ones(len(values)) if weights is None else weights)[kept]
    rng = np.random.default_rng(0)
    picks = rng.integers(len(x), size=(DRAWS, len(x)))
    draws = np.sum((w * x)[picks], axis=1) / np.maximum(np.sum(w[picks], axis=1), 1e-300)
    low, high = np.quantile(draws, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Interval(float(np.average(x, weights=w)), float(low), float(high))


def exact_set(said: Collection[str], truth: Collection[str]) -> bool:
    """Whether the faults with p >= 0.5 at a run's end are those that act, no more and no fewer."""
    return set(said) == set(truth)


def wrong_names(named: Collection[str], truth: Collection[str]) -> bool:
    """Whether any event of a run names a declared fault that does not act in it."""
    return bool(set(named) - set(truth))


def intervals_right(
    status: Sequence[str], truth: Samples, edges: Int[np.ndarray, "edges"], scored: Mask
) -> Bool[np.ndarray, "intervals"]:
    """For each stretch between two jumps, whether every sample `scored` in it has the right status:
    FAULT where the fault acts, HEALTHY where it does not. One wrong sample is a wrong stretch."""
    states = np.array(status)
    found = []
    for start, stop in zip([0, *edges], [*edges, len(truth)], strict=True):
        wanted = "FAULT" if truth[start] else "HEALTHY"
        found.append(bool(np.all(states[start:stop][scored[start:stop]] == wanted)))
    return np.array(found)
