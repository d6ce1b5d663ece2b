"""Which wheels are named from their residuals, and how often the names are right."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from faultgauge.simulation.satellite.observatory import AXES, PERIOD

__all__ = ["NAMED", "TRUTHS", "WATCHED", "limits", "named", "statistic", "tally"]

WATCHED = ("pitch", "roll")  # the wheels that may be at fault
TRUTHS = {"none": (), "pitch": ("pitch",), "roll": ("roll",), "both": WATCHED}
NAMED = tuple(TRUTHS)
SPAN = round(20.0 / PERIOD)  # samples of the moving mean, as in the severity study


def statistic(
    r: Float[np.ndarray, "*flights samples wheels"],
) -> Float[np.ndarray, "*flights wheels"]:
    """The largest |mean over 20 s| of a residual in a flight, N*m."""
    total = np.cumsum(r, axis=-2)
    return np.abs((total[..., SPAN:, :] - total[..., :-SPAN, :]) / SPAN).max(axis=-2)


def limits(healthy: Float[np.ndarray, "flights wheels"]) -> dict[str, float]:
    """Limit [N*m] of each watched wheel: the largest statistic of the fault-free flights."""
    return {axis: float(healthy[:, AXES.index(axis)].max()) for axis in WATCHED}


def named(found: Float[np.ndarray, "flights wheels"], limit: dict[str, float]) -> list[str]:
    """Which wheels of each flight leave their limits: none, pitch, roll or both."""
    over = np.stack([found[:, AXES.index(axis)] > limit[axis] for axis in WATCHED], axis=1)
    return [NAMED[int(pitch) + 2 * int(roll)] for pitch, roll in over]


def tally(cells: Sequence[tuple[str, float]], names: Sequence[str]) -> dict[str, Any]:
    """Shares of flights by size [N*m] and truth: how they are named; by size: all wheels right, a
    sound wheel named (of those with one), a wheel at fault not named (of those with one)."""
    shares: dict[str, Any] = {}
    judged: dict[str, Any] = {}
    for size in dict.fromkeys(size for _, size in cells):
        here = [(t, n) for (t, s), n in zip(cells, names, strict=True) if s == size]
        for truth in dict.fromkeys(t for t, _ in here):
            each = [n for t, n in here if t == truth]
            row = {name: each.count(name) / len(each) for name in NAMED}
            shares.setdefault(f"{size:g}", {})[truth] = row
        wrong = [set(TRUTHS[n]) - set(TRUTHS[t]) for t, n in here if t != "both"]
        missed = [set(TRUTHS[t]) - set(TRUTHS[n]) for t, n in here if t != "none"]
        judged[f"{size:g}"] = {
            "right": float(np.mean([t == n for t, n in here])),
            "sound_named": float(np.mean([bool(w) for w in wrong])),
            "missed": float(np.mean([bool(m) for m in missed])) if missed else 0.0,
        }
    return {"named": shares, "judged": judged}
