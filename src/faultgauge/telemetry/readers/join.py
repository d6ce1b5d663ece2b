"""Channels that are sampled at times of their own become one table (outer join on time)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Shaped

from faultgauge.errors import InputError
from faultgauge.telemetry.readers.cells import as_cells, split
from faultgauge.telemetry.runs import ROUNDING
from faultgauge.telemetry.table import LogTable, is_text

__all__ = ["Channel", "join"]


@dataclass(frozen=True, eq=False)
class Channel:
    """One channel: samples at increasing times `t` (s); the first axis of `values` is time."""

    name: str
    t: Float[np.ndarray, "samples"]
    values: Shaped[np.ndarray, "samples ..."]
    unit: str = ""


def join(path: Path, channels: Sequence[Channel], notes: Sequence[str] = ()) -> LogTable:
    """A table with a row for every time at which any channel was sampled, time as column `t`.

    A cell is empty where its channel was not sampled. Times that differ by less than a thousandth
    of the shortest median step are one: clocks are written with rounding. Raises `InputError`
    where there is nothing to join or the time of a channel does not increase.
    """
    for channel in channels:
        wrong = np.flatnonzero(np.diff(channel.t) <= 0)
        if wrong.size:
            raise InputError(
                f"{path}, channel {channel.name!r}: time does not increase from sample "
                f"{wrong[0] + 1} ({channel.t[wrong[0]]:.9g} s) to the next "
                f"({channel.t[wrong[0] + 1]:.9g} s); export the log again, sorted by time."
            )
    usable = [channel for channel in channels if len(channel.t) > 1]
    if not usable:
        raise InputError(f"{path} holds no channel with two samples or more; nothing can be read.")
    t, tolerance = _all_times([channel.t for channel in usable])
    columns: dict[str, np.ndarray] = {"t": t}
    units = {"t": "s"}
    left_out = [channel.name for channel in channels if len(channel.t) < 2]
    for channel in usable:
        parts = split(channel.name, channel.values, len(channel.t)) or {}
        cells = {part: as_cells(values) for part, values in parts.items()}
        rows = _rows(t, channel.t, tolerance)
        for part, values in cells.items():
            if values is not None:
                columns[part] = _spread(values, rows, len(t))
                units |= {part: channel.unit} if channel.unit else {}
        if all(values is None for values in cells.values()):
            left_out.append(channel.name)
    if left_out:
        text = f"{path}: neither numbers nor text, or one sample only, and left out: "
        notes = [*notes, f"{text}{', '.join(left_out)}."]
    return LogTable(str(path), columns, np.arange(1, len(t) + 1), units, tuple(notes))


def _all_times(times: Sequence[Float[np.ndarray, "_"]]) -> tuple[Float[np.ndarray, "rows"], float]:
    distinct = np.unique(np.concatenate(times))
    tolerance = ROUNDING * min(float(np.median(np.diff(t))) for t in times)
    return distinct[np.append(True, np.diff(distinct) > tolerance)], tolerance


def _rows(
    t: Float[np.ndarray, "rows"], sampled: Float[np.ndarray, "samples"], tolerance: float
) -> Int[np.ndarray, "samples"]:
    return np.searchsorted(t, sampled + tolerance, side="right") - 1


def _spread(
    values: Shaped[np.ndarray, "samples"], rows: Int[np.ndarray, "samples"], count: int
) -> Shaped[np.ndarray, "rows"]:
    empty = "" if is_text(values) else np.nan
    cells = np.full(count, empty, dtype=values.dtype)
    cells[rows] = values
    return cells
