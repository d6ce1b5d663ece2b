"""The events of a run: the stretches in which a fault was named, and what is told of each."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.bank import FaultBank
from faultgauge.detection.levels import MEMORY
from faultgauge.detection.onset import EARLIEST, Evidence, Lasting, longest_delay, onset_of
from faultgauge.detection.posterior import Posterior
from faultgauge.detection.verdicts import FAULT, NAMED, Verdict, log_odds
from faultgauge.plants.plant import Plant
from faultgauge.telemetry import Run, segments

__all__ = ["FEWEST", "PAUSE", "UNKNOWN", "BankEvent", "Judged", "events", "stretches"]

UNKNOWN = "unknown"
PAUSE = 10  # samples below `release` that do not end an event
ROUNDS = 3  # of dating faults that lie close, each beside the others
FEWEST = 1e-3  # odds below which an alternative is not listed


@dataclass(frozen=True)
class BankEvent:
    """A stretch in which a fault was named. Times in s; size in the fault's unit with its 95 %
    interval, given that the fault is there (None for an undeclared one).

    `start` is when it was told, `onset` when it began; size, p and the rest stand at the last
    sample at which the fault did not change. `alternatives` are other sets of faults, with the
    odds of the best set against them; a `passive` fault raised no alarm.
    """

    run: str
    fault: str
    start: float
    end: float
    size: float | None
    lo: float | None
    hi: float | None
    p: float
    onset: float
    onset_lo: float
    onset_hi: float
    alternatives: tuple[tuple[str, float], ...]
    passive: bool = False


class Judged(NamedTuple):
    """Samples of a run, their inputs as they act, with what the bank says of them: `p` of all
    modes; `plant` has the run's own parameters."""

    plant: Plant
    run: Run
    found: Posterior
    verdict: Verdict
    p: Float[np.ndarray, "samples modes"]


class _Stretch(NamedTuple):
    """Cause `k` from sample `noticed`, `told`, until before `stop`; `calm` as its alarm sees it."""

    k: int
    noticed: int
    told: int
    stop: int
    calm: Float[np.ndarray, "samples"]


def events(bank: FaultBank, judged: Judged, since: float, first: int = 0) -> list[BankEvent]:
    """The stretches, from sample `first` on, in which a fault was named; no event before them ends
    after `since` [s], which is where the log begins if there is none."""
    found = sorted(_stretches(bank, judged, first), key=lambda each: (each.told, each.k))
    if not found:
        return []
    signals = bank.model.plant.signals
    trusted = judged.found.inside | (np.array(judged.verdict.status) == FAULT)
    evidence = Evidence(judged.plant, judged.run, judged.found.x, trusted)
    parts = segments(judged.run, signals.input_names or bank.outputs)
    sizes = [_size(bank, judged, each) for each in found]
    windows = [_window(bank, evidence, parts, found, sizes, j, since) for j in range(len(found))]
    onsets = _onsets(bank, evidence, found, sizes, windows)
    return [
        _event(bank, judged, each, *size, onset)
        for each, size, onset in zip(found, sizes, onsets, strict=True)
    ]


def _stretches(bank: FaultBank, judged: Judged, first: int) -> list[_Stretch]:
    found, verdict = judged.found, judged.verdict
    columns = np.concatenate([found.p, found.unknown[:, None]], axis=1)
    release, sampled = bank.model.plant.signals.detection.release, np.isfinite(found.healthy)
    sampled[:first] = False
    passive = np.append(bank.with_monitor("passive"), False)
    everyone = []
    for k in range(columns.shape[1]):
        calm = found.healthy if passive[k] else found.calm
        likely = (np.nan_to_num(columns[:, k]) >= release) & (1 - np.nan_to_num(calm) >= release)
        above = likely | verdict.named[:, k]
        for start, stop in stretches(above & sampled, sampled):
            named = np.flatnonzero(verdict.named[start:stop, k])
            if len(named):
                told = start + int(named[0])
                noticed = _noticed(bank, found, calm, k, start, told)
                everyone.append(_Stretch(k, noticed, told, stop, calm))
    return everyone


class _Window(NamedTuple):
    """The samples that may tell an onset; it is after `since` [s], and at most `late` samples
    before them."""

    part: slice
    since: float
    late: int


def _window(
    bank: FaultBank,
    evidence: Evidence,
    parts: list[slice],
    found: list[_Stretch],
    sizes: list[tuple[float | None, int]],
    j: int,
    since: float,
) -> _Window:
    t, each, size = evidence.run.t, found[j], sizes[j][0]
    late = each.told - each.noticed
    if size is not None:
        late = longest_delay(bank, each.k, size)
    reach = min(MEMORY + late, EARLIEST)
    since = max([since, *(float(t[o.stop - 1]) for o in found if o.stop <= each.noticed)])
    part = next(part for part in parts if part.start <= each.noticed < part.stop)
    begin = max(part.start, each.noticed - reach, int(np.searchsorted(t, since)))
    begin += int(np.flatnonzero(np.isfinite(evidence.x[begin : each.noticed + 1, 0]))[0])
    return _Window(slice(begin, min(part.stop, each.told + 1 + reach, each.stop)), since, late)


