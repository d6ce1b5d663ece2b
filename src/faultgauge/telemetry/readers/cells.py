"""Arrays of other packages as the cells of a table: float64 with NaN, or text."""

from collections.abc import Sequence
from datetime import date, timedelta
from numbers import Real
from typing import Any

import numpy as np
from jaxtyping import Shaped

__all__ = ["MOST_COLUMNS", "as_cells", "as_text", "from_list", "split"]

MOST_COLUMNS = 100  # a wider matrix is an image or a spectrum, not a set of signals
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def as_cells(values: Shaped[np.ndarray, "rows"]) -> Shaped[np.ndarray, "rows"] | None:
    """A column of a table, or None if `values` are neither real numbers, times nor text.

    Dates and durations become seconds, dates since the first of them.
    """
    kind = values.dtype.kind
    if kind in "biuf":
        return values.astype(np.float64)
    if kind in "mM":
        return _seconds(values)
    if kind in "SUO" and all(isinstance(cell, str | bytes) for cell in values):
        return np.array([as_text(cell) for cell in values], dtype=object)
    return None


def as_text(cell: str | bytes) -> str:
    """Text of a file that may hold bytes in no known encoding."""
    return cell if isinstance(cell, str) else cell.decode("utf-8", "replace").rstrip("\0")


def _seconds(values: Shaped[np.ndarray, "rows"]) -> Shaped[np.ndarray, "rows"]:
    """Differences are taken as integers: float64 holds no nanoseconds since 1970."""
    unit, count = np.datetime_data(values.dtype)
    if unit not in SECONDS:
        values = values.astype(values.dtype.kind + "8[s]")
        unit, count = "s", 1
    empty = np.isnat(values)
    ticks = values.astype(np.int64)
    if values.dtype.kind == "M" and not empty.all():
        ticks = ticks - ticks[np.argmin(empty)]
    return np.where(empty, np.nan, ticks * (count * SECONDS[unit]))


def split(name: str, values: np.ndarray, samples: int) -> dict[str, np.ndarray] | None:
    """The columns of one array: itself, or `name_0`, `name_1`, ... of a matrix.

    `samples` is the common length; where both sides of a matrix have it, rows are samples. None
    if the array is not made of that many samples.
    """
    values = np.squeeze(values) if values.ndim > 1 else values
    if values.ndim == 1 and len(values) == samples:
        return {name: values}
    if values.ndim != 2 or samples not in values.shape or min(values.shape) > MOST_COLUMNS:
        return None
    table = values if values.shape[0] == samples else values.T
    return {f"{name}_{k}": table[:, k] for k in range(table.shape[1])}


def from_list(values: Sequence[Any]) -> Shaped[np.ndarray, "rows"] | None:
    """A column of a table of objects of Python, timestamps as text; None if they are neither."""
    there = [value for value in values if not _missing(value)]
    if all(isinstance(value, Real) for value in there):
        return np.array([np.nan if _missing(v) else float(v) for v in values], dtype=np.float64)
    if all(isinstance(value, timedelta) for value in there):
        return np.array([np.nan if _missing(v) else v.total_seconds() for v in values])
    if all(isinstance(value, Real | str | bytes | date) for value in there):
        return np.array([_text(value) for value in values], dtype=object)
    return None


def _text(value: Any) -> str:
    if _missing(value):
        return ""
    if isinstance(value, str | bytes):
        return as_text(value)
    return value.isoformat() if isinstance(value, date) else str(value)


def _missing(value: Any) -> bool:
    """Empty: None, NaN, and what pandas has for them."""
    if value is None or type(value).__name__ in ("NAType", "NaTType"):
        return True
    return isinstance(value, float) and value != value
