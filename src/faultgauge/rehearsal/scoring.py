"""Trials as figures: by fault and size, and by pair."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from faultgauge.rehearsal.design import Subject
from faultgauge.rehearsal.result import Answer, FaultResult, Figures, PairResult, Trial
from faultgauge.rehearsal.shares import Share, smallest_found, wilson

__all__ = ["LARGE", "fault_results", "figures", "large", "pair_results"]

LARGE = 4.0 - 1e-9  # times the foretold size: what should be found and named


def large(trials: Sequence[Trial]) -> list[Trial]:
    """The trials of one fault of at least 4 times the foretold size."""
    single = [each for each in trials if len(each.answers) == 1]
    return [each for each in single if each.times is not None and each.times >= LARGE]


def fault_results(
    subjects: Sequence[Subject],
    trials: Sequence[Trial],
    refused: Mapping[str, Mapping[str, int]],
) -> tuple[FaultResult, ...]:
    """Figures of every fault, of trials with it alone."""
    found = []
    for each in subjects:
        name = each.fault.name
        mine = [trial for trial in trials if trial.names == (name,)]
        sizes = sorted({abs(trial.answers[0].size) for trial in mine})
        rows = [
            figures([trial for trial in mine if abs(trial.answers[0].size) == size], size)
            for size in sizes
        ]
        least = smallest_found(sizes, [r.found.count for r in rows], [r.trials for r in rows])
        most = mine if each.smallest is None else large(mine)
        reasons = dict(refused.get(name, {}))
        found.append(
            FaultResult(
                name, each.fault.unit, each.smallest, least, tuple(rows), figures(most), reasons
            )
        )
    return tuple(found)


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

    def covered(some: Sequence[Answer], inside: Callable[[Answer], bool | None]) -> Share:
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
        instead=dict(Counter(" and ".join(e.told) or "nothing" for e in trials if not e.exact)),
    )
