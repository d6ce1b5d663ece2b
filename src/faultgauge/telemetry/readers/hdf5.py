"""HDF5 (`.h5`, `.hdf5`), by h5py."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from faultgauge.telemetry.readers.arrays import array_table
from faultgauge.telemetry.readers.cells import as_text
from faultgauge.telemetry.readers.foreign import package, reading
from faultgauge.telemetry.readers.unpacked import Room
from faultgauge.telemetry.table import LogTable

__all__ = ["count_dataset", "read_hdf5"]

UNIT_ATTRIBUTES = ("unit", "units")
ROWS = 100  # of text that are read at once


def read_hdf5(path: Path) -> LogTable:
    """Read the datasets of an HDF5 file under their paths (`group/name`).

    A field of a compound dataset is `name/field`. The attribute `unit` or `units` of a dataset is
    its unit. Which datasets make the table, `array_table` says. Raises `InputError` for a file
    that is damaged, unpacks to too much or holds no vectors, and where the extra `io` is missing.
    """
    h5py = package("h5py", path)
    room = Room(path)
    arrays: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}

    def visit(path_inside: str | bytes, item: Any) -> None:
        name = as_text(path_inside)
        if not isinstance(item, h5py.Dataset) or item.shape is None or item.size < 2:
            return
        count_dataset(item, room)
        if item.dtype.names:
            records = item[()]
            arrays.update({f"{name}/{part}": records[part] for part in item.dtype.names})
            return
        text = h5py.check_string_dtype(item.dtype)
        arrays[name] = item[()] if text is None else _text(item, room)
        for attribute in UNIT_ATTRIBUTES:
            if attribute in item.attrs:
                units[name] = _unit(item.attrs[attribute])

    with reading(path, "HDF5"), h5py.File(path, "r") as file:
        file.visititems(visit)
    return array_table(path, arrays, units)


def count_dataset(item: Any, room: Room) -> None:
    """Take from `room` what a dataset holds, whose chunks are unpacked whole."""
    chunk = math.prod(item.chunks or ()) * item.dtype.itemsize
    room.take(max(item.nbytes, chunk))


def _text(item: Any, room: Room) -> np.ndarray:
    """The cells of a dataset of text, a few at a time: many may stand for the same long one."""
    cells, parts = item.asstr(errors="replace"), []
    for first in range(0, len(item), ROWS):
        part = cells[first : first + ROWS]
        room.take(sum(len(cell) for cell in part.flat))
        parts.append(part)
    return np.concatenate(parts)


def _unit(value: Any) -> str:
    first = np.ravel(value)[0] if np.size(value) else ""
    return as_text(first) if isinstance(first, bytes) else str(first)
