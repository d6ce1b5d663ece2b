"""Trials as figures: by fault and size, and by pair."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.rehearsal.design import Subject
from faultgauge.rehearsal.result import FaultResult, Figures, InjectedFault, PairResult, Trial
from faultgauge.rehearsal.shares import Share, Smallest, smallest_found, wilson

__all__ = [
    "LARGE",
    "fault_result",
    "fault_results",
    "figures",
    "large",
    "pair_results",
    "smallest_size",
]

LARGE = 4.0 - 1e-9  # times the foretold size: what should be found and named
MOST_GROUPS = 12  # of sizes, of which figures are said


def large(trials: Sequence[Trial]) -> list[Trial]:
    """The trials of one fault of at least 4 times the foretold size."""
    single = [each for each in trials if len(each.answers) == 1]
    return [each for each in single if each.times is not None and each.times >= LARGE]


def fault_results(
    subjects: Sequence[Subject],
    trials: Sequence[Trial],
    refused: Mapping[str, Mapping[str, int]],
    along: Mapping[str, float | None],
) -> tuple[FaultResult, ...]:
    """Figures of every fault, of trials with it alone."""
    found = []
    for each in subjects:
        name = each.fault.name
        mine = [trial for trial in trials if trial.names == (name,)]
        result = fault_result(name, each.fault.unit, each.smallest, mine, along.get(name))
        found.append(replace(result, not_injectable=dict(refused.get(name, {}))))
    return tuple(found)


def fault_result(
    name: str,
    unit: str,
    smallest: float | None,
    trials: Sequence[Trial],
    along: float | None = None,
) -> FaultResult:
    """Figures of `trials` with this fault alone; many sizes are gathered in some."""
    sizes = np.array([abs(trial.answers[0].size) for trial in trials])
    rows = []
    for low, high in _groups(sizes):
        here = (low <= sizes) & (sizes <= high)
        some = [trial for trial, inside in zip(trials, here, strict=True) if inside]
        rows.append(figures(some, float(np.median(sizes[here]))))
    least = smallest_size(sizes, np.array([trial.found for trial in trials], bool))
    most = trials if smallest is None else large(trials)
    return FaultResult(name, unit, smallest, along, least, tuple(rows), figures(most), {})


def smallest_size(
    sizes: Float[np.ndarray, "trials"], found: Bool[np.ndarray, "trials"]
) -> Smallest | None:
    """`smallest_found` of single trials."""
    values, at = np.unique(sizes, return_inverse=True)
    counts = np.bincount(at, weights=found).astype(int)
    return smallest_found(values.tolist(), counts.tolist(), np.bincount(at).tolist())


def _groups(sizes: Float[np.ndarray, "trials"]) -> list[tuple[float, float]]:
    """(least, largest) of at most so many groups of sizes, as many trials in each."""
    values = np.unique(sizes)
    if len(values) <= MOST_GROUPS:
        return [(float(each), float(each)) for each in values]
    parts = np.array_split(np.sort(sizes), MOST_GROUPS)
    return [(float(part[0]), float(part[-1])) for part in parts]


def pair_results(trials: Sequence[Trial]) -> tuple[PairResult, ...]:
    """Figures of every pair at each of its sizes."""
    both = [each for each in trials if len(each.answers) == 2]
    keys = sorted({(each.names, each.times or 0.0) for each in both})
    return tuple(
        PairResult(
            (names[0], names[1]),
            times,
            figures([each for each in both if (each.names, each.times or 0.0) == (names, times)]),
        )
        for names, times in keys
    )


def figures(trials: Sequence[Trial], size: float | None = None) -> Figures:
    """Of `trials`; coverage, size errors and delays are of the faults that were found."""
    answers = [each for trial in trials for each in trial.answers if each.found]
    errors = [each.error for each in answers if each.error is not None]
    delays = [each.delay for each in answers if each.delay is not None]
    sized = [each for each in answers if each.size_covered is not None]

    def share(holds: Callable[[Trial], bool]) -> Share:
        return wilson(sum(holds(each) for each in trials), len(trials))

    def covered(
        some: Sequence[InjectedFault], inside: Callable[[InjectedFault], bool | None]
    ) -> Share:
        return wilson(sum(bool(inside(each)) for each in some), len(some))

    return Figures(
        size=size,
        trials=len(trials),
        alarmed=share(lambda each: each.alarmed),
        found=share(lambda each: each.found),
        exact=share(lambda each: each.exact),
        wrong=share(lambda each: bool(each.wrong)),
        unknown=share(lambda each: each.unknown),
        size_covered=covered(sized, lambda each: each.size_covered),
        onset_covered=covered(answers, lambda each: each.onset_covered),
        error_median=float(np.median(errors)) if errors else None,
        error_p90=float(np.quantile(errors, 0.9)) if errors else None,
        delay_median=float(np.median(delays)) if delays else None,
        instead=dict(Counter(_instead(e) for e in trials if not e.exact)),
    )


def _instead(trial: Trial) -> str:
    """What was told of a log."""
    silent = "an alarm without a name" if trial.alarmed else "nothing"
    return " and ".join(trial.told) or silent
