"""Telemetry that arrives line by line: CSV or NDJSON in, checked samples out.

Every row goes through the same functions as a file: its dialect, `--map`, `--time`, and the
refusals of text, Inf and a time that does not increase.
"""

import csv
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from faultgauge.errors import InputError
from faultgauge.telemetry.clock import Clock
from faultgauge.telemetry.headers import split_headers, unit_row
from faultgauge.telemetry.logs import RUN, Before, recalled
from faultgauge.telemetry.mapping import apply_maps, find_column, parse_maps
from faultgauge.telemetry.readers.csv import HEAD, WINDOWS, header
from faultgauge.telemetry.readers.dialect import Decimals, named_separator, separator_of
from faultgauge.telemetry.reading import check_present, finite_or_empty, unit_change
from faultgauge.telemetry.runs import GAP_STEPS, ROUNDING
from faultgauge.telemetry.summer_time import ClockChange, Evenly, change_note
from faultgauge.telemetry.table import LogTable, float_cells
from faultgauge.telemetry.timing import check_form, clock_of, find_time, in_seconds, seconds

__all__ = ["NAME", "SOURCE", "Sample", "read_stream"]

SOURCE = "standard input"
NAME = "stream"  # of its run
IN_ORDER = "a stream is one run, so send its rows in order, each once"
GAP = GAP_STEPS + ROUNDING


class Sample(NamedTuple):
    """One row: time [s] and the signals that were asked for, NaN where not sampled; and the
    stream's `clock`, as it was put so far, where it has one."""

    t: float
    values: dict[str, float]
    clock: Clock | None = None


class _RowError(InputError):
    """One row is no telemetry; those after it may be."""


def _refuse(wrong: InputError) -> None:
    raise wrong


def read_stream(
    lines: Iterable[Sequence[str]],
    *,
    time: str | None = None,
    maps: Iterable[str] = (),
    names: Sequence[str] = (),
    optional: Sequence[str] = (),
    units: Mapping[str, str] | None = None,
    time_format: str | None = None,
    before: Before | None = None,
    skip: Callable[[InputError], None] = _refuse,
    note: Callable[[str], None] = lambda text: None,
) -> Iterator[list[Sample]]:
    """Samples of one run, of each of `lines` that come at once those; blank lines are passed over.

    The first line tells CSV (a header row of names) from NDJSON (an object per line, whose keys
    are the columns; a key that is missing later is an empty cell). The other arguments are those of
    `read_telemetry`, and so are the refusals, as `InputError`. What is wrong with one row goes to
    `skip`, which refuses it as well; where it returns, the row is left out. A last line without its
    newline is no row: nobody knows what of it is missing. A row behind a gap waits for the next:
    where that goes on from before the gap, the row behind it was wrong. `note` is told how columns
    are understood where that is not plain.
    """
    if time_format is not None:
        check_form(time_format)
    columns, rows = _Columns(), count(1)
    wanted = [*names, *(each for each in optional if each not in names)]
    reader = _Reader(
        columns, time, time_format, parse_maps(maps), before, names, wanted, units or {}, skip, note
    )
    for several in lines:
        samples = []
        try:
            for line, row in zip(several, rows, strict=False):
                try:
                    cells = columns.cells(row, line)
                    for text in columns.told():
                        note(text)
                    if cells is not None:
                        reader.prepare(row, cells)
                        samples += reader.samples(row, cells)
                except _RowError as wrong:
                    skip(wrong)
        except InputError:
            yield [*samples, *reader.rest()]  # what came before is answered
            raise
        yield samples
    yield reader.rest()


