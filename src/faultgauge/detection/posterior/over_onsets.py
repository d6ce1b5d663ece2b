"""Onset and size with their intervals, from the posterior over all onsets."""

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from faultgauge.detection.posterior.posterior import TAIL

__all__ = ["onset_over", "size_over"]

REST = 1e-6  # of a posterior over onsets that moves no 2.5 % quantile


def onset_over(
    t: Float[np.ndarray, "samples"], density: Float[np.ndarray, "samples"]
) -> tuple[float, float, float] | tuple[None, None, None]:
    """(mean, lower, upper); an onset at sample n lies between samples n - 1 and n."""
    if not density.any():
        return None, None, None
    before = np.concatenate([t[:1], t[:-1]])
    total = np.cumsum(density)
    low, high = np.searchsorted(total, [TAIL, 1 - TAIL])
    high = min(int(high), len(t) - 1)
    return float(density @ (before + t) / 2), float(before[low]), float(t[high])


def size_over(
    density: Float[np.ndarray, "samples"],
    mean: Float[np.ndarray, "samples"],
    sd: Float[np.ndarray, "samples"],
    low: float,
    high: float,
) -> tuple[float, float, float]:
    """(mean, lower, upper) of the mixture over onsets, within the fault's limits."""
    from scipy.optimize import brentq  # a fifth of a second to load, which only hindsight needs

    order = np.argsort(-density, kind="stable")
    kept = order[: 1 + int(np.searchsorted(np.cumsum(density[order]), 1 - REST))]
    w, m, s = density[kept] / density[kept].sum(), mean[kept], sd[kept]
    ends = float((m - 9 * s).min()), float((m + 9 * s).max())

    def quantile(wanted: float) -> float:
        root: Any = brentq(lambda f: float(w @ ndtr((f - m) / s)) - wanted, *ends)
        return float(root)

    found = (float(w @ m), quantile(TAIL), quantile(1 - TAIL))
    middle, lower, upper = (float(np.clip(f, low, high)) for f in found)
    return middle, lower, upper
