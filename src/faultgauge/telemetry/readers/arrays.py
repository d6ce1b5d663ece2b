"""From named arrays of any size, as MAT and HDF5 files hold them, to one table."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from faultgauge.errors import InputError
from faultgauge.telemetry.readers.cells import MOST_COLUMNS, as_cells, split
from faultgauge.telemetry.table import LogTable
from faultgauge.telemetry.timing import called_like_time

__all__ = ["array_table"]


def array_table(path: Path, arrays: Mapping[str, np.ndarray], units: Mapping[str, str]) -> LogTable:
    """A table of those of `arrays` that are sampled together.

    A vector is a column; an n x k matrix is k columns `name_0` to `name_<k-1>`, its longer side
    being the samples. Scalars, complex numbers and arrays of more sides are left out. Of several
    lengths, that of the time vector is taken, or of most columns where every one or none has a
    time. Raises `InputError` where that leaves a choice, or nothing.
    """
    found = {name: values for name, values in arrays.items() if _length(values) > 1}
    if not found:
        raise InputError(
            f"{path} holds no vector of numbers; save every signal, and the time, as a vector of "
            "one common length."
        )
    samples = _common_length(path, found)
    columns: dict[str, np.ndarray] = {}
    known: dict[str, str] = {}
    left_out = [name for name, values in arrays.items() if values.size > 1 and name not in found]
    for name, values in found.items():
        parts = split(name, values, samples) or {}
        cells = {part: as_cells(part_values) for part, part_values in parts.items()}
        usable = {part: column for part, column in cells.items() if column is not None}
        columns |= usable
        if name in units:
            known |= dict.fromkeys(usable, units[name])
        if not usable:
            left_out.append(name)
    names = ", ".join(f"{name} ({' x '.join(map(str, arrays[name].shape))})" for name in left_out)
    notes = (f"{path}: not made of {samples} samples like the rest, and left out: {names}.",)
    rows = np.arange(1, samples + 1)
    return LogTable(str(path), columns, rows, known, notes if left_out else ())


def _length(values: np.ndarray) -> int:
    """Samples in an array, 0 where it cannot be a signal."""
    shape = [side for side in values.shape if side != 1]
    if values.dtype.kind not in "biufmMSUO" or len(shape) not in (1, 2):
        return 0
    return 0 if len(shape) == 2 and min(shape) > MOST_COLUMNS else max(shape)


def _common_length(path: Path, arrays: Mapping[str, np.ndarray]) -> int:
    widths: Counter[int] = Counter()
    timed: Counter[int] = Counter()
    for name, values in arrays.items():
        length = _length(values)
        widths[length] += values.size // length
        timed[length] += _is_time(name, values)
    legal = [length for length in widths if timed[length]] or list(widths)
    best = max(widths[length] for length in legal)
    lengths = [length for length in legal if widths[length] == best]
    if len(lengths) == 1:
        return lengths[0]
    groups = "; ".join(
        f"{length} samples: {', '.join(n for n, v in arrays.items() if _length(v) == length)[:80]}"
        for length in lengths
    )
    raise InputError(
        f"{path} holds vectors of several lengths ({groups}); save those that belong together, "
        "with their time, in a file of their own."
    )


def _is_time(name: str, values: np.ndarray) -> bool:
    return (
        called_like_time(name)
        and values.size == _length(values)
        and (values.dtype.kind in "MSUO" or bool(np.all(np.diff(values.ravel()) > 0)))
    )
