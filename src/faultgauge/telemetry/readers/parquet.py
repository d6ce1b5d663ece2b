"""Apache Parquet (`.parquet`), by pyarrow."""

from pathlib import Path
from typing import Any

import numpy as np

from faultgauge.errors import InputError
from faultgauge.telemetry.headers import with_units
from faultgauge.telemetry.readers.cells import as_cells
from faultgauge.telemetry.readers.foreign import package, reading
from faultgauge.telemetry.readers.frames import UNIT_KEYS
from faultgauge.telemetry.readers.unpacked import Room
from faultgauge.telemetry.table import LogTable

__all__ = ["read_parquet"]

ROWS = 1 << 16  # of a batch
CELL = 8  # bytes of a number in memory


def read_parquet(path: Path) -> LogTable:
    """Read a Parquet file; a field of a struct is `struct.field`, a null an empty cell.

    Time stamps become seconds since the first in their column, durations seconds. The field
    metadata `unit` or `units` is a column's unit. Raises `InputError` for a file that is damaged,
    unpacks to too much, has fewer than two rows or two columns of one name, and where the extra
    `io` is missing.
    """
    pyarrow = package("pyarrow", path)
    parquet = package("pyarrow.parquet", path)
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    left_out = []
    with reading(path, "Parquet"):
        table = _unpacked(pyarrow, parquet.ParquetFile(path), path)
        while any(pyarrow.types.is_struct(field.type) for field in table.schema):
            table = table.flatten()
        names = table.column_names
        for name, field, column in zip(names, table.schema, table.columns, strict=True):
            cells = _cells(pyarrow, column)
            if cells is None:
                left_out.append(f"{name} ({field.type})")
                continue
            columns[name] = cells
            unit = next((u for k in UNIT_KEYS if (u := (field.metadata or {}).get(k))), None)
            if unit is not None and not pyarrow.types.is_temporal(field.type):  # in seconds by now
                units[name] = unit.decode()
    if len(set(names)) < len(names):
        repeated = next(name for name in names if names.count(name) > 1)
        raise InputError(
            f"{path}: two columns are called {repeated!r}; give every column its own name."
        )
    if table.num_rows < 2:
        raise InputError(f"{path} has {table.num_rows} row(s); a log needs at least two samples.")
    notes = [f"{path}: neither numbers nor text, and left out: {', '.join(left_out)}."]
    rows = np.arange(1, table.num_rows + 1)
    return with_units(LogTable(str(path), columns, rows, units, tuple(notes) if left_out else ()))


def _unpacked(pyarrow: Any, file: Any, path: Path) -> Any:
    """The table in a file, by batches whose text has room, too: each cell may be all that a group
    of rows holds."""
    Room(path).take(CELL * file.metadata.num_rows * file.metadata.num_columns)
    room = Room(path)
    groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
    longest = max((each.total_byte_size for each in groups), default=0)
    batches = []
    for batch in file.iter_batches(min(ROWS, max(1, room.left // max(longest, 1)))):
        room.take(batch.nbytes)
        batches.append(batch)
    return pyarrow.Table.from_batches(batches, file.schema_arrow)


def _cells(pyarrow: Any, column: Any) -> np.ndarray | None:
    types = pyarrow.types
    kind = column.type
    if types.is_dictionary(kind):
        column = column.cast(kind.value_type)
        kind = column.type
    if types.is_null(kind):
        return np.full(len(column), np.nan)
    if types.is_date(kind):
        column = column.cast(pyarrow.timestamp("s"))
    if types.is_temporal(kind) and not types.is_time(kind):
        return as_cells(column.to_numpy())
    if types.is_boolean(kind):
        column = column.cast(pyarrow.int8())
        kind = column.type
    if types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind):
        return column.cast(pyarrow.float64(), safe=False).to_numpy()
    if types.is_string(kind) or types.is_large_string(kind):
        return np.array([cell or "" for cell in column.to_pylist()], dtype=object)
    return None
