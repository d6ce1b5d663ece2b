"""Uniform grids, and training points that cover the envelope."""

import numpy as np
from jaxtyping import Float, Int

__all__ = ["cover", "on_grid"]

JITTER = 1e-3  # time steps that differ by less than this share count as uniform


def on_grid(
    t: Float[np.ndarray, "samples"],
    columns: dict[str, Float[np.ndarray, "samples"]],
    held: set[str],
) -> tuple[float, Float[np.ndarray, "grid"], dict[str, Float[np.ndarray, "grid"]]]:
    """(step [s], grid [s], columns on it): the median step, from the first sample on.

    A uniform record is returned as it is. Otherwise smooth columns are interpolated linearly;
    `held` columns keep their mean over every grid interval, so that no impulse is lost.
    """
    steps = np.diff(t)
    step = float(np.median(steps))
    if np.all(np.abs(steps - step) <= JITTER * step):
        return float((t[-1] - t[0]) / (len(t) - 1)), t, columns
    grid = t[0] + step * np.arange(int((t[-1] - t[0]) / step * (1 + 1e-12)) + 1)
    resampled = {}
    for name, x in columns.items():
        if name in held:
            area = np.concatenate([[0.0], np.cumsum(x[:-1] * steps)])
            ends = np.interp(np.append(grid, min(grid[-1] + step, t[-1])), t, area)
            width = np.asarray(np.diff(np.append(grid, min(grid[-1] + step, t[-1]))), float)
            last = width < 0.5 * step
            means = np.diff(ends) / np.where(last, 1.0, width)
            resampled[name] = np.where(last, x[np.searchsorted(t, grid, "right") - 1], means)
        else:
            resampled[name] = np.interp(grid, t, x)
    return step, grid, resampled


def cover(
    points: Float[np.ndarray, "samples features"], count: int, rng: np.random.Generator
) -> Int[np.ndarray, "kept"]:
    """Indices of at most `count` points: a fair draw that still covers the envelope.

    The features' ranges are cut into about `count / 10` cells; every occupied cell gives one
    point, so that rare corners stay in. The rest is one draw from each of equal stretches of the
    log, which keeps the log's own weighting and scatters far less than free draws.
    """
    samples, features = points.shape
    if samples <= count:
        return np.arange(samples)
    low, high = points.min(axis=0), points.max(axis=0)
    bins = max(1, int((count / 10) ** (1 / max(features, 1))))
    spread = np.where(high > low, high - low, 1.0)
    cells = np.minimum((points - low) / spread * bins, bins - 1).astype(np.int64)
    shuffled = rng.permutation(samples)
    _, first = np.unique(cells[shuffled], axis=0, return_index=True)
    rest = np.delete(np.arange(samples), shuffled[first])
    edges = np.linspace(0, len(rest), count - len(first) + 1).astype(np.int64)
    drawn = rest[rng.integers(edges[:-1], edges[1:])]
    return np.sort(np.concatenate([shuffled[first], drawn]))
