"""`estimate`: one posterior per run, its events, and the columns of the table."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.bank import FaultBank, build_fault_bank, evaluated_faults
from faultgauge.detection.course import Rows, run_over
from faultgauge.detection.flat_line import FlatLine
from faultgauge.detection.noise import noise_of
from faultgauge.detection.onset import onset_of
from faultgauge.detection.posterior import Posterior, posterior_of, untrusted
from faultgauge.detection.probability import probability
from faultgauge.detection.residual import Reference, residuals
from faultgauge.detection.uncalibrated import prior_of, uncalibrated
from faultgauge.detection.verdicts import NAMED, NOT_JUDGED, Verdict, Verdicts, log_odds
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.runs import paced

__all__ = [
    "BankEvent",
    "Decision",
    "UNKNOWN",
    "as_dicts",
    "decide",
    "decide_runs",
    "events",
    "sentence",
    "stretches",
    "table",
    "unjudged",
]

UNKNOWN = "unknown"
PAUSE = 10  # samples below `release` that do not end an event
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


@dataclass(frozen=True)
class Decision:
    """One run judged by the bank."""

    run: Run
    posterior: Posterior
    residuals: dict[str, Float[np.ndarray, "samples"]]
    status: list[str]
    reason: list[str]
    events: list[BankEvent]


def decide_runs(
    model: Model, runs: Sequence[Run], reference: Reference = "free"
) -> tuple[list[Decision], FaultBank | None]:
    """Judge `runs`; there is no bank, and every row is NOT_JUDGED, where `model` was not calibrated
    for it. Raises `InputError` where no fault is declared that is not disabled."""
    runs = [paced(run) for run in runs]
    if uncalibrated(model):
        evaluated_faults(model.plant.signals)
        return [unjudged(model, run, residuals(model, run, reference)) for run in runs], None
    bank = build_fault_bank(model, runs, noise_of(model))
    return [decide(bank, run, reference) for run in runs], bank


def unjudged(model: Model, run: Run, r: dict[str, Float[np.ndarray, "samples"]]) -> Decision:
    """`run` where nothing was calibrated for the bank: its residuals `r` alone."""
    count = len(run.t)
    why = [uncalibrated(model)] * count
    return Decision(run, prior_of(model, run), r, [NOT_JUDGED] * count, why, [])


def decide(bank: FaultBank, run: Run, reference: Reference = "free") -> Decision:
    """Judge one run."""
    modes = len(bank.sets) + len(bank.levels.unknown)
    p = np.full((len(run.t), modes), np.nan, np.float32)  # halves what a long log takes

    used, standing = FlatLine(bank.model, sized=True).used(run)

    def noted() -> Iterator[Rows]:
        for rows in run_over(bank, used):
            p[rows.part] = rows.p
            yield rows

    found = posterior_of(bank, run, noted())
    verdict = Verdicts(bank).judge(used, found, standing)
    found = untrusted(bank, found, verdict.status)
    r = residuals(bank.model, run, reference)
    said = events(bank, run, found, verdict, p, float(run.t[0]))
    return Decision(run, found, r, verdict.status, verdict.reason, said)


def events(
    bank: FaultBank,
    run: Run,
    found: Posterior,
    verdict: Verdict,
    p: Float[np.ndarray, "samples modes"],
    begun: float,
) -> list[BankEvent]:
    """The stretches of `run`, a part of one that began at `begun` [s], in which a fault was named;
    `p` of all modes."""
    names = (*bank.model.plant.signals.fault_names, UNKNOWN)
    columns = np.concatenate([found.p, found.unknown[:, None]], axis=1)
    release, sampled = bank.model.plant.signals.detection.release, np.isfinite(found.healthy)
    passive = np.append(bank.with_monitor("passive"), False)
    events = []
    for k, name in enumerate(names):
        calm = found.healthy if passive[k] else found.calm
        likely = (np.nan_to_num(columns[:, k]) >= release) & (1 - np.nan_to_num(calm) >= release)
        above = likely | verdict.named[:, k]
        for start, stop in stretches(above & sampled, sampled):
            named = np.flatnonzero(verdict.named[start:stop, k])
            if len(named):
                told = start + int(named[0])
                noticed = _noticed(bank, found, calm, k, start, told)
                events.append(
                    _event(bank, run, found, p, calm, k, name, noticed, told, stop - 1, begun)
                )
    return sorted(events, key=lambda event: event.start)


def _event(
    bank: FaultBank,
    run: Run,
    found: Posterior,
    p: Float[np.ndarray, "samples modes"],
    calm: Float[np.ndarray, "samples"],
    k: int,
    name: str,
    noticed: int,
    told: int,
    last: int,
    begun: float,
) -> BankEvent:
    size = lo = hi = None
    end = float(run.t[last])
    probability = float(found.unknown[last])
    onset = onset_lo = onset_hi = float(run.t[noticed])
    if name != UNKNOWN:
        last = _settled(bank, p, calm, k, told, last)
        probability = float(found.p[last, k])
        size = float(found.f[last, k] / probability)
        lo, hi = float(found.lo[last, k]), float(found.hi[last, k])
        delay = onset_of(bank, k, size)
        onset, onset_lo, onset_hi = (max(float(run.t[noticed] - d), begun) for d in delay)
    return BankEvent(
        run.name,
        name,
        float(run.t[told]),
        end,
        size,
        lo,
        hi,
        probability,
        onset,
        onset_lo,
        onset_hi,
        _alternatives(bank, p[last]),
        name != UNKNOWN and bool(bank.with_monitor("passive")[k]),
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


def table(decisions: Sequence[Decision], faults: Sequence[str]) -> dict[str, list[Any]]:
    """The columns that `estimate` writes, in order; None is an empty cell."""
    outputs = list(dict.fromkeys(name for each in decisions for name in each.residuals))
    columns: dict[str, list[Any]] = {}
    for each in decisions:
        for name, values in _rows(each, faults, outputs).items():
            cells = values
            if isinstance(values, np.ndarray):
                cells = [None if value != value else value for value in values.tolist()]
            columns.setdefault(name, []).extend(cells)
    return columns


def _rows(decision: Decision, faults: Sequence[str], outputs: Sequence[str]) -> dict[str, Any]:
    """One run's part of the table."""
    count, found = len(decision.run.t), decision.posterior
    rows: dict[str, Any] = {"run": [decision.run.name] * count, "t": decision.run.t}
    for name in outputs:
        rows[f"r_{name}"] = decision.residuals.get(name, np.full(count, np.nan))
    for k, name in enumerate(faults):
        rows |= {
            f"f_{name}": found.f[:, k],
            f"f_{name}_lo": found.lo[:, k],
            f"f_{name}_hi": found.hi[:, k],
            f"p_{name}": found.p[:, k],
        }
    rows |= {"p_healthy": found.healthy, "p_unknown": found.unknown}
    return rows | {"status": decision.status, "reason": decision.reason}


def sentence(event: BankEvent, unit: str) -> str:
    """ "leak +0.002 +- 1.7e-05 m/s from 4006 s, told at 4026 s, to 7198 s (p > 0.999, run a)" """
    when = f"from {event.onset:.6g} s, told at {event.start:.6g} s, to {event.end:.6g} s"
    if event.size is None or event.lo is None or event.hi is None:
        return f"a fault that is not declared {when} (run {event.run})"
    width = (event.hi - event.lo) / 2
    amount = f"{event.size:+.4g} +- {width:.2g} {unit}".rstrip()
    how = "passive, " if event.passive else ""
    return f"{event.fault} {amount} {when} ({how}p {probability(event.p)}, run {event.run})"


def as_dicts(events: Sequence[BankEvent]) -> list[dict[str, Any]]:
    """Events as plain JSON."""
    return [
        {
            **asdict(event),
            "alternatives": [{"faults": f, "odds": o} for f, o in event.alternatives],
        }
        for event in events
    ]
