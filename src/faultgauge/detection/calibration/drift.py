"""A slow change of the healthy plant: a test on the samples that nothing alarmed.

What the bank takes for the model's own error is averaged over blocks of at least ten correlation
times of what the fit leaves, and the means over time are fitted by

    x_b = a + s t_b + e_b,      s / sd(s) ~ Student's t with B - 2 degrees of freedom.

A change counts where it is beyond chance and larger than twice the learned size;
so does a mean that stands off zero. A slow change of the plant and a slowly growing fault look
alike; they are told apart

- by a drifting parameter (`vary = "slow"`) that the bank tracked beside all faults, and
- by a measured quantity that explains the change (inputs, outputs, as further regressors): then
  the model lacks it, and neither the plant nor a fault is new;

otherwise the answer is that they cannot be told apart.

So it is where a log without a fault ends with a constant that is further off than healthy runs
differ: nobody declared what it took up, or the plant is another one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtr, stdtr, stdtrit

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.bank.uncertain_constants import drifting_of, parameters_of
from faultgauge.detection.calibration.blocks import correlation_time
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.posterior import WIDE
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run

__all__ = ["Drift", "Trend", "drifts", "trend"]

BLOCK_TIMES = 10.0  # correlation times per block
FEWEST_BLOCKS = 8  # in which a drift may be told from chance
CHANCE = 1e-3  # of a drift where there is none, over all channels of a run
STANDING = 2.0  # healthy RMS: a mean that far off zero
FAR = 3.0  # times by how much healthy runs differ: a constant that ends that far off

Samples = Float[np.ndarray, "samples"]


@dataclass(frozen=True)
class Trend:
    """A change over a stretch of `seconds`, with its 95 % interval and the probability `p` that
    chance alone gives as much; `mean`, known to `mean_half`, with the probability `p_mean`.
    `follows` is the measured quantity beside which no change over time is left."""

    change: float
    lo: float
    hi: float
    seconds: float
    p: float
    mean: float
    mean_half: float
    p_mean: float
    follows: str | None


@dataclass(frozen=True)
class Drift:
    """A drift of `channel` in `run`, in `unit`; `cause` is `plant` where it is told from a fault,
    `model` where a measured quantity explains it, `ambiguous` where it may be a slow fault,
    `constant` where a constant is further off than healthy runs differ.

    `change` with its 95 % interval over `seconds` of healthy samples; of a mean that stands off
    zero, the mean, and of a constant how far it is off.
    """

    run: str
    channel: str
    unit: str
    cause: Literal["plant", "model", "ambiguous", "constant"]
    standing: bool
    change: float
    lo: float
    hi: float
    seconds: float
    p: float
    follows: str | None


def trend(
    run: Run,
    x: Samples,
    healthy: Bool[np.ndarray, "samples"],
    beside: Mapping[str, Samples],
    chance: float = CHANCE,
) -> Trend | None:
    """The trend of `x` over the samples `healthy`; None where they are too few blocks."""
    kept = healthy & np.isfinite(x)
    if kept.sum() < 4:
        return None
    t, values = run.t[kept], x[kept]
    aside = {name: a[kept] for name, a in beside.items() if np.isfinite(a[kept]).all()}
    aside = {name: a for name, a in aside.items() if np.ptp(a) > 1e-9 * np.abs(a).max()}
    known = np.stack([np.ones(len(t)), t - t.mean(), *aside.values()], axis=1)
    known = known / np.abs(known).max(axis=0)
    rest = values - known @ np.linalg.lstsq(known, values, rcond=None)[0]
    tau = correlation_time(rest, run.step)
    length = max(int(np.ceil(BLOCK_TIMES * tau / run.step)), 10)
    count = len(t) // length
    if count < FEWEST_BLOCKS:
        return None

    def means(a: Samples) -> Float[np.ndarray, "blocks"]:
        return a[: count * length].reshape(count, length).mean(axis=1)

    when, level = means(t), means(values)
    seconds = float(t[-1] - t[0])
    slope, sd, p = _slope(when, level, [])
    others = {name: means(a) for name, a in aside.items()}
    follows = None
    if p < chance and others and _slope(when, level, list(others.values()))[2] >= chance:
        follows = max(others, key=lambda name: abs(np.corrcoef(others[name], level)[0, 1]))
    half = float(stdtrit(count - 2, 0.975)) * sd * seconds
    change = slope * seconds
    mean, off = float(level.mean()), float(level.std(ddof=1) / np.sqrt(count))
    p_mean = float(2 * stdtr(count - 1, -abs(mean) / max(off, 1e-300)))
    mean_half = float(stdtrit(count - 1, 0.975)) * off
    ends = (change - half, change + half)
    return Trend(change, *ends, seconds, p, mean, mean_half, p_mean, follows)


def _slope(
    when: Float[np.ndarray, "blocks"],
    level: Float[np.ndarray, "blocks"],
    others: Sequence[Float[np.ndarray, "blocks"]],
) -> tuple[float, float, float]:
    """(slope over time, its standard deviation, p of none) beside `others`."""
    columns = [np.ones(len(when)), when, *others]
    scale = np.array([max(float(np.abs(c).max()), 1e-300) for c in columns])
    A = np.stack(columns, axis=1) / scale
    free = len(level) - A.shape[1]
    if free < 1:
        return 0.0, np.inf, 1.0
    solution = np.linalg.lstsq(A, level, rcond=None)[0]
    noise = float(np.sum((level - A @ solution) ** 2)) / free
    spread = np.linalg.pinv(A.T @ A)[1, 1]
    slope, sd = float(solution[1] / scale[1]), float(np.sqrt(noise * spread) / scale[1])
    return slope, sd, float(2 * stdtr(free, -abs(slope) / max(sd, 1e-300)))


def drifts(bank: FaultBank, decisions: Sequence[Decision]) -> list[Drift]:
    """Drifts of what the bank tracks beside all faults: the discrepancy of every dynamic state,
    against its learned size, parameters that may drift, and constants that took something up."""
    signals, plant = bank.model.plant.signals, bank.plant
    found = []
    for each in decisions:
        healthy = np.array(each.status) == "HEALTHY"
        for k, state in enumerate(plant.driven):
            x = each.posterior.x[:, len(signals.states) + k]
            chance = CHANCE / len(plant.driven)
            seen = trend(each.run, x, healthy, _measured(bank.model, each.run), chance)
            if seen is not None:
                unit = f"{signals.states[state].unit}/s" if signals.states[state].unit else ""
                name = f"the model's error in {signals.states[state].name}"
                scale = STANDING * float(bank.noise.size[k])
                found += _drift(each.run.name, name, unit, seen, scale, chance)
        moved = _parameters(bank, each, healthy)
        told = {drift.channel for drift in moved}
        found += [*moved, *(d for d in _constants(bank, each, healthy) if d.channel not in told)]
    return found


def _measured(model: Model, run: Run) -> dict[str, Samples]:
    """The columns of `run` that are inputs or outputs of the plant."""
    signals = model.plant.signals
    names = (*signals.input_names, *signals.output_names)
    return {name: run.columns[name] for name in names if name in run.columns}


def _drift(run: str, name: str, unit: str, seen: Trend, scale: float, chance: float) -> list[Drift]:
    if seen.p < chance and abs(seen.change) > scale:
        cause = "ambiguous" if seen.follows is None else "model"
        change = (seen.change, seen.lo, seen.hi)
        return [Drift(run, name, unit, cause, False, *change, seen.seconds, seen.p, seen.follows)]
    if seen.p_mean < chance and abs(seen.mean) > STANDING * scale:
        mean = _around(seen.mean, seen.mean_half)
        return [Drift(run, name, unit, "ambiguous", True, *mean, seen.seconds, seen.p_mean, None)]
    return []


def _around(middle: float, half: float) -> tuple[float, float, float]:
    """(`middle`, the ends of its interval)."""
    return middle, middle - half, middle + half


def _parameters(
    bank: FaultBank, decision: Decision, healthy: Bool[np.ndarray, "samples"]
) -> list[Drift]:
    """Drifting parameters that moved by more than their prior spread."""
    first = bank.plant.parts.xi.start
    units = {p.name: p.unit for p in bank.model.plant.spec.parameters}
    found = []
    for k, name in enumerate(drifting_of(bank.model)):
        spread = float(bank.plant.directions[k, k])
        x = spread * decision.posterior.x[:, first + k]
        seen = trend(decision.run, x, healthy, {})
        if seen and seen.p < CHANCE and abs(seen.change) > spread:
            change = (seen.change, seen.lo, seen.hi)
            found.append(
                Drift(decision.run.name, name, units[name], "plant", False, *change,
                      seen.seconds, seen.p, None)
            )  # fmt: skip
    return found


def _constants(
    bank: FaultBank, decision: Decision, healthy: Bool[np.ndarray, "samples"]
) -> list[Drift]:
    """Constants that a run without an event ends further off with than healthy runs differ."""
    if decision.events or not healthy.any() or decision.loose is None:
        return []
    plant, run = bank.plant, decision.run
    units = {name: p.unit for name, p in parameters_of(bank.model).items()}
    W = np.asarray(plant.directions)
    off = W @ decision.posterior.x[np.flatnonzero(healthy)[-1], plant.parts.xi]
    far = off / np.linalg.norm(W, axis=1)
    seconds = float(healthy.sum() * run.step)
    columns = (off.tolist(), far.tolist(), (WIDE * decision.loose).tolist())
    return [
        Drift(run.name, name, units[name], "constant", True, *_around(m, half), seconds,
              float(2 * ndtr(-abs(times))), None)
        for name, m, times, half in zip(plant.names, *columns, strict=True)
        if abs(times) > FAR
    ]  # fmt: skip
