"""Long curves made short without losing what a reader looks for: peaks and gaps."""

import numpy as np
from jaxtyping import Bool, Float, Int

__all__ = ["stretches", "thin", "thin_band"]

# A line is broken where the time between samples exceeds this many usual steps. Below it, a slow
# or jittery channel would fall apart; above it, a real gap would be bridged.
HOLE_STEPS = 10.0
# A diverged free run still has to be drawn; beyond this matplotlib's own arithmetic overflows.
DRAWABLE = 1e100


def thin(
    t: Float[np.ndarray, "samples"], y: Float[np.ndarray, "samples"], bins: int
) -> tuple[Float[np.ndarray, "kept"], Float[np.ndarray, "kept"]]:
    """Keep the smallest and the largest sample of each of `bins` equal time bins.

    NaN means "no sample here". A gap (more than `HOLE_STEPS` median steps without a sample) becomes
    one NaN, so that the drawn line breaks there; a sample between two gaps is doubled, so that a
    round line cap shows it as a dot.

    Args:
        t: increasing time, s.
        y: the curve, any unit.
        bins: about one per pixel of the drawing's width.

    Returns:
        Time and curve, at most about ``2 * bins`` points and the NaN of the gaps.
    """
    drawable = np.isfinite(t) & (np.abs(y) < DRAWABLE)
    t, y = t[drawable], y[drawable]
    if t.size == 0:
        return t, y
    segment, group = _groups(t, bins)
    order = np.lexsort((y, group))
    first = np.flatnonzero(np.diff(group, prepend=-1))
    last = np.append(first[1:], t.size) - 1
    kept = np.unique(np.concatenate([[0, t.size - 1], order[first], order[last]]))
    alone = np.bincount(segment[kept])[segment[kept]] == 1
    kept = np.repeat(kept, np.where(alone, 2, 1))
    breaks = np.flatnonzero(np.diff(segment[kept])) + 1
    return np.insert(t[kept], breaks, t[kept][breaks]), np.insert(y[kept], breaks, np.nan)


def thin_band(
    t: Float[np.ndarray, "samples"],
    lo: Float[np.ndarray, "samples"],
    hi: Float[np.ndarray, "samples"],
    bins: int,
) -> tuple[Float[np.ndarray, "kept"], Float[np.ndarray, "kept"], Float[np.ndarray, "kept"]]:
    """Keep the lowest `lo` and the highest `hi` of each of `bins` equal time bins; see `thin`."""
    drawable = np.isfinite(t) & (np.abs(lo) < DRAWABLE) & (np.abs(hi) < DRAWABLE)
    t, lo, hi = t[drawable], lo[drawable], hi[drawable]
    if t.size == 0:
        return t, lo, hi
    segment, group = _groups(t, bins)
    first = np.flatnonzero(np.diff(group, prepend=-1))
    breaks = np.flatnonzero(np.diff(segment[first])) + 1
    low = np.insert(np.minimum.reduceat(lo, first), breaks, np.nan)
    high = np.insert(np.maximum.reduceat(hi, first), breaks, np.nan)
    return np.insert(t[first], breaks, t[first][breaks]), low, high


def stretches(
    t: Float[np.ndarray, "samples"], mask: Bool[np.ndarray, "samples"], bins: int
) -> list[tuple[float, float]]:
    """Start and end, s, of every stretch where `mask` holds.

    A stretch lasts to the first sample after it. Stretches closer than one of `bins` equal time
    bins are drawn as one: nobody could tell them apart.
    """
    if t.size == 0:
        return []
    edges = np.diff(mask.astype(int), prepend=0, append=0)
    starts = t[np.flatnonzero(edges == 1)]
    ends = t[np.minimum(np.flatnonzero(edges == -1), t.size - 1)]
    merged: list[tuple[float, float]] = []
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        if merged and start - merged[-1][1] < (t[-1] - t[0]) / bins:
            merged[-1] = (merged[-1][0], end)
        else:
            merged.append((start, end))
    return merged


def _groups(
    t: Float[np.ndarray, "samples"], bins: int
) -> tuple[Int[np.ndarray, "samples"], Int[np.ndarray, "samples"]]:
    """The unbroken segment and the time bin within it that each sample belongs to."""
    steps = np.diff(t)
    broken = steps > HOLE_STEPS * np.median(steps) if steps.size else steps > 0.0
    segment = np.concatenate([[0], np.cumsum(broken)])
    if t.size <= 2 * bins:
        return segment, np.arange(t.size)
    place = np.minimum((t - t[0]) / (t[-1] - t[0]) * bins, bins - 1).astype(int)
    moved = broken | (np.diff(place) > 0)
    return segment, np.concatenate([[0], np.cumsum(moved)])
