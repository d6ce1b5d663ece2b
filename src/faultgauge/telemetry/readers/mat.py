"""MATLAB files: v4 to v7 and v7.3 (`.mat`), by pymatreader."""

import os
import struct
from collections.abc import Iterator, Mapping
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from faultgauge.errors import InputError
from faultgauge.telemetry.readers.arrays import array_table
from faultgauge.telemetry.readers.cells import MOST_COLUMNS, as_text
from faultgauge.telemetry.readers.foreign import package, reading
from faultgauge.telemetry.readers.hdf5 import count_dataset
from faultgauge.telemetry.readers.unpacked import Room, inflate
from faultgauge.telemetry.table import LogTable
from faultgauge.telemetry.timing import called_like_time

__all__ = ["read_mat"]

V5, V73 = 1, 2  # as SciPy counts them
HEADER, TAG, COMPRESSED = 128, 8, 15  # bytes of a file's head and of an element's; miCOMPRESSED
REFERENCE = 0xDD000000  # how MATLAB begins the array that stands for an object of a class
NAMELESS = "None"  # what SciPy before 1.18 calls every object, and so keeps only the last
STEPS, RATES = ("Ts", "ts", "dt"), ("Fs", "fs")  # usual names of a sampling time, s, and rate, Hz
SAME = 1e-6  # of one another: 51200 Hz and 1.953125e-05 s are one, written by hand


def read_mat(path: Path) -> LogTable:
    """Read a `.mat` file; a field of a struct is `struct.field`, an element of a cell `cell.0`.

    A signal in Simulink's "structure with time" is `struct.label`. Which arrays make the table,
    `array_table` says. Where none of them is called like a time, a scalar `Ts` or `dt` (s) or `Fs`
    (Hz) makes the column `t`. Raises `InputError` for a file that is damaged, unpacks to too much
    or holds no vectors but those in objects (timeseries), and where the extra `io` is missing.
    """
    pymatreader = package("pymatreader", path)
    h5py = package("h5py", path)  # pymatreader asks for it only when it meets v7.3
    with reading(path, "MATLAB"):
        _check_size(path, h5py)
        content = pymatreader.read_mat(path)
        if NAMELESS in content and (names := _object_names(path)):
            del content[NAMELESS]
            content |= dict.fromkeys(names, None)
    leaves = _leaves("", content)
    if "__header__" not in content:  # pymatreader returns the names of v7.3 in any order
        leaves = sorted(leaves, key=itemgetter(0))
    found = {name: value for name, value in leaves if not name.startswith(("__", "#"))}
    objects = [name for name, value in found.items() if value is None]
    arrays = {name: value for name, value in found.items() if isinstance(value, np.ndarray)}
    scalars = {name: value for name, value in found.items() if isinstance(value, int | float)}
    if objects and not any(values.size > 1 for values in arrays.values()):
        raise InputError(_unreadable(path, objects))
    table = _timed(array_table(path, arrays, {}), scalars)
    return replace(table, notes=(*table.notes, _unreadable(path, objects))) if objects else table


def _check_size(path: Path, h5py: Any) -> None:
    """Refuse a file that unpacks to too much; v4 is not packed."""
    from scipy.io.matlab import matfile_version  # every command loads the readers

    room = Room(path)

    def visit(_: str | bytes, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.shape is not None:
            count_dataset(item, room)

    version, _ = matfile_version(path)
    if version == V5:
        for data in _packed(path):
            inflate(data, room)
    elif version == V73:
        with h5py.File(path, "r") as file:
            file.visititems(visit)


def _packed(path: Path) -> Iterator[bytes]:
    """The compressed elements of a file of v5."""
    with path.open("rb") as file:
        order = "<" if file.read(HEADER)[-2:] == b"IM" else ">"
        while len(tag := file.read(TAG)) == TAG:
            kind, size = struct.unpack(f"{order}2I", tag)
            if kind == COMPRESSED:
                yield file.read(size)
            else:
                file.seek(size, os.SEEK_CUR)


def _object_names(path: Path) -> list[str]:
    """The names of the objects in a file of v5, where SciPy does not tell them."""
    from scipy.io.matlab import MatlabOpaque, loadmat, varmats_from_mat

    with path.open("rb") as file:
        parts = [loadmat(part).get(NAMELESS) for _, part in varmats_from_mat(file)]
    return [as_text(part["s0"][0]) for part in parts if isinstance(part, MatlabOpaque)]


def _unreadable(path: Path, names: list[str]) -> str:
    return (
        f"{path}: objects of MATLAB classes (timeseries, timetable, string, ...) are not read, "
        f"here {', '.join(names)}; in MATLAB, save vectors in their place, of a timeseries by "
        f"t = {names[0]}.Time; y = {names[0]}.Data; save('log.mat', 't', 'y')."
    )


def _timed(table: LogTable, scalars: Mapping[str, float]) -> LogTable:
    """`table` with a column `t` from the sampling time among `scalars`, if it has no time."""
    if any(called_like_time(name) for name in table.columns):
        return table
    steps = {}
    for name, value in scalars.items():
        last = name.rpartition(".")[2]
        if last in STEPS + RATES and 0 < value < np.inf:
            steps[name] = value if last in STEPS else 1 / value
    if not steps or not np.allclose(list(steps.values()), min(steps.values()), rtol=SAME, atol=0):
        return table
    name, step = next(iter(steps.items()))
    note = (
        f"{table.source} has no time: t is made in steps of {step:.6g} s, from "
        f"{name} = {scalars[name]:.6g}."
    )
    return replace(
        table,
        columns={"t": step * np.arange(len(table.rows))} | table.columns,
        units=table.units | {"t": "s"},
        notes=(*table.notes, note),
    )


def _leaves(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Arrays and numbers by name; None for an object, which pymatreader makes of a string only."""
    match value:
        case None | {"_TypeSystem": ["MCOS"]} | {"s1": [b"MCOS"]}:  # v5, SciPy from 1.18, before
            yield name, None
        case {"time": _, "signals": {"values": values, "label": labels}} if name:
            yield from _leaves(name, {key: value[key] for key in value if key != "signals"})
            yield from _signals(name, values, labels)
        case dict():
            for key, item in value.items():
                yield from _leaves(f"{name}.{as_text(key)}" if name else as_text(key), item)
        case list() if value and all(isinstance(item, str) for item in value):
            yield name, np.array(value, dtype=object)
        case list() if len(value) <= MOST_COLUMNS:
            for index, item in enumerate(value):
                yield from _leaves(f"{name}.{index}", item)
        case np.ndarray():
            is_object = value.dtype == np.uint32 and value.size and value.flat[0] == REFERENCE
            yield name, None if is_object else value
        case int() | float():
            yield name, value
        case _:
            pass


def _signals(name: str, values: Any, labels: Any) -> Iterator[tuple[str, Any]]:
    """Simulink's structure with time: `log.signals(k).values` goes by its label, if it has one."""
    several = isinstance(values, list)
    items, texts = (values, labels) if several else ([values], [labels])
    texts = [label if isinstance(label, str) else "" for label in texts]
    for k, (item, label) in enumerate(zip(items, texts, strict=True)):
        if label in ("", "time") or texts.count(label) > 1:
            label = f"signals.values.{k}" if several else "signals.values"
        yield from _leaves(f"{name}.{label}", item)
