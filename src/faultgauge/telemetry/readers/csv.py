"""Text in columns, plain or gzip-compressed: a header row of names, then one row a sample."""

import csv
import gzip
import zlib
from collections import Counter
from pathlib import Path

import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.files import read_within, take
from faultgauge.telemetry.headers import unit_row, with_units
from faultgauge.telemetry.readers.dialect import Dialect, find_dialect, named_separator
from faultgauge.telemetry.table import LogTable, check_width, float_cells

__all__ = ["HEAD", "WINDOWS", "header", "read_csv"]

MOST_TEXT = 1_000_000_000  # bytes; a table of them takes five times as much memory
ADVICE = "more than is read; give it in parts, with fewer columns, or as Parquet"
HEAD = 2  # lines of names and units, in which a degree sign may be from Windows
WINDOWS = "the header is not UTF-8 and is read as Windows-1252"
UTF_16 = (b"\xff\xfe", b"\xfe\xff")


def read_csv(path: Path) -> LogTable:
    """Read a text file: a header row, a row of units where there is one, and a row per sample.

    Cells are separated by commas, semicolons, tabs or bars, whichever the header has most of;
    decimals may be written with a comma where cells are not separated by it. An empty cell, and one
    that says `nan`, is NaN. Blank rows are passed over. Raises `InputError` for anything that is
    not such a table, naming the row.
    """
    text, readings = _text(path)
    lines = text.split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise InputError(f"{path} is empty; a log needs a header row and at least two samples.")
    separator = named_separator(lines[0])
    above = 1 if separator else 0
    dialect = find_dialect("".join(lines[above : above + 1]), lines[above + 1 :], separator)
    names, taken = header(path, lines[above:], dialect.separator, above)
    above += taken
    units = _units(lines[above : above + 1], len(names), dialect.separator)
    above += bool(units)
    body = lines[above:]
    values = _clean_numbers(body, len(names), dialect)
    if values is not None:
        columns = dict(zip(names, np.ascontiguousarray(values.T), strict=True))
        rows = np.arange(len(body)) + above + 1
    else:
        columns, rows = _cell_by_cell(path, names, body, above, dialect)
    if len(rows) < 2:
        found = "only a header row" if len(rows) == 0 else "only one row of samples"
        raise InputError(f"{path} has {found}; a log needs at least two samples.")
    given = {name: unit for name, unit in zip(names, units, strict=False) if unit}
    readings = (*dialect.note(path), *readings)
    return with_units(LogTable(str(path), columns, rows, given, readings=readings))


def _units(lines: list[str], width: int, separator: str) -> list[str]:
    """The units in a row beneath the header; none where it is no such row."""
    try:
        cells = next(csv.reader(lines, delimiter=separator, strict=True), [])
    except csv.Error:  # told where rows are read
        return []
    return (unit_row(cells) or []) if len(cells) == width else []


def _text(path: Path) -> tuple[str, tuple[str, ...]]:
    """The text of a file, and a sentence where it is in no plain encoding."""
    readings = ()
    if path.name.lower().endswith(".gz"):
        try:
            with gzip.open(path) as file:
                data = take(file.read, MOST_TEXT, path, f"when it is unpacked, {ADVICE}")
        except (gzip.BadGzipFile, EOFError, zlib.error) as failure:
            raise InputError(
                f"{path} is not gzip or is damaged ({failure}); copy or compress it again."
            ) from None
    else:
        data = read_within(path, MOST_TEXT, ADVICE)
    if data.startswith(b"\x1f\x8b"):
        raise InputError(f"{path} is gzip, not text; rename it to {path}.gz.")
    wide = data.startswith(UTF_16)  # "Unicode text" of Excel
    if b"\0" in data and not wide:
        raise InputError(f"{path} is binary, not CSV text; export the log as CSV.")
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as failure:
        row = data.count(b"\n", 0, failure.start) + 1
        if wide or not b"".join(data.split(b"\n")[HEAD:]).isascii():
            raise InputError(
                f"{path}, row {row}: the text is not UTF-8; save it as UTF-8."
            ) from None
        text = data.decode("cp1252", errors="replace")
        readings = (f"{path}: {WINDOWS}.",)
    text = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
    return text, readings


