"""Spreadsheets (`.xlsx`, `.xlsm`, `.xls`, `.ods`), by calamine: one sheet is one log."""

import re
from collections import Counter
from collections.abc import Sequence
from datetime import date, time, timedelta
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Shaped

from faultgauge.errors import InputError
from faultgauge.telemetry.headers import is_stamp, unit_row, with_units
from faultgauge.telemetry.readers.cells import from_list
from faultgauge.telemetry.readers.dialect import Dialect
from faultgauge.telemetry.readers.foreign import reading
from faultgauge.telemetry.readers.workbook_size import check_workbook
from faultgauge.telemetry.table import LogTable, check_width, is_text

__all__ = ["EXCEL_FILES", "in_workbook", "read_excel"]

EXCEL_FILES = (".xlsx", ".xlsm", ".xls", ".ods")
WITH_SHEET = re.compile(rf"(.*(?:{'|'.join(map(re.escape, EXCEL_FILES))}))#(.+)", re.I | re.S)
FIRST_ROWS = 100  # among which the header is

Row = list[Any]  # numbers, text, dates and times; "" for an empty cell
Range = tuple[tuple[int, int], tuple[int, int]]  # (row, column) of the first and the last cell


class Found(NamedTuple):
    """A table in a sheet: names by column, units by name, the row that it begins in, and the
    letters of columns without a name."""

    names: dict[int, str]
    units: dict[str, str]
    start: int
    nameless: list[str]


def in_workbook(path: Path) -> tuple[Path, str]:
    """The file of `log.xlsx#SHEET`, and the sheet; "" where none is named."""
    match = WITH_SHEET.fullmatch(str(path))
    return (Path(match[1]), match[2]) if match and not path.exists() else (path, "")


def read_excel(path: Path) -> LogTable:
    """Read the sheet that `path` names behind a `#`, else the first that holds a table.

    A table is rows of numbers and times beneath a header of text: one row of names, or several,
    merged where one spans columns (`pump` over `flow` and `speed` makes `pump flow`), and a row of
    units where there is one. Titles and remarks above and beside it are passed over. Raises
    `InputError` for a file that is damaged or unpacks to too much, a sheet that is not there or
    holds no table, and two columns of one name.
    """
    from python_calamine import CalamineWorkbook

    file, wanted = in_workbook(path)
    with reading(file, "Excel"):
        check_workbook(file)
        workbook = CalamineWorkbook.from_path(str(file))
        names = workbook.sheet_names
        sheets = [wanted] if wanted in names else [] if wanted else names
        for sheet in sheets:
            page = workbook.get_sheet_by_name(sheet)
            rows, merged = page.to_python(skip_empty_area=False), page.merged_cell_ranges or []
            found = _find(path, rows, merged)
            if found is not None:
                return _table(path, sheet, names, rows, found)
    listed = ", ".join(map(repr, names))
    if wanted and not sheets:
        raise InputError(f"{file} has no sheet {wanted!r}; it has {listed}.")
    raise InputError(
        f"{path}: no table in {'sheet' if len(sheets) == 1 else 'sheets'} "
        f"{', '.join(map(repr, sheets))}; a log needs a row of column names and, right beneath it, "
        "at least two rows of numbers."
    )


def _find(path: Path, rows: list[Row], merged: Sequence[Range]) -> Found | None:
    top = [list(row) for row in rows[:FIRST_ROWS]]
    for (row, column), (last_row, last_column) in merged:
        for k in range(row, min(last_row + 1, len(top))):
            width = min(last_column + 1, len(top[k]))
            top[k][column:width] = [top[row][column]] * (width - column)
    for k in range(len(top) - 2):
        if _is_words(top[k]) and _is_data(top[k + 1]) and any(map(_is_number, top[k + 2])):
            header = [top[k]]
            while len(header) <= k and _is_words(top[k - len(header)]):
                header.insert(0, top[k - len(header)])
            return _header(path, header, rows, k + 1)
    return None


def _is_number(cell: Any) -> bool:
    """Whether a cell holds a number or a time."""
    return is_stamp(cell) if isinstance(cell, str) else True


def _is_words(row: Row) -> bool:
    there = [cell for cell in row if cell != ""]
    return bool(there) and not any(map(_is_number, there))


def _is_data(row: Row) -> bool:
    there = [cell for cell in row if cell != ""]
    return 2 * sum(map(_is_number, there)) > len(there)


def _header(path: Path, header: list[Row], rows: list[Row], start: int) -> Found:
    header = [[cell.strip() for cell in row] for row in header]
    units = unit_row(header[-1]) if len(header) > 1 else None
    if units is not None:
        header = header[:-1]
    header = [row for row in header[:-1] if not _is_title(row)] + header[-1:]
    names, nameless = {}, []
    for j in range(len(rows[start])):
        words = [word for word, _ in groupby(row[j] for row in header if row[j])]
        if words:
            names[j] = " ".join(words)
        elif any(row[j] != "" for row in rows[start:]):
            nameless.append(_letters(j))
    check_width(path, len(names))
    name, count = Counter(names.values()).most_common(1)[0]
    if count > 1:
        raise InputError(
            f"{path}, row {start}: {count} columns are called {name!r}; give every column its own "
            "name."
        )
    given = {names[j]: unit for j, unit in enumerate(units or []) if unit and j in names}
    return Found(names, given, start, nameless)


def _is_title(row: Row) -> bool:
    """One text that begins at the left; what spans some columns only is a part of their names."""
    return len(set(row) - {""}) == 1 and row[0] != ""


def _letters(column: int) -> str:
    text = ""
    column += 1
    while column:
        column, letter = divmod(column - 1, 26)
        text = chr(ord("A") + letter) + text
    return text


def _table(path: Path, sheet: str, sheets: list[str], rows: list[Row], found: Found) -> LogTable:
    numbered = [(k + 1, row) for k, row in enumerate(rows) if k >= found.start]
    numbered = [(k, row) for k, row in numbered if any(row[j] != "" for j in found.names)]
    at = [k for k, _ in numbered]
    columns, left_out = {}, [f"column {each}" for each in found.nameless]
    for j, name in found.names.items():
        cells = _column(path, name, [row[j] for _, row in numbered], at)
        if cells is None:
            left_out.append(name)
        else:
            columns[name] = cells
    names = ", ".join(left_out)
    notes = (f"{path}: without a name, or neither numbers nor text, and left out: {names}.",)
    others = ", ".join(repr(each) for each in sheets if each != sheet)
    readings = (
        f"{path}: sheet {sheet!r} is read, the first with a table, and not {others}; name one as "
        f"{path.name}#SHEET.",
    )
    told = others and not in_workbook(path)[1]
    return with_units(
        LogTable(
            str(path),
            columns,
            np.array(at),
            {name: unit for name, unit in found.units.items() if name in columns},
            notes if left_out else (),
            readings=readings if told else (),
        )
    )


def _column(
    path: Path, name: str, cells: list[Any], rows: list[int]
) -> Shaped[np.ndarray, "rows"] | None:
    found = from_list([_plain(cell) for cell in cells])
    if found is None or not is_text(found):
        return found
    return Dialect(comma=True).column(path, name, list(found), rows)  # numbers kept as text


def _plain(cell: Any) -> Any:
    """An empty cell is None; a time of the day is in seconds since midnight."""
    if isinstance(cell, time):
        return (
            timedelta(hours=cell.hour, minutes=cell.minute, seconds=cell.second)
            + timedelta(microseconds=cell.microsecond)
        ).total_seconds()
    if isinstance(cell, date) or cell != "":
        return cell
    return None
