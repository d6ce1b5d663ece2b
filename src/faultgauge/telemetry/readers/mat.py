"""MATLAB files: v4 to v7 and v7.3 (`.mat`), by pymatreader."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from faultgauge.telemetry.readers.arrays import array_table
from faultgauge.telemetry.readers.cells import MOST_COLUMNS, as_text
from faultgauge.telemetry.readers.foreign import package, reading
from faultgauge.telemetry.table import Table

__all__ = ["read_mat"]


def read_mat(path: Path) -> Table:
    """Read a `.mat` file; a field of a struct is `struct.field`, an element of a cell `cell.0`.

    Which arrays make the table, `array_table` says. Raises `InputError` for a file that is
    damaged or holds no vectors, and where the extra `io` is missing.
    """
    pymatreader = package("pymatreader", path)
    package("h5py", path)  # pymatreader asks for it only when it meets v7.3
    with reading(path, "MATLAB"):
        content = pymatreader.read_mat(path)
    arrays = {name: values for name, values in _leaves("", content) if not name.startswith("__")}
    return array_table(path, arrays, {})


def _leaves(name: str, value: Any) -> Iterator[tuple[str, np.ndarray]]:
    match value:
        case dict():
            for key, item in value.items():
                yield from _leaves(f"{name}.{as_text(key)}" if name else as_text(key), item)
        case list() if value and all(isinstance(item, str) for item in value):
            yield name, np.array(value, dtype=object)
        case list() if len(value) <= MOST_COLUMNS:
            for index, item in enumerate(value):
                yield from _leaves(f"{name}.{index}", item)
        case np.ndarray():
            yield name, value
        case _:
            pass
