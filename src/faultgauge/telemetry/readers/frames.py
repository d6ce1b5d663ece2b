"""What is in memory already, as a table: data frames of any package that narwhals knows (pandas,
Polars, PyArrow, ...), and dicts of arrays."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Shaped

from faultgauge.errors import InputError
from faultgauge.telemetry.headers import with_units
from faultgauge.telemetry.readers.cells import as_cells, from_list, split
from faultgauge.telemetry.table import LogTable, check_width

__all__ = ["UNIT_KEYS", "is_frame", "read_frame"]

UNIT_KEYS = (b"unit", b"units")


def is_frame(given: Any) -> bool:
    """Whether `given` is a data frame or a dict of columns."""
    import narwhals as nw

    known = nw.from_native(given, pass_through=True)
    return isinstance(known, nw.DataFrame | nw.LazyFrame | Mapping)


def read_frame(given: Any, source: str) -> LogTable:
    """The columns of a data frame or of a dict of arrays; `source` is what messages call it.

    Empty cells are None, NaN or NaT; dates are taken as timestamps, durations in seconds. An index
    of pandas is a column where it has a name, and the time `t` where it holds dates or durations
    without one. Units are those of a PyArrow field's metadata (`unit`, `units`) or of
    `frame.attrs["units"]` of pandas. A matrix of a dict is the columns `name_0`, `name_1`, ...
    Raises `InputError` for columns of different lengths and for fewer than two rows.
    """
    if isinstance(given, Mapping):
        columns, units = _arrays(given, source), {}
    else:
        columns, units = _frame(given), _units(given)
    check_width(source, len(columns))
    if not columns:
        raise InputError(f"{source} has no column; give one per signal, and the time.")
    rows = len(next(iter(columns.values())))
    if rows < 2:
        raise InputError(f"{source} has {rows} row(s); a log needs at least two samples.")
    cells = {name: _cells(values) for name, values in columns.items()}
    kept = {name: column for name, column in cells.items() if column is not None}
    left_out = [name for name in cells if name not in kept]
    notes = (f"{source}: neither numbers nor text, and left out: {', '.join(left_out)}.",)
    units = {name: unit for name, unit in units.items() if name in kept}
    rows = np.arange(1, rows + 1)
    return with_units(LogTable(source, kept, rows, units, notes if left_out else ()))


def _arrays(given: Mapping[Any, Any], source: str) -> dict[str, Any]:
    columns: dict[str, Any] = {}
    for name, values in given.items():
        try:
            array = np.asarray(values)
        except ValueError:  # rows of different lengths
            array = np.array(None)
        if array.ndim not in (1, 2):
            raise InputError(
                f"{source}, column {name!r}: is no array of samples; give one number per sample."
            )
        columns |= split(str(name), array, len(array)) or {}
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        few, many = min(lengths, key=lambda n: lengths[n]), max(lengths, key=lambda n: lengths[n])
        raise InputError(
            f"{source}: column {few!r} has {lengths[few]} samples, but {many!r} has "
            f"{lengths[many]}; give every column as many as the time has."
        )
    return columns


def _frame(given: Any) -> dict[str, Any]:
    """Columns as arrays of numbers, else as lists."""
    import narwhals as nw

    frame = nw.from_native(_with_index(given))
    if isinstance(frame, nw.LazyFrame):
        frame = frame.collect()
    found: dict[str, Any] = {}
    for name in frame.columns:
        series = frame[name]
        number = series.dtype.is_numeric()
        found[str(name)] = (
            np.asarray(series.cast(nw.Float64).to_numpy(), float) if number else series.to_list()
        )
    return found


def _with_index(given: Any) -> Any:
    """A frame of pandas with its index as a column, where that is no mere number of the row."""
    import narwhals as nw

    frame = nw.from_native(given)
    index = nw.maybe_get_index(frame) if isinstance(frame, nw.DataFrame) else None
    timed = type(index).__name__ in ("DatetimeIndex", "TimedeltaIndex")
    if index is None or not (timed or index.name is not None) or index.name in frame.columns:
        return given
    return given.rename_axis(index.name or "t").reset_index()


def _units(given: Any) -> dict[str, str]:
    attributes = getattr(given, "attrs", {})
    if isinstance(attributes, Mapping) and isinstance(attributes.get("units"), Mapping):
        return {str(name): str(unit) for name, unit in attributes["units"].items()}
    found = {}
    for field in getattr(given, "schema", ()):
        known = getattr(field, "metadata", None) or {}
        unit = next((known[key] for key in UNIT_KEYS if key in known), None)
        if unit is not None:
            found[field.name] = unit.decode()
    return found


def _cells(values: Any) -> Shaped[np.ndarray, "rows"] | None:
    """A column of a table; timestamps as text, which keeps what the clock showed."""
    if isinstance(values, np.ndarray) and values.dtype.kind == "M":
        stamps = np.datetime_as_string(values.astype("datetime64[us]"))
        return np.where(np.isnat(values), "", stamps).astype(object)
    if isinstance(values, np.ndarray) and values.dtype.kind != "O":
        return as_cells(values)
    return from_list(list(values))
