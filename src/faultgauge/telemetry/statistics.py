"""What one signal looks like: range, resolution, noise, stretches that do not move."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from faultgauge.telemetry.runs import gaps
from faultgauge.telemetry.table import LARGEST

__all__ = ["MAD_TO_STD", "Statistics", "statistics"]

MAD_TO_STD = 1.4826  # standard deviation of Gaussian noise over the median of its size
HELD_SHARE = 0.5  # of the steps on which a held signal does not move, at least
HELD_JUMP = 3.0  # resolutions that it jumps otherwise: a slow sensor moves by one
HELD_RANGE = 0.1  # of the range, for signals of a few levels, such as a switch


@dataclass(frozen=True)
class Statistics:
    """Statistics of one signal over runs, in its own unit unless said otherwise.

    `quantum` is the smallest nonzero difference between two of its values; `stuck` the longest
    time, s, on one value; `noise` the standard deviation of what cannot be a smooth signal;
    `held` the guess that it keeps its value between updates. None where there is too little.
    """

    min: float | None
    max: float | None
    mean: float | None
    std: float | None
    quantum: float | None
    noise: float | None
    constant: bool
    held: bool
    stuck: float


def statistics(
    times: Sequence[Float[np.ndarray, "_"]], signals: Sequence[Float[np.ndarray, "_"]]
) -> Statistics:
    """Statistics of a signal, given its samples in each run and their times (s).

    Cells that are not finite, or too large, are passed over.
    """
    signals = [np.where(np.abs(values) <= LARGEST, values, np.nan) for values in signals]
    pooled = np.concatenate(signals)
    pooled = pooled[~np.isnan(pooled)]
    if pooled.size == 0:
        return Statistics(None, None, None, None, None, None, False, False, 0.0)
    quantum = _quantum(pooled)
    constant = bool(np.ptp(pooled) == 0)
    return Statistics(
        min=float(pooled.min()),
        max=float(pooled.max()),
        mean=float(pooled.mean()),
        std=float(pooled.std()),
        quantum=quantum,
        noise=_noise(times, signals),
        constant=constant,
        held=not constant and _held(signals, quantum, float(np.ptp(pooled))),
        stuck=max(_stuck(t, values) for t, values in zip(times, signals, strict=True)),
    )


def _quantum(values: Float[np.ndarray, "_"]) -> float | None:
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-12 * np.abs(values).max()]  # 0.1 * 3 and 0.3 are one value
    return float(steps.min()) if steps.size else None


def _noise(
    times: Sequence[Float[np.ndarray, "_"]], signals: Sequence[Float[np.ndarray, "_"]]
) -> float | None:
    """Robust standard deviation of third differences.

    They are blind to anything locally quadratic, and white noise of variance s^2 gives them
    (1 + 9 + 9 + 1) s^2.
    """
    pooled = []
    for t, values in zip(times, signals, strict=True):
        third = np.diff(values, 3)
        broken = gaps(t)
        across = broken[:-2] | broken[1:-1] | broken[2:]
        pooled.append(third[~across & ~np.isnan(third)])
    third = np.concatenate(pooled)
    if third.size == 0:
        return None
    return float(MAD_TO_STD * np.median(np.abs(third - np.median(third))) / np.sqrt(20))


def _held(signals: Sequence[Float[np.ndarray, "_"]], quantum: float | None, span: float) -> bool:
    steps = np.abs(np.concatenate([np.diff(values) for values in signals]))
    steps = steps[~np.isnan(steps)]
    jumps = steps[steps > 0]
    if quantum is None or jumps.size == 0 or jumps.size > (1 - HELD_SHARE) * steps.size:
        return False
    return bool(np.median(jumps) >= min(HELD_JUMP * quantum, HELD_RANGE * span))


def _stuck(t: Float[np.ndarray, "_"], values: Float[np.ndarray, "_"]) -> float:
    same = (np.diff(values) == 0) & ~gaps(t)
    edges = np.flatnonzero(np.diff(same, prepend=False, append=False)).reshape(-1, 2)
    return float(max((t[end] - t[start] for start, end in edges), default=0.0))