def _onsets(
    bank: FaultBank,
    evidence: Evidence,
    found: list[_Stretch],
    sizes: list[tuple[float | None, int]],
    windows: list[_Window],
) -> list[tuple[float, float, float]]:
    """(mean, lower, upper) of when each began, beside the others in its window; those are dated
    beside this one then."""
    t = evidence.run.t
    seen = [float(t[each.noticed]) for each in found]
    onsets = [(at, at, at) for at in seen]
    beside = [
        [i for i, o in enumerate(found) if i != j and o.noticed < w.stop and w.start < o.stop]
        for j, (w, *_) in enumerate(windows)
    ]
    for again in range(ROUNDS):
        for j, (each, (size, _), window) in enumerate(zip(found, sizes, windows, strict=True)):
            if again and not beside[j]:
                continue
            others = [
                Lasting(found[i].k, sizes[i][0], onsets[i][0], float(t[found[i].stop - 1]))
                for i in beside[j]
            ]
            mean, low, high = onset_of(bank, evidence, window.part, each.k, size, others)
            if low <= t[window.part.start]:  # or before these samples
                low = max(window.since, low - bank.step * window.late)
            onsets[j] = mean, low, high
    return onsets


def _size(bank: FaultBank, judged: Judged, each: _Stretch) -> tuple[float | None, int]:
    """(the size, the sample at which it stands); None for an undeclared fault."""
    last = each.stop - 1
    if each.k == judged.found.p.shape[1]:
        return None, last
    last = _settled(bank, judged.p, each.calm, each.k, each.told, last)
    return float(judged.found.f[last, each.k] / judged.found.p[last, each.k]), last


def _event(
    bank: FaultBank,
    judged: Judged,
    each: _Stretch,
    size: float | None,
    last: int,
    onset: tuple[float, float, float],
) -> BankEvent:
    found, t, k = judged.found, judged.run.t, each.k
    declared = size is not None
    return BankEvent(
        judged.run.name,
        bank.model.plant.signals.fault_names[k] if declared else UNKNOWN,
        float(t[each.told]),
        float(t[each.stop - 1]),
        size,
        float(found.lo[last, k]) if declared else None,
        float(found.hi[last, k]) if declared else None,
        float(found.p[last, k] if declared else found.unknown[last]),
        *onset,
        _alternatives(bank, judged.p[last]),
        declared and bool(bank.with_monitor("passive")[k]),
    )


def _noticed(
    bank: FaultBank,
    found: Posterior,
    calm: Float[np.ndarray, "samples"],
    k: int,
    start: int,
    told: int,
) -> int:
    """When something was seen to be wrong: the beginning of the alarm, or, where another fault
    had been named by then, of this fault's own stretch."""
    before = np.flatnonzero(log_odds(calm[: told + 1]) < bank.level)
    begin = int(before[-1]) + 1 if len(before) else 0
    others = np.delete(found.p[begin:told], k, axis=1) if k < found.p.shape[1] else found.p[:0]
    return start if np.any(others >= NAMED) else min(begin, start)


def _settled(
    bank: FaultBank,
    p: Float[np.ndarray, "samples modes"],
    calm: Float[np.ndarray, "samples"],
    k: int,
    told: int,
    last: int,
) -> int:
    """The last sample from `told` to `last` at which the fault was not changing, and stood beyond
    the model's own error: its size."""
    agile = bank.sets.index((k,), bank.sets.index((k,)) + 1)
    modes = [m for m, each in enumerate(bank.sets) if k in each and m != agile]
    still = p[told : last + 1, modes].sum(axis=1) >= NAMED
    still &= log_odds(calm[told : last + 1]) >= bank.level
    return told + int(np.flatnonzero(still)[-1]) if still.any() else last


def _alternatives(bank: FaultBank, p: Float[np.ndarray, "modes"]) -> tuple[tuple[str, float], ...]:
    names = bank.model.plant.signals.fault_names
    labels = ["+".join(names[k] for k in each) or "healthy" for each in bank.sets] + [UNKNOWN]
    total = dict.fromkeys(labels, 0.0)
    for m, each in enumerate(p):
        total[labels[min(m, len(bank.sets))]] += float(each)
    (_, most), *others = sorted(total.items(), key=lambda item: -item[1])
    return tuple((label, most / each) for label, each in others[:3] if each > FEWEST * most)


def stretches(
    above: Bool[np.ndarray, "samples"], sampled: Bool[np.ndarray, "samples"]
) -> list[tuple[int, int]]:
    """(first sample, the one behind the last) wherever it is `above`; gaps, and pauses that are too
    short to be one, are bridged."""
    filled = above.copy()
    for start, stop in _edges(~above):
        if start > 0 and stop < len(above) and sampled[start:stop].sum() <= PAUSE:
            filled[start:stop] = True
    return _edges(filled)


def _edges(above: Bool[np.ndarray, "samples"]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(above, prepend=False, append=False)).reshape(-1, 2)
    return [(int(a), int(b)) for a, b in edges]
