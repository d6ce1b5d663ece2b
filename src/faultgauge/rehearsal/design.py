"""Which faults of which sizes go into which windows: spread evenly, and no more than is asked."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from faultgauge.detection.words import moment
from faultgauge.errors import InputError
from faultgauge.plants.signals import Fault
from faultgauge.rehearsal.ways import Way
from faultgauge.telemetry import Run, cut

__all__ = ["MIDDLE", "Dose", "RehearsalPlan", "Subject", "doses_of", "plans", "windows_of"]

SHORTEST, WINDOW = 200, 2000  # samples of a window
SIZES = np.geomspace(0.25, 16.0, 8)  # times the smallest size that the model foretells
PAIRS = (4.0, 8.0)  # times the smallest size that would be named, of two at once
MIDDLE = (0.2, 0.8)  # of a window: where faults begin


class Dose(NamedTuple):
    """A signed `size` of a fault, `times` the smallest that the model foretells."""

    fault: str
    size: float
    times: float | None


class Subject(NamedTuple):
    """A fault, the `way` it gets into a log, the `smallest` size that the model foretells (None:
    none) and the doses to try."""

    fault: Fault
    way: Way
    smallest: float | None
    doses: tuple[Dose, ...]


class RehearsalPlan(NamedTuple):
    """What goes into which window, each from its own onset [s] on."""

    window: int
    doses: tuple[Dose, ...]
    onsets: tuple[float, ...]


def windows_of(runs: Sequence[Run]) -> tuple[list[Run], list[str]]:
    """(windows of 200 to 2000 samples, a sentence for every run that is too short): a longer run is
    cut into equal ones. Raises `InputError` where none is long enough."""
    found, short = [], []
    for run in runs:
        count = len(run.t)
        if count < SHORTEST:
            short.append(f"run {run.name}: {count} samples are too few ({SHORTEST} at least)")
            continue
        pieces = -(-count // WINDOW)
        length = count // pieces
        for k in range(pieces):
            piece = cut(run, slice(k * length, (k + 1) * length))
            name = run.name if pieces == 1 else f"{run.name} from {_begun(piece)}"
            found.append(replace(piece, name=name))
    if not found:
        raise InputError(
            f"{runs[0].source}: {len(runs[0].t)} samples are too few to rehearse on; give healthy "
            f"logs of {SHORTEST} samples at least, better of {WINDOW}."
        )
    return found, short


def _begun(piece: Run) -> str:
    """When it begins, to the second figure of how long it lasts."""
    return moment(piece.clock, float(piece.t[0]), float(piece.t[-1] - piece.t[0]))


def doses_of(fault: Fault, smallest: float | None, size: float | None) -> tuple[Dose, ...]:
    """Doses of a fault, each sign that its limits allow: the one `size` that was asked for, or 8
    from 0.25 to 16 times the `smallest` size; none where neither is given or the limits forbid."""
    if size is not None:
        sizes = [size]
    elif smallest is not None:
        sizes = [sign * float(each) for each in smallest * SIZES for sign in (1, -1)]
    else:
        return ()
    legal = [each for each in sizes if fault.min <= each <= fault.max]
    return tuple(
        Dose(fault.name, each, abs(each) / smallest if smallest else None) for each in legal
    )


def plans(
    subjects: Sequence[Subject],
    windows: Sequence[Run],
    budget: int,
    legal: Callable[[RehearsalPlan], bool],
    *,
    pairs: bool,
) -> list[RehearsalPlan]:
    """At most `budget` plans that are `legal`, round by round: in each one every size of every
    fault, of alternating signs, and every pair once at 4 and once at 8 times; the windows in turn,
    and onsets at random in their middle. Of the last round as many as fit, evenly."""
    found: list[RehearsalPlan] = []
    k = fruitless = 0
    while len(found) < budget and fruitless < 2 * len(windows):
        given = enumerate(_one_round(subjects, k, pairs))
        good = [plan for i, doses in given if legal(plan := _placed(doses, i, k, windows))]
        fruitless = 0 if good else fruitless + 1
        room = budget - len(found)
        if len(good) > room:
            good = [good[i] for i in np.linspace(0, len(good) - 1, room).round().astype(int)]
        found += good
        k += 1
    return found


def _one_round(subjects: Sequence[Subject], k: int, pairs: bool) -> Iterator[tuple[Dose, ...]]:
    """What round `k` injects."""
    for each in subjects:
        for i, size in enumerate(sorted({abs(dose.size) for dose in each.doses})):
            signed = [dose for dose in each.doses if abs(dose.size) == size]
            yield (signed[(i + k) % len(signed)],)
    if not pairs:
        return
    for j, both in enumerate(combinations([s for s in subjects if s.smallest], 2)):
        for i, times in enumerate(PAIRS):
            signs = (1 if (i + j + k) % 2 else -1, 1 if (i + j + k) // 2 % 2 else -1)
            doses = [_signed(s, times, sign) for s, sign in zip(both, signs, strict=True)]
            if all(doses):
                yield tuple(dose for dose in doses if dose)


def _signed(subject: Subject, times: float, sign: int) -> Dose | None:
    """`times` the smallest size, of the `sign` or, where the limits forbid it, of the other."""
    fault, size = subject.fault, times * (subject.smallest or 0.0)
    legal = [s for s in (sign * size, -sign * size) if fault.min <= s <= fault.max]
    return Dose(fault.name, legal[0], times) if legal else None


def _placed(doses: tuple[Dose, ...], i: int, k: int, windows: Sequence[Run]) -> RehearsalPlan:
    """The i-th of round `k`: its window, and an onset at a sample for each of its faults."""
    at = (k // 2 + i) % len(windows)
    t = windows[at].t
    share = np.random.default_rng([k, i]).uniform(*MIDDLE, len(doses))
    onsets = t[np.searchsorted(t, t[0] + share * (t[-1] - t[0]))]
    return RehearsalPlan(at, doses, tuple(float(each) for each in onsets))
