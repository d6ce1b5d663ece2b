"""Columns that are sampled at different rates, brought onto common rows.

A sensor that is slower than its log leaves most cells of its column empty, and logs of several
clocks, joined on time, have no complete row at all. The rows become those of the column with most
samples; a column that is sampled regularly, but not there, is filled between its own samples:
linearly, or with the last value where it is held. Nothing is filled across a gap of the column's
own, nor before its first or after its last sample. A dropout of a sensor of full rate stays one.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.telemetry.runs import GAP_STEPS, ROUNDING, nearest

__all__ = ["DROPOUT", "FEWEST_OF_A_RATE", "REGULAR", "SLOWER", "Aligned", "align"]

SLOWER = 1.5  # times the shortest median interval: a rate of its own
DROPOUT = (
    1.75  # of its intervals without a sample: one of full rate has missed one (2, less jitter)
)
REGULAR = 0.8  # of the intervals of a slower column lie within half of their median, at least
FEWEST_OF_A_RATE = 4  # samples of a column that show a rate


@dataclass(frozen=True, eq=False)
class Aligned:
    """Columns on common rows: `kept` of the rows given, `filled` the names that gained cells.

    `sampled` marks the cells of the slower ones that stand for a sample: the nearest to it.
    """

    kept: Bool[np.ndarray, "rows"]
    columns: dict[str, Float[np.ndarray, "kept"]]
    filled: tuple[str, ...]
    sampled: dict[str, Bool[np.ndarray, "kept"]]


def align(
    t: Float[np.ndarray, "rows"],
    columns: Mapping[str, Float[np.ndarray, "rows"]],
    held: Collection[str] = (),
    holes: Bool[np.ndarray, "rows"] | None = None,
) -> Aligned:
    """`columns` (NaN where not sampled at `t`, s) of one run on the rows of the fastest of them.

    `held` names those that keep their value between samples. `holes` are empty rows that split the
    run: they stay, and nothing is filled across one. Columns that are sampled together come back
    as they are, every row kept.
    """
    sampled = {name: np.isfinite(values) for name, values in columns.items()}
    intervals = {
        name: float(np.median(np.diff(t[cells])))
        for name, cells in sampled.items()
        if not cells.all() and cells.sum() >= FEWEST_OF_A_RATE
    }
    kept = np.ones(len(t), dtype=bool)
    holes = np.zeros(len(t), dtype=bool) if holes is None else holes
    if not intervals:
        return Aligned(kept, dict(columns), (), {})
    fastest = max(columns, key=lambda name: sampled[name].sum())
    shortest = min(float(np.median(np.diff(t[sampled[fastest]]))), *intervals.values())
    found = dict(columns)
    filled, slow = [], []
    for name, interval in intervals.items():
        slower = name != fastest and interval > SLOWER * shortest
        between = _between(t, sampled[name], interval, slower)
        if name == fastest:
            kept = _own(sampled[name], between) | holes if between.any() else kept
            continue
        between &= ~_across(sampled[name], holes)
        if between.any():
            found[name] = _filled(t, columns[name], sampled[name], between, name in held)
            filled.append(name)
            slow += [name] if slower and name not in held else []
    return Aligned(
        kept,
        {name: values[kept] for name, values in found.items()},
        tuple(filled),
        {name: nearest(t[kept], t[sampled[name]]) for name in slow},
    )


def _between(
    t: Float[np.ndarray, "rows"], sampled: Bool[np.ndarray, "rows"], interval: float, slower: bool
) -> Bool[np.ndarray, "rows"]:
    """The empty cells of a column that lie between two of its regular samples."""
    rows = np.flatnonzero(sampled)
    steps = np.diff(t[rows])
    if slower and np.mean(np.abs(steps - interval) <= 0.5 * interval) < REGULAR:
        return np.zeros(len(t), dtype=bool)
    longest = (GAP_STEPS + ROUNDING if slower else DROPOUT) * interval
    after = np.searchsorted(rows, np.arange(len(t)))  # the sample that follows a row
    inside = ~sampled & (after > 0) & (after < len(rows))
    inside[inside] = steps[after[inside] - 1] <= longest
    return inside


def _across(
    sampled: Bool[np.ndarray, "rows"], holes: Bool[np.ndarray, "rows"]
) -> Bool[np.ndarray, "rows"]:
    """The rows between two samples of a column with one of `holes` between them."""
    rows, before = np.flatnonzero(sampled), np.cumsum(holes)
    after = np.clip(np.searchsorted(rows, np.arange(len(sampled))), 1, len(rows) - 1)
    return before[rows[after]] > before[rows[after - 1]]


def _own(
    sampled: Bool[np.ndarray, "rows"], between: Bool[np.ndarray, "rows"]
) -> Bool[np.ndarray, "rows"]:
    """The rows that are samples, or dropouts, of the fastest column and not of others alone."""
    first, last = np.flatnonzero(sampled)[[0, -1]]
    rows = np.arange(len(sampled))
    return ~between & (rows >= first) & (rows <= last)


def _filled(
    t: Float[np.ndarray, "rows"],
    values: Float[np.ndarray, "rows"],
    sampled: Bool[np.ndarray, "rows"],
    between: Bool[np.ndarray, "rows"],
    held: bool,
) -> Float[np.ndarray, "rows"]:
    if held:
        last = np.searchsorted(t[sampled], t[between], side="right") - 1
        new = values[sampled][last]
    else:
        new = np.interp(t[between], t[sampled], values[sampled])
    result = values.copy()
    result[between] = new
    return result
