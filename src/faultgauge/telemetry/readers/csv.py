"""Comma-separated text, plain or gzip-compressed: a header row of names, then one row a sample."""

import csv
import gzip
import re
import zlib
from collections import Counter
from pathlib import Path

import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.files import read_within, take
from faultgauge.telemetry.table import Table, check_width, float_cells

__all__ = ["check_separator", "header", "read_csv"]

MOST_TEXT = 1_000_000_000  # bytes; a table of them takes five times as much memory
ADVICE = "more than is read; give it in parts, with fewer columns, or as Parquet"
OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}


def read_csv(path: Path) -> Table:
    """Read a `.csv` or `.csv.gz` file (UTF-8, comma, decimal point, header in row 1).

    An empty cell, and one that says `nan`, is NaN. Blank rows are passed over. Raises
    `InputError` for anything that is not such a table, naming the row.
    """
    lines = _text(path).split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise InputError(f"{path} is empty; a log needs a header row and at least two samples.")
    check_separator(path, lines[0])
    names, header_lines = header(path, lines)
    body = lines[header_lines:]
    values = _clean_numbers(body, len(names))
    if values is not None:
        columns = dict(zip(names, np.ascontiguousarray(values.T), strict=True))
        rows = np.arange(len(body)) + header_lines + 1
    else:
        columns, rows = _cell_by_cell(path, names, body, header_lines)
    if len(rows) < 2:
        found = "only a header row" if len(rows) == 0 else "only one row of samples"
        raise InputError(f"{path} has {found}; a log needs at least two samples.")
    return Table(str(path), columns, rows)


def _text(path: Path) -> str:
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
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(f"{path} is UTF-16 text; save it as UTF-8.")
    if b"\0" in data:
        raise InputError(f"{path} is binary, not CSV text; export the log as CSV.")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as failure:
        row = data.count(b"\n", 0, failure.start) + 1
        raise InputError(f"{path}, row {row}: the text is not UTF-8; save it as UTF-8.") from None
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def check_separator(path: Path, line: str) -> None:
    unquoted = Counter(re.sub(r'"[^"]*"', "", line))
    for separator, plural in OTHER_SEPARATORS.items():
        if unquoted[separator] > unquoted[","]:
            raise InputError(
                f"{path}, row 1: the cells of {line[:60]!r} are separated by {plural}; save the "
                "file with commas between cells and points in decimal numbers."
            )


def header(path: Path, lines: list[str]) -> tuple[list[str], int]:
    """Column names, and how many lines of the file they take."""
    reader = csv.reader(lines, strict=True)
    try:
        names = [name.strip() for name in next(reader)]
    except csv.Error as failure:
        raise InputError(f"{path}, row 1: {failure}; check the quotes in the header.") from None
    if not any(names):
        raise InputError(f"{path}, row 1 is empty; the first row must name the columns.")
    if "" in names:
        raise InputError(
            f"{path}, row 1: cell {names.index('') + 1} of {len(names)} is empty; every column "
            "needs a name (a comma at either end of the row makes an empty one, as does the index "
            "column of pandas, which index=False leaves out)."
        )
    check_width(path, len(names))
    name, count = Counter(names).most_common(1)[0]
    if count > 1:
        raise InputError(
            f"{path}, row 1: {count} columns are called {name!r}; give every column its own name."
        )
    if float_cells(names) is not None:
        raise InputError(
            f"{path}, row 1: {lines[0][:60]!r} holds numbers where column names belong; add a "
            "header row."
        )
    return names, reader.line_num


def _clean_numbers(body: list[str], width: int) -> Float[np.ndarray, "rows columns"] | None:
    """The common case, in C: every cell is a number or empty. None if it is not so."""
    if not body:
        return None
    try:
        values = np.loadtxt(_filled(body), delimiter=",", comments=None, ndmin=2)
    except ValueError:
        return None
    return values if values.shape == (len(body), width) else None


def _filled(body: list[str]) -> list[str]:
    """`body` with nan in its empty cells, which `np.loadtxt` does not take."""
    text = "\n" + "\n".join(body) + "\n"
    if all(edge not in text for edge in (",,", "\n,", ",\n")):
        return body
    text = text.replace(",,", ",nan,").replace(",,", ",nan,")  # twice: in ",,," they overlap
    return text.replace("\n,", "\nnan,").replace(",\n", ",nan\n")[1:-1].split("\n")


def _cell_by_cell(
    path: Path, names: list[str], body: list[str], header_lines: int
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Columns and file rows where some cell is empty, quoted, text, or too many."""
    reader = csv.reader(body, strict=True)
    try:
        numbered = [(reader.line_num, cells) for cells in reader if cells]
    except csv.Error as failure:
        row = header_lines + reader.line_num
        raise InputError(f"{path}, row {row}: {failure}; check the quotes there.") from None
    if len(names) > 1:
        numbered = [(row, cells) for row, cells in numbered if len(cells) > 1 or cells[0].strip()]
    for row, cells in numbered:
        if len(cells) != len(names):
            raise InputError(
                f"{path}, row {header_lines + row}: {len(cells)} cells where the header has "
                f"{len(names)}; complete or remove the row."
            )
    rows = np.array([header_lines + row for row, _ in numbered], dtype=np.int64)
    by_column = zip(*(cells for _, cells in numbered), strict=True)
    columns = {name: _column(cells) for name, cells in zip(names, by_column, strict=False)}
    return columns, rows


def _column(cells: tuple[str, ...]) -> np.ndarray:
    numbers = float_cells(cells)
    return numbers if numbers is not None else np.array(cells, dtype=object)
