"""What a workbook holds, before it is opened: a zip of XML, in which one cell far out makes a table
of all that lie between."""

import re
import zipfile
from pathlib import Path

from faultgauge.files import take
from faultgauge.telemetry.readers.unpacked import Room

__all__ = ["check_workbook"]

MOST_TEXT = 1_000_000_000  # bytes of XML
ADVICE = "when it is unpacked, more than is read; give it in parts, or with fewer columns"
SHEET = b"sheetData"
CELL = 32  # bytes of one in memory
ROWS = re.compile(rb"<(?:\w+:)?row\b")
CELLS = re.compile(rb"<(?:\w+:)?c\b")
ROW = re.compile(ROWS.pattern + rb"[^>]*?\br\s*=\s*[\"'](\d{1,9})[\"']")
COLUMN = re.compile(CELLS.pattern + rb"[^>]*?\br\s*=\s*[\"']([A-Za-z]{1,5})\d")


def check_workbook(path: Path) -> None:
    """Raises `InputError` where a part of a workbook, or the table that the cells of a sheet of an
    `.xlsx` lie in, is too large. What is no zip, as an `.xls`, is not packed."""
    if not zipfile.is_zipfile(path):
        return
    with zipfile.ZipFile(path) as book:
        for part in book.infolist():
            with book.open(part) as file:
                text = take(file.read, MOST_TEXT, path, ADVICE)
            if SHEET in text:
                Room(path).take(CELL * _cells(text))


def _cells(text: bytes) -> int:
    """How many cells the table of a sheet has. One that does not say where it is stands behind the
    one before."""
    rows = ROWS.split(text)[1:]
    last = max(map(int, ROW.findall(text)), default=0)
    named = max(map(_number, set(COLUMN.findall(text))), default=0)
    counted = max((len(CELLS.findall(row)) for row in rows), default=0)
    return max(last, len(rows)) * max(named, counted)


def _number(letters: bytes) -> int:
    """Of a column: A is 1, AA is 27."""
    found = 0
    for letter in letters.upper():
        found = 26 * found + letter - ord("A") + 1
    return found
