"""The events of a run: the stretches in which a fault was named, and what is told of each."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.bank import FaultBank
from faultgauge.detection.posterior import LIKELY, WIDE, Posterior
from faultgauge.detection.verdicts import NAMED, Verdict
from faultgauge.detection.words import MOST
from faultgauge.telemetry import Run

__all__ = ["UNKNOWN", "Alarm", "BankEvent", "Judged", "events", "pause", "stretches"]

UNKNOWN = "unknown"
POSSIBLE = 0.05  # p of a fault beside another from which on it is told


@dataclass(frozen=True)
class BankEvent:
    """A stretch in which a fault was named. Times in s; size in the fault's unit with its 95 %
    interval, given that the fault is there (None for an undeclared one).

    `start` is when it was told, `onset` when it began; size, p and the rest stand at the last
    sample at which the fault did not change. `alternatives` are other sets of faults, with the
    odds of the best set against them; `instead` every other cause, with the odds of this fault
    against that one without it, at most 1000; `beside` other faults that may be there too, with
    their probabilities if this one is. A `passive` fault raised no alarm.
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
    instead: tuple[tuple[str, float], ...] = ()
    beside: tuple[tuple[str, float], ...] = ()
    passive: bool = False


@dataclass(frozen=True)
class Alarm:
    """On a stream: a fault was named at `start` [s], as large as it is then, in its unit (None for
    an undeclared one). How large it was in the end, and since when, its event tells."""

    run: str
    fault: str
    start: float
    size: float | None


class Judged(NamedTuple):
    """Samples of a run, their inputs as they act, with what the bank says of them: `p` of all sets
    and, last, of the unknown."""

    run: Run
    found: Posterior
    verdict: Verdict
    p: Float[np.ndarray, "samples sets"]


class _Stretch(NamedTuple):
    """Cause `k` from sample `begun`, `told`, until before `stop`."""

    k: int
    begun: int
    told: int
    stop: int


def events(bank: FaultBank, judged: Judged, first: int = 0) -> list[BankEvent]:
    """The stretches, from sample `first` on, in which a fault was named, but for those that were
    another one's: which the posterior, by the last sample, no longer holds to have been there."""
    sampled = np.flatnonzero(np.isfinite(judged.found.healthy))
    found = sorted(_stretches(bank, judged, first), key=lambda each: (each.told, each.k))
    if not found:
        return []
    ever = judged.found.ever[sampled[-1]]
    told = [
        _event(bank, judged, each)
        for each in found
        if each.k == len(ever) or ever[each.k] >= LIKELY
    ]
    return [each for each in told if each.fault != UNKNOWN or not _renamed(each, told)]


def _renamed(unknown: BankEvent, told: list[BankEvent]) -> bool:
    """Whether what was undeclared for a while has turned out to be a fault that was told later."""
    return any(
        each.fault != UNKNOWN
        and each.start >= unknown.start
        and each.onset_lo <= unknown.end <= each.start + (each.start - unknown.start)
        for each in told
    )


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
        for start, stop in stretches(above & sampled, sampled, pause(bank)):
            named = np.flatnonzero(verdict.named[start:stop, k])
            if len(named):
                everyone.append(_Stretch(k, start, start + int(named[0]), stop))
    return everyone


def _event(bank: FaultBank, judged: Judged, each: _Stretch) -> BankEvent:
    found, t, k = judged.found, judged.run.t, each.k
    declared = k < found.p.shape[1]
    p = found.p[:, k] if declared else found.unknown
    last = _settled(p, each.told, each.stop - 1)
    size = float(found.f[last, k] / found.p[last, k]) if declared else None
    return BankEvent(
        judged.run.name,
        bank.model.plant.signals.fault_names[k] if declared else UNKNOWN,
        float(t[each.told]),
        float(t[each.stop - 1]),
        size,
        float(min(found.lo[last, k], size)) if size is not None else None,
        float(max(found.hi[last, k], size)) if size is not None else None,
        float(p[last]),
        *_onset(bank, judged, each, last),
        _alternatives(bank, judged.p[last]),
        *_others(bank, k, judged.p[last].astype(float)),
        declared and bool(bank.with_monitor("passive")[k]),
    )


def _onset(
    bank: FaultBank, judged: Judged, each: _Stretch, last: int
) -> tuple[float, float, float]:
    """(mean, lower, upper), at least a step wide and not after the fault was told; of an unknown
    fault, from the bank's memory before it was likely until then."""
    t, told = judged.run.t, float(judged.run.t[each.told])
    if each.k == judged.found.p.shape[1]:
        begun = float(t[each.begun])
        return begun, max(begun - bank.knowledge.memory, float(t[0])), told
    ago, sd = judged.found.onset[last, each.k]
    mean = min(float(t[last] - ago), told - bank.step / 2)
    half = max(WIDE * float(sd), bank.step / 2)
    return mean, mean - half, min(mean + half, told)


def _settled(p: Float[np.ndarray, "samples"], told: int, last: int) -> int:
    """The last sample from `told` to `last` at which the fault was sure."""
    sure = np.flatnonzero(p[told : last + 1] >= NAMED)
    return told + int(sure[-1]) if len(sure) else last


def _alternatives(bank: FaultBank, p: Float[np.ndarray, "sets"]) -> tuple[tuple[str, float], ...]:
    names = bank.model.plant.signals.fault_names
    labels = ["+".join(names[k] for k in each) or "healthy" for each in bank.sets] + [UNKNOWN]
    total = dict(zip(labels, p.tolist(), strict=True))
    (_, most), *others = sorted(total.items(), key=lambda item: -item[1])
    return tuple((label, most / each) for label, each in others[:3] if each > most / MOST)


def _others(
    bank: FaultBank, k: int, p: Float[np.ndarray, "sets"]
) -> tuple[tuple[tuple[str, float], ...], tuple[tuple[str, float], ...]]:
    """(odds of cause `k` against every other one without it, p of other faults given it)."""
    names = (*bank.model.plant.signals.fault_names, UNKNOWN)
    holds = np.zeros((len(p), len(names)), bool)
    for at, each in enumerate(bank.sets):
        holds[at, list(each)] = True
    holds[len(bank.sets) :, -1] = True
    own = float(p @ holds[:, k])
    instead, beside = [], []
    for other in np.flatnonzero(np.arange(len(names)) != k):
        if holds[:, other].any():
            without = float(p @ (holds[:, other] & ~holds[:, k]))
            instead.append((names[other], min(own / max(without, 1e-300), MOST)))
            too = float(p @ (holds[:, other] & holds[:, k])) / own
            beside += [(names[other], too)] if too > POSSIBLE else []
    return tuple(instead), tuple(beside)


def pause(bank: FaultBank) -> int:
    """Samples below `release` that do not end an event, at most."""
    return int(np.ceil(bank.pause / bank.step))


def stretches(
    above: Bool[np.ndarray, "samples"], sampled: Bool[np.ndarray, "samples"], pause: int
) -> list[tuple[int, int]]:
    """(first sample, the one behind the last) wherever it is `above`; gaps, and pauses that are too
    short to be one, are bridged."""
    filled = above.copy()
    for start, stop in _edges(~above):
        if start > 0 and stop < len(above) and sampled[start:stop].sum() <= pause:
            filled[start:stop] = True
    return _edges(filled)


def _edges(above: Bool[np.ndarray, "samples"]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(above, prepend=False, append=False)).reshape(-1, 2)
    return [(int(a), int(b)) for a, b in edges]
