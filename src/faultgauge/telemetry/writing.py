"""Writing tables: CSV, plain or gzip-compressed, or Parquet with the extra `io`."""

import csv
import gzip
import io
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from types import NoneType
from typing import Any

from faultgauge.errors import InputError
from faultgauge.files import write_atomically
from faultgauge.phases import phase
from faultgauge.telemetry.clock import Clock
from faultgauge.telemetry.runs import Run
from faultgauge.telemetry.table import float_cells

__all__ = [
    "WRITERS",
    "as_table",
    "check_writable",
    "csv_line",
    "stamp",
    "stamps",
    "table_bytes",
    "write_table",
]


FORMULA = ("=", "+", "-", "@", "\t", "\r")


def _csv(columns: dict[str, list[Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*map(_csv_column, columns.values()), strict=True))
    return text.getvalue().encode()


def _csv_column(cells: list[Any]) -> list[Any]:
    """The cells as they are written: numbers in one go, a text that comes again once."""
    kinds = set(map(type, cells))
    if kinds <= {str, NoneType}:
        told = {cell: _harmless(cell) for cell in set(cells)}
        return [told[cell] for cell in cells]
    if kinds <= {float, NoneType}:
        numbers = tuple(cell for cell in cells if cell is not None)
        texts = iter(("%.10g\n" * len(numbers) % numbers).splitlines())
        return [None if cell is None else next(texts) for cell in cells]
    return _csv_cells(cells)


def _csv_cells(cells: Iterable[Any]) -> list[Any]:
    return [f"{cell:.10g}" if isinstance(cell, float) else _harmless(cell) for cell in cells]


def _harmless(cell: Any) -> Any:
    """Text that a spreadsheet would run as a formula gets an apostrophe, which says: text."""
    runs = isinstance(cell, str) and cell.startswith(FORMULA) and float_cells([cell]) is None
    return f"'{cell}" if runs else cell


def csv_line(row: Iterable[Any]) -> str:
    """One row of a CSV table as `write_table` writes it, newline and all."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(_csv_cells(row))
    return text.getvalue()


def _csv_gz(columns: dict[str, list[Any]]) -> bytes:
    return gzip.compress(_csv(columns), mtime=0)  # no time stamp: the same table, the same bytes


def _parquet(columns: dict[str, list[Any]]) -> bytes:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            "writing Parquet needs an extra package: pip install faultgauge[io]; or write .csv."
        ) from None
    texts = {"run", "time", "status", "reason"}
    arrays = {}
    for name, cells in columns.items():
        array = pyarrow.array(cells)
        if pyarrow.types.is_null(array.type):  # all cells are empty
            array = array.cast(pyarrow.string() if name in texts else pyarrow.float64())
        arrays[name] = array
    buffer = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(arrays), buffer)
    return buffer.getvalue()


WRITERS: dict[str, Callable[[dict[str, list[Any]]], bytes]] = {
    ".csv": _csv,
    ".csv.gz": _csv_gz,
    ".parquet": _parquet,
}


def as_table(run: Run) -> dict[str, list[Any]]:
    """The columns of a log that holds `run`: seconds as `t`, what the log's clock showed, where it
    has one, as `time`; None where nothing was sampled, between the samples of a slow sensor too."""
    own = {name: run.own(name) for name in run.columns}
    columns: dict[str, list[Any]] = {
        name: [None if math.isnan(value) else value for value in values.tolist()]
        for name, values in {"t": run.t, **own}.items()
    }
    if run.clock is None:
        return columns
    return {"t": columns.pop("t"), "time": stamps(run), **columns}


def stamps(run: Run) -> list[str | None]:
    """What the log's clock showed at every sample, ISO 8601; None where it has none."""
    return [stamp(run.clock, t) for t in run.t.tolist()]


def stamp(clock: Clock | None, t: float) -> str | None:
    """What a `clock` shows at `t` [s], ISO 8601; None where it is none."""
    return None if clock is None else clock.at(t).isoformat()


def check_writable(path: Path) -> None:
    """Refuse, before any work, a name that could not be written afterwards."""
    if _suffix(path) is None:
        raise InputError(f"{path}: unknown ending {path.suffix!r}; legal: {', '.join(WRITERS)}.")
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist; create it first.")


def write_table(columns: dict[str, list[Any]], path: Path) -> None:
    """Write `columns` to `path`; None becomes an empty cell. Whole or not at all."""
    check_writable(path)
    with phase("writing tables"):
        write_atomically(path, table_bytes(columns, path))


def table_bytes(columns: dict[str, list[Any]], path: Path) -> bytes:
    """What a file of the name `path` with these `columns` holds."""
    return WRITERS[_suffix(path) or ""](columns)


def _suffix(path: Path) -> str | None:
    return next((suffix for suffix in WRITERS if path.name.lower().endswith(suffix)), None)
