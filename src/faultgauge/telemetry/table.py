"""A table of cells as read from one file, before anybody decided what its columns mean."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from faultgauge.errors import InputError

__all__ = [
    "LARGEST",
    "LogTable",
    "check_width",
    "float_cells",
    "is_text",
    "text_cells",
    "text_error",
]

MOST_COLUMNS = 10_000  # of a log
LARGEST = 1e100  # of a number: its square is one too


@dataclass(frozen=True, eq=False)
class LogTable:
    """Columns of one file.

    `source` is the path as the user gave it. A number column is float64 with NaN for an empty
    cell; any other column keeps its cells as an object array of `str`. `rows` holds the 1-based
    row of the file that each sample came from, so that an error can point at it. `units` are those
    that the file gives, by column, and `written` are whole headers where a column's name is less of
    it. `notes` say in sentences what of the file is not in the table, `readings` how the file was
    understood, where that is not plain.
    """

    source: str
    columns: dict[str, Shaped[np.ndarray, "rows"]]
    rows: Int[np.ndarray, "rows"]
    units: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    written: dict[str, str] = field(default_factory=dict)
    readings: tuple[str, ...] = ()


def check_width(source: str | Path, count: int) -> None:
    """Refuse a table of more columns than a log has."""
    if count > MOST_COLUMNS:
        raise InputError(
            f"{source}: has {count} columns, and at most {MOST_COLUMNS} are read; leave out those "
            "of no use."
        )


def is_text(column: Shaped[np.ndarray, "rows"]) -> bool:
    """Whether a column holds text, so at least one cell that is neither number nor empty."""
    return column.dtype == object


def float_cells(cells: Sequence[str]) -> Float[np.ndarray, "rows"] | None:
    """Cells as float64, NaN where empty; None if any cell is text."""
    if any("_" in cell for cell in cells):  # to Python, and to nobody else, 1_0 is a number
        return None
    try:
        return np.array([float(cell) if cell else math.nan for cell in cells], dtype=np.float64)
    except ValueError:
        values = [_value(cell) for cell in cells]
    return None if None in values else np.array(values, dtype=np.float64)


def _value(cell: str) -> float | None:
    try:
        return None if "_" in cell else float(cell)
    except ValueError:
        return None if cell.strip() else math.nan


def text_cells(column: Shaped[np.ndarray, "rows"]) -> Bool[np.ndarray, "rows"]:
    """Which cells of a text column are neither number nor empty."""
    return np.array([_value(cell) is None for cell in column], dtype=bool)


def text_error(table: LogTable, name: str) -> InputError:
    """The refusal of text column `name` where numbers are needed."""
    cells = table.columns[name]
    first = int(np.argmax(text_cells(cells)))
    return InputError(
        f"{table.source}, row {table.rows[first]}, column {name!r}: {cells[first][:40]!r} is not a "
        "number; correct the cell, or leave it empty where nothing was sampled."
    )