def header(
    path: Path, lines: list[str], separator: str = ",", above: int = 0
) -> tuple[list[str], int]:
    """Column names, and how many lines of the file they take; it has `above` others before."""
    reader = csv.reader(lines, delimiter=separator, strict=True)
    row = above + 1
    try:
        names = [name.strip() for name in next(reader)]
    except csv.Error as failure:
        raise InputError(f"{path}, row {row}: {failure}; check the quotes in the header.") from None
    if not any(names):
        raise InputError(f"{path}, row {row} is empty; the first row must name the columns.")
    if "" in names:
        raise InputError(
            f"{path}, row {row}: cell {names.index('') + 1} of {len(names)} is empty; every column "
            "needs a name (a separator at either end of the row makes an empty one, as does the "
            "index column of pandas, which index=False leaves out)."
        )
    check_width(path, len(names))
    name, count = Counter(names).most_common(1)[0]
    if count > 1:
        raise InputError(
            f"{path}, row {row}: {count} columns are called {name!r}; give every column its own "
            "name."
        )
    if float_cells(names) is not None:
        raise InputError(
            f"{path}, row {row}: {lines[0][:60]!r} holds numbers where column names belong; add a "
            "header row."
        )
    return names, reader.line_num


def _clean_numbers(
    body: list[str], width: int, dialect: Dialect
) -> Float[np.ndarray, "rows columns"] | None:
    """The common case, in C: every cell is a number or empty. None if it is not so."""
    if not body:
        return None
    if dialect.comma:
        if any("." in line for line in body):  # which has to be looked at, cell by cell
            return None
        body = [line.replace(",", ".") for line in body]
    try:
        filled = _filled(body, dialect.separator)
        values = np.loadtxt(filled, delimiter=dialect.separator, comments=None, ndmin=2)
    except ValueError:
        return None
    return values if values.shape == (len(body), width) else None


def _filled(body: list[str], edge: str) -> list[str]:
    """`body` with nan in its empty cells, which `np.loadtxt` does not take."""
    text = "\n" + "\n".join(body) + "\n"
    if all(empty not in text for empty in (edge + edge, f"\n{edge}", f"{edge}\n")):
        return body
    for _ in range(2):  # twice: in ",,," they overlap
        text = text.replace(edge + edge, f"{edge}nan{edge}")
    return (
        text.replace(f"\n{edge}", f"\nnan{edge}")
        .replace(f"{edge}\n", f"{edge}nan\n")[1:-1]
        .split("\n")
    )


def _cell_by_cell(
    path: Path, names: list[str], body: list[str], above: int, dialect: Dialect
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Columns and file rows where some cell is empty, quoted, text, or too many."""
    reader = csv.reader(body, delimiter=dialect.separator, strict=True)
    try:
        numbered = [(above + reader.line_num, cells) for cells in reader if cells]
    except csv.Error as failure:
        row = above + reader.line_num
        raise InputError(f"{path}, row {row}: {failure}; check the quotes there.") from None
    if len(names) > 1:
        numbered = [(row, cells) for row, cells in numbered if len(cells) > 1 or cells[0].strip()]
    for row, cells in numbered:
        if len(cells) != len(names):
            raise InputError(
                f"{path}, row {row}: {len(cells)} cells where the header has "
                f"{len(names)}; complete or remove the row."
            )
    rows = np.array([row for row, _ in numbered], dtype=np.int64)
    by_column = zip(*(cells for _, cells in numbered), strict=True)
    columns = {
        name: dialect.column(path, name, cells, rows.tolist())
        for name, cells in zip(names, by_column, strict=False)
    }
    return columns, rows
