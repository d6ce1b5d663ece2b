"""Telemetry that arrives line by line: CSV or NDJSON in, checked samples out.

Every row goes through the same functions as a file: `--map`, `--time`, and the refusals of text,
Inf and a time that does not increase.
"""

import csv
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from faultgauge.errors import InputError
from faultgauge.telemetry.logs import RUN
from faultgauge.telemetry.mapping import apply_maps, find_column, parse_maps
from faultgauge.telemetry.readers.csv import check_separator, header
from faultgauge.telemetry.reading import check_present, finite_or_empty
from faultgauge.telemetry.table import Table, float_cells
from faultgauge.telemetry.timing import find_time, seconds

__all__ = ["SOURCE", "Sample", "read_stream"]

SOURCE = "standard input"


class Sample(NamedTuple):
    """One row: time [s] and the signals that were asked for, NaN where not sampled."""

    t: float
    values: dict[str, float]


def read_stream(
    lines: Iterable[str],
    *,
    time: str | None = None,
    maps: Iterable[str] = (),
    names: Sequence[str] = (),
    optional: Sequence[str] = (),
) -> Iterator[Sample]:
    """Samples of one run, each as soon as its line is there; blank lines are passed over.

    The first line tells CSV (a header row of names) from NDJSON (an object per line, whose keys
    are the columns; a key that is missing later is an empty cell). `time`, `maps`, `names` and
    `optional` are those of `read_telemetry`, and so are the refusals, as `InputError`.
    """
    reader = _Reader(time, parse_maps(maps), names, optional)
    for row, cells in _cells(lines):
        yield reader.sample(row, cells)


def _cells(lines: Iterable[str]) -> Iterator[tuple[int, dict[str, Any]]]:
    """(row, {column: cell}) of every line that holds one."""
    names: list[str] = []
    ndjson = False
    for row, line in enumerate(lines, 1):
        line = line.removeprefix("\ufeff").rstrip("\r\n") if row == 1 else line.rstrip("\r\n")
        if not line.strip():
            continue
        if not names:
            ndjson = line.lstrip().startswith("{")
            if ndjson:
                found = _object(row, line)
                names = list(found)
                yield row, found
                continue
            check_separator(Path(SOURCE), line)
            names, _ = header(Path(SOURCE), [line])
        elif ndjson:
            found = _object(row, line)
            yield row, {name: found.get(name, "") for name in names}
        else:
            yield row, dict(zip(names, _split(row, line, len(names)), strict=True))


def _object(row: int, line: str) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict) or not found:
        raise InputError(
            f"{SOURCE}, row {row}: {line[:60]!r} is not a JSON object; send one object per line."
        )
    return {name: "" if cell is None else cell for name, cell in found.items()}


def _split(row: int, line: str, count: int) -> list[str]:
    try:
        (cells,) = csv.reader([line], strict=True)
    except csv.Error as failure:
        raise InputError(f"{SOURCE}, row {row}: {failure}; check the quotes there.") from None
    if len(cells) != count:
        raise InputError(
            f"{SOURCE}, row {row}: {len(cells)} cells where the header has {count}; complete or "
            "remove the row."
        )
    return cells


class _Reader:
    """Turns rows into samples; the first of them decides which columns are meant."""

    def __init__(
        self,
        time: str | None,
        maps: dict[str, str],
        names: Sequence[str],
        optional: Sequence[str],
    ) -> None:
        self.time, self.maps, self.names, self.optional = time, maps, names, optional
        self.first: tuple[int, dict[str, Any]] | None = None
        self.columns: dict[str, str] = {}
        self.last: float | None = None

    def sample(self, row: int, cells: dict[str, Any]) -> Sample:
        """The sample of one row, `InputError` for what no log may hold."""
        table = self.table(row, cells)
        if self.last is None:
            self.time = find_time(table, self.time, "t" in self.maps)
            check_present(table, self.names)
            wanted = dict.fromkeys([*self.names, *self.optional])
            found = {name: find_column(table, name) for name in wanted}
            self.columns = {name: column for name, column in found.items() if column is not None}
        assert self.time is not None
        t = float(seconds(table, self.time)[-1])
        if self.last is not None:
            self.check_order(row, cells, t)
        self.last = t
        values = {
            name: float(finite_or_empty(table, column)[-1]) for name, column in self.columns.items()
        }
        return Sample(t, values)

    def table(self, row: int, cells: dict[str, Any]) -> Table:
        """The first row and this one: timestamps are seconds since the first."""
        self.first = self.first or (row, cells)
        pairs = {name: (self.first[1][name], cell) for name, cell in cells.items()}
        columns = {name: _column(pair) for name, pair in pairs.items()}
        table = Table(SOURCE, columns, np.array([self.first[0], row]))
        return apply_maps(table, self.maps) if self.maps else table

    def check_order(self, row: int, cells: dict[str, Any], t: float) -> None:
        assert self.first is not None
        if t <= (self.last or 0.0):
            what = "is the same again" if t == self.last else "runs backwards"
            raise InputError(
                f"{SOURCE}, row {row}: time {what} ({t:.9g} s after {self.last:.9g} s); a stream "
                "is one run, so send its rows in order, each once."
            )
        if cells.get(RUN) != self.first[1].get(RUN):
            raise InputError(
                f"{SOURCE}, row {row}: a new run, {cells[RUN]!r}, begins; a stream is one run, so "
                "send each to a call of its own."
            )


def _column(pair: tuple[Any, Any]) -> np.ndarray:
    """Two cells as numbers, or as text where one of them is text."""
    if all(isinstance(cell, float) for cell in pair):
        return np.array(pair)
    texts = [
        cell if isinstance(cell, str) else repr(cell) if _is_number(cell) else json.dumps(cell)
        for cell in pair
    ]
    numbers = float_cells(texts)
    return np.array(texts, dtype=object) if numbers is None else numbers


def _is_number(cell: Any) -> bool:
    return isinstance(cell, int | float) and not isinstance(cell, bool)
