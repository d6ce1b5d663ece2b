"""Uniform grids, lower rates, and training points that cover the envelope."""

import math
from collections.abc import Collection
from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from faultgauge.errors import InputError
from faultgauge.telemetry.anti_alias import low_passed
from faultgauge.telemetry.runs import GAP_STEPS, ROUNDING, Run, gaps, nearest

__all__ = ["check_rate", "cover", "on_grid", "rate_of", "resampled", "same_rate"]

EDGE = (
    3.0  # new steps from the ends of what is filtered: a wrong guess of what was beyond them shows
)
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


def check_rate(rate: float) -> None:
    """Raises `InputError` unless `rate` [Hz] is a positive finite number."""
    if not 0 < rate < math.inf:
        raise InputError(f"--resample {rate:g}: a rate is a positive number of hertz; correct it.")


def same_rate(first: float, second: float) -> bool:
    """Whether two rates are one, but for the rounding of a clock."""
    return abs(first - second) <= JITTER * second


def resampled(
    run: Run, rate: float, held: Collection[str] = (), averaged: Collection[str] = ()
) -> Run:
    """`run` at t[0] + k / `rate` [Hz], anti-aliased; at its own rate as it is.

    All columns go through one low-pass filter, `low_passed`, so that what was true of the log, such
    as dx = a x + b u, is true of what remains. Columns `held` between their samples, and those
    `averaged` because they jump with a held one, then become their mean over [t_k, t_k+1), which
    is what acts there: their integral is kept. All others are taken at t_k. A sensor that is slower
    than `rate` has nothing to filter out and is interpolated between its own samples, which stay
    marked.

    Gaps in time and rows without any sample split the run, and a hole splits a column: nothing is
    filtered, averaged or filled across one. A hole is a time of more than three steps between two
    samples; a shorter one is bridged. Cells nearer than three new steps to the ends of a run, to a
    gap or to a hole of their column are empty, since the filter would need what is beyond; rows
    without a cell are left out, but for one in every gap.

    Raises `InputError` for a rate that is no rate or above that of the run, and for a run that is
    too short.
    """
    check_rate(rate)
    own = 1 / run.step
    if same_rate(rate, own):
        return replace(run, resampled=rate, logged=run.step)
    if rate > own:
        raise InputError(
            f"{run.source}, --resample {rate:g}: run {run.name!r} has only {own:.4g} samples a "
            "second, and a rate can only be lowered; give a lower one, or leave it out."
        )
    slack = ROUNDING * run.step
    grid = run.t[0] + np.arange(int((run.t[-1] - run.t[0] + slack) * rate) + 1) / rate
    part = _parts(run)
    inside = np.zeros(len(grid), dtype=bool)
    for rows in _stretches(part):
        inside[_within(run.t[rows], grid, EDGE / rate - slack)] = True
    if inside.sum() < 2:
        raise InputError(
            f"{run.source}, --resample {rate:g}: run {run.name!r} lasts "
            f"{run.t[-1] - run.t[0]:.4g} s without a gap at most, and {2 * EDGE + 1:g} new "
            "intervals are the least; give a higher rate, or leave the run out."
        )
    kept = inside | np.diff(inside, prepend=False)  # of the rows in a gap, the first
    kept[np.flatnonzero(inside)[-1] + 1 :] = False
    stepped = {*held, *averaged}
    columns, sampled = {}, {}
    for name in run.columns:
        new, cells = _lowered(run, name, part, grid, rate, name in stepped)
        if cells is not None:
            sampled[name] = cells[kept]
        columns[name] = new[kept]
    return replace(
        run,
        t=grid[kept],
        columns=columns,
        sampled=sampled,
        resampled=rate,
        logged=run.step,
    )


def rate_of(runs: Collection[Run]) -> float | None:
    """The rate [Hz] that all of `runs` were brought to, if they were."""
    rates = {run.resampled for run in runs}
    if len(rates) > 1:
        raise InputError(
            f"run {next(iter(runs)).name!r} and others were resampled to different rates; read "
            "all with the same resample."
        )
    return next(iter(rates), None)


def _parts(run: Run) -> Int[np.ndarray, "samples"]:
    """The number of the part of the run that a row belongs to; -1 for a row without a sample."""
    empty = np.full(len(run.t), bool(run.columns))
    for values in run.columns.values():
        empty &= np.isnan(values)
    new = np.concatenate([[False], gaps(run.t, run.step)]) | empty
    return np.where(empty, -1, np.cumsum(new))


def _within(
    t: Float[np.ndarray, "samples"], grid: Float[np.ndarray, "rows"], margin: float
) -> slice:
    """The rows of `grid` that are `margin` [s] off the first and last of `t`, or further inside."""
    start = int(np.searchsorted(grid, t[0] + margin))
    return slice(start, max(start, int(np.searchsorted(grid, t[-1] - margin, side="right"))))


def _pieces(
    t: Float[np.ndarray, "samples"], part: Int[np.ndarray, "samples"], interval: float
) -> Int[np.ndarray, "samples"]:
    """Numbers of the pieces of a column that is sampled at `t`, every `interval`."""
    holes = np.diff(t) > (GAP_STEPS + ROUNDING) * interval
    return np.cumsum(np.concatenate([[False], holes | (np.diff(part) != 0)]))


def _stretches(piece: Int[np.ndarray, "samples"]) -> list[slice]:
    edges = np.flatnonzero(np.diff(piece, prepend=-1, append=-1))
    return [slice(a, b) for a, b in pairwise(edges.tolist())]


def _lowered(
    run: Run,
    name: str,
    part: Int[np.ndarray, "samples"],
    grid: Float[np.ndarray, "rows"],
    rate: float,
    stepped: bool,
) -> tuple[Float[np.ndarray, "rows"], Bool[np.ndarray, "rows"] | None]:
    """A column at the times of `grid`; of a slower sensor, which rows stand for its samples."""
    known = np.isfinite(run.own(name))
    t, x, part = run.t[known], run.columns[name][known], part[known]
    found = np.full(len(grid), np.nan)
    if not len(t):
        return found, None
    own = float(np.median(np.diff(t))) if len(t) > 1 else math.inf
    marked = name in run.sampled
    slower = own * rate > 1 - JITTER
    piece = _pieces(t, part, own if marked else run.step)
    margin = (0 if slower else EDGE / rate) - ROUNDING * run.step
    for rows in _stretches(piece):
        mine = _within(t[rows], grid, margin)
        if slower or rows.stop - rows.start < 2:
            found[mine] = np.interp(grid[mine], t[rows], x[rows])
        else:
            step, even, on = on_grid(t[rows], {name: x[rows]}, {name} if stepped else set())
            position = np.interp(grid[mine], even, np.arange(len(even), dtype=float))
            found[mine] = low_passed(on[name], position, step * rate, mean=stepped)
    if not slower:
        return found, None
    cells = nearest(grid, t)
    if marked:
        return found, cells & np.isfinite(found)
    # now and then, without a rate: every sample goes to the row next to it
    return np.where(cells, np.interp(grid, t, x), np.nan), None


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