class _Columns:
    """Lines to cells, by the columns of the first line."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.units: dict[str, str] = {}
        self.written: dict[str, str] = {}
        self.ndjson = False
        self.begun = False
        self.decimals = Decimals(",")
        self.named: str | None = None  # the separator that a first line names
        self.notes: list[str] = []
        self.said = False

    def cells(self, row: int, line: str) -> dict[str, Any] | None:
        """{column: cell} of a line that holds a row."""
        text = line.removeprefix("\ufeff").rstrip("\r\n") if row == 1 else line.rstrip("\r\n")
        if not text.strip():
            return None
        if not line.endswith("\n"):
            raise _RowError(
                f"{SOURCE}, row {row}: the stream ends within {text[-40:]!r}, with no newline, so "
                "the row may be cut short; end every row with a newline."
            )
        text = self._decoded(row, text)
        if not self.names and row == 1:
            self.named = named_separator(text)
            if self.named:
                return None
        if not self.names:
            self.ndjson = text.lstrip().startswith("{")
            if not self.ndjson:
                self.decimals = Decimals(self.named or separator_of(text))
                self._take(header(Path(SOURCE), [text], self.decimals.separator)[0])
                return None
        first, self.begun = not self.begun, True
        if not self.ndjson:
            cells = _split(row, text, len(self.names), self.decimals.separator)
            units = unit_row(cells) if first else None
            if units is None:
                return self._plain(row, dict(zip(self.names, cells, strict=True)))
            self.units |= {n: unit for n, unit in zip(self.names, units, strict=True) if unit}
            return None
        found = _object(row, text)
        if not self.names:
            self._take(list(found))
        return {name: found.get(self.written.get(name, name), "") for name in self.names}

    def told(self) -> list[str]:
        """Sentences about how lines are read that were not given yet."""
        notes, self.notes = self.notes, []
        return notes

    def _plain(self, row: int, cells: dict[str, str]) -> dict[str, str]:
        """`cells` with decimal points; which decimals there are is said once."""
        try:
            found = self.decimals.plain(SOURCE, row, cells)
        except InputError as wrong:
            raise _RowError(str(wrong)) from None
        dialect = self.decimals.dialect
        if dialect is not None and not self.said:
            self.said = True
            self.notes += dialect.note(SOURCE)
        return found

    def _decoded(self, row: int, text: str) -> str:
        """`text`, in which a header may be from Windows."""
        try:
            text.encode()
        except UnicodeEncodeError:  # what is no UTF-8 was kept as surrogates
            if row > HEAD or self.begun or "\0" in text:
                raise _RowError(
                    f"{SOURCE}, row {row}: the text is not UTF-8; send UTF-8."
                ) from None
            sentence = f"{SOURCE}: {WINDOWS}."
            self.notes += [] if sentence in self.notes else [sentence]
            return text.encode(errors="surrogateescape").decode("cp1252", errors="replace")
        return text

    def _take(self, headers: list[str]) -> None:
        self.names, self.units, self.written = split_headers(headers)

    def table(self, cells: dict[str, np.ndarray], rows: Sequence[int]) -> LogTable:
        return LogTable(SOURCE, cells, np.array(rows), self.units, written=self.written)


def _object(row: int, line: str) -> dict[str, Any]:
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict) or not found:
        raise _RowError(
            f"{SOURCE}, row {row}: {line[:60]!r} is not a JSON object; send one object per line."
        )
    return {name: "" if cell is None else cell for name, cell in found.items()}


def _split(row: int, line: str, count: int, separator: str) -> list[str]:
    try:
        (cells,) = csv.reader([line], delimiter=separator, strict=True)
    except csv.Error as failure:
        raise _RowError(f"{SOURCE}, row {row}: {failure}; check the quotes there.") from None
    if len(cells) != count:
        raise _RowError(
            f"{SOURCE}, row {row}: {len(cells)} cells where the header has {count}; complete or "
            "remove the row."
        )
    return cells


class _Read(NamedTuple):
    """A row that is telemetry; what its clock `shown`, and where it was put."""

    row: int
    cells: dict[str, Any]
    sample: Sample
    shown: float
    change: ClockChange | None


class _Reader:
    """Turns rows into samples; the first of them decides which columns are meant."""

    def __init__(
        self,
        given: _Columns,
        time: str | None,
        time_format: str | None,
        maps: dict[str, str],
        before: Before | None,
        names: Sequence[str],
        wanted: Sequence[str],
        units: Mapping[str, str],
        skip: Callable[[InputError], None],
        note: Callable[[str], None],
    ) -> None:
        self.given, self.time, self.form, self.maps = given, time, time_format, maps
        self.before, self.names, self.wanted = before, names, wanted
        self.units, self.skip, self.note = units, skip, note
        self.first: tuple[int, dict[str, Any]] | None = None
        self.columns: dict[str, str] | None = None
        self.changes: dict[str, tuple[float, float]] = {}
        self.last = -np.inf
        self.ahead: _Read | None = None  # behind a gap, and not yet believed
        self.begun: datetime | None = None  # by the clock, at 0 s
        self.put: tuple[tuple[float, float], ...] = ()
        self.evenly = Evenly()

    def prepare(self, row: int, cells: dict[str, Any]) -> None:
        """Find the columns that are meant, by the first row's names and whatever its cells hold."""
        if self.columns is not None:
            return
        own = {name: _column((cell, cell)) for name, cell in cells.items()}
        self.time, self.form, self.maps, notes = recalled(
            self.given.table(own, [row, row]), self.time, self.form, self.maps, self.before
        )
        empty = {name: np.full(2, np.nan) for name in cells}
        table = apply_maps(self.given.table(empty, [row, row]), self.maps)
        table = replace(
            table, columns=table.columns | {n: own[n] for n in table.columns if n in own}
        )
        self.time = find_time(table, self.time, "t" in self.maps)
        check_present(table, self.names)
        found = {name: find_column(table, name) for name in self.wanted}
        self.columns = {name: column for name, column in found.items() if column is not None}
        self.changes = {
            name: unit_change(table, name, self.units.get(name, "")) for name in self.columns
        }
        for text in notes:
            self.note(text)

    def samples(self, row: int, cells: dict[str, Any]) -> list[Sample]:
        """The samples that are sure now that this row has come; `InputError` for what no log may
        hold."""
        ahead, found = self.ahead, self.read(row, cells)
        if ahead is not None and self.last < found.sample.t < ahead.sample.t:
            self.ahead = None
            self.first = self.first if np.isfinite(self.last) else None
            self.skip(_ahead_error(ahead, found))
            found = self.read(row, cells)
        self.check_order(found)
        sure = self.rest()
        found = self.read(row, cells) if sure else found
        if found.sample.t - self.last <= GAP * self.evenly.usual:
            return [*sure, self.keep(found)]
        self.ahead, self.first = found, self.first or (row, cells)
        return sure

    def rest(self) -> list[Sample]:
        """The row that waits for the next one."""
        waits, self.ahead = self.ahead, None
        return [] if waits is None else [self.keep(waits)]

    def read(self, row: int, cells: dict[str, Any]) -> _Read:
        assert self.columns is not None
        assert self.time is not None
        first = self.first or (row, cells)
        self.check_run(row, cells, first[1])
        try:
            table = self.table(row, cells, first)
            shown = float(seconds(table, self.time, self.form)[-1])
            begun = clock_of(table, self.time, self.form)
            self.check_clock(row, cells.get(self.time), begun)
            t, change = self.evenly(shown, begun)
            put = self.put if change is None else (*self.put, (change.when, change.by))
            clock = None if begun is None else Clock(begun, put)
            values = {}
            for name, column in self.columns.items():
                factor, offset = self.changes[name]
                values[name] = factor * float(finite_or_empty(table, column)[-1]) + offset
        except InputError as wrong:
            raise _RowError(str(wrong)) from None
        return _Read(row, cells, Sample(t, values, clock), shown, change)

    def keep(self, found: _Read) -> Sample:
        self.first, self.last = self.first or (found.row, found.cells), found.sample.t
        self.evenly.kept(found.shown, found.sample.t)
        if found.change is not None:
            self.put = (*self.put, (found.change.when, found.change.by))
            self.note(change_note(SOURCE, NAME, found.change.before))
        return found.sample

    def table(self, row: int, cells: dict[str, Any], first: tuple[int, dict[str, Any]]) -> LogTable:
        """The first row and this one: timestamps are seconds since the first."""
        assert self.time is not None
        pairs = {name: (first[1][name], cell) for name, cell in cells.items()}
        columns = {name: _column(pair) for name, pair in pairs.items()}
        table = self.given.table(columns, [first[0], row])
        return in_seconds(apply_maps(table, self.maps) if self.maps else table, self.time)

    def check_order(self, found: _Read) -> None:
        t, last = found.sample.t, self.ahead.sample.t if self.ahead else self.last
        if t <= last:
            what = "is the same again" if t == last else "runs backwards"
            raise _RowError(
                f"{SOURCE}, row {found.row}: time {what} ({t:.9g} s after {last:.9g} s); "
                f"{IN_ORDER}."
            )

    def check_clock(self, row: int, cell: Any, begun: datetime | None) -> None:
        """A first row of numbers since 1970 is followed by such alone."""
        if self.first is not None and (begun is None) != (self.begun is None):
            raise InputError(
                f"{SOURCE}, row {row}: the time {str(cell)[:40]} is not of the kind of the first "
                "row's, from the years 2000 to 2100; send every row's time in the same form."
            )
        self.begun = begun

    def check_run(self, row: int, cells: dict[str, Any], first: dict[str, Any]) -> None:
        if cells.get(RUN) != first.get(RUN):
            raise InputError(
                f"{SOURCE}, row {row}: a new run, {cells[RUN]!r}, begins; a stream is one run, so "
                "send each to a call of its own."
            )


def _ahead_error(ahead: _Read, after: _Read) -> InputError:
    return _RowError(
        f"{SOURCE}, row {ahead.row}: time ({ahead.sample.t:.9g} s) is ahead of what comes after it "
        f"(row {after.row}: {after.sample.t:.9g} s); {IN_ORDER}."
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
