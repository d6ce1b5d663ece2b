"""How a text file separates its cells and writes its decimals."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Shaped

from faultgauge.errors import InputError
from faultgauge.telemetry.table import float_cells

__all__ = ["SEPARATORS", "Decimals", "Dialect", "find_dialect", "named_separator", "separator_of"]

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
NAMED = re.compile(r'"?sep=(.)"?')  # a first line that Excel writes and heeds
NUMBER = r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*"  # with a decimal comma
COMMA = re.compile(NUMBER)
POINT = re.compile(r"\s*[+-]?[\d.,]*\.[\d.,]*(?:[eE][+-]?\d+)?\s*")


def named_separator(line: str) -> str | None:
    """What a first `line` says that separates cells; None where it is no such line."""
    found = NAMED.fullmatch(line)
    return found and found[1]


def separator_of(line: str) -> str:
    """What separates the cells of a header `line`: a comma, unless there is more of another."""
    unquoted = Counter(re.sub(r'"[^"]*"', "", line))
    return max(SEPARATORS, key=lambda each: unquoted[each])  # the first of those that tie


@dataclass(frozen=True)
class Dialect:
    """The separator, and whether decimals have a comma."""

    separator: str = ","
    comma: bool = False

    def note(self, path: Path | str) -> tuple[str, ...]:
        """A sentence where it is not the plain one."""
        if self.separator == ",":
            return ()
        decimals = "commas" if self.comma else "points"
        return (
            f"{path}: cells are separated by {SEPARATORS[self.separator]}, numbers have decimal "
            f"{decimals}.",
        )

    def column(
        self, path: Path, name: str, cells: Sequence[str], rows: Sequence[int]
    ) -> Shaped[np.ndarray, "rows"]:
        """A column: numbers, NaN where empty, or text. Raises `InputError` where a file of decimal
        commas has points in numbers, which may separate thousands."""
        if self.comma:
            cells = _with_points(path, name, cells, rows)
        numbers = float_cells(cells)
        return numbers if numbers is not None else np.array(cells, dtype=object)


class Decimals:
    """How the columns of a table that comes row by row write their decimals: as their first number
    that has any does."""

    def __init__(self, separator: str) -> None:
        self.separator = separator
        self.first: dict[str, tuple[str, int]] = {}  # by column: that number, and its row

    @property
    def dialect(self) -> Dialect | None:
        """None where no number with decimals has come."""
        if self.separator == ",":
            return Dialect()
        comma = any(COMMA.fullmatch(cell) for cell, _ in self.first.values())
        return Dialect(self.separator, comma) if self.first else None

    def plain(self, source: str, row: int, cells: dict[str, str]) -> dict[str, str]:
        """`cells` with decimal points. Raises `InputError` where a number has a point in a column
        of decimal commas."""
        if self.separator == ",":
            return cells
        found, first = {}, dict(self.first)
        for name, cell in cells.items():
            if COMMA.fullmatch(cell) or POINT.fullmatch(cell):
                first.setdefault(name, (cell, row))
                before, at = first[name]
                cell = _with_points(source, name, [before, cell], [at, row])[-1]
            found[name] = cell
        self.first = first
        return found


def _with_points(
    path: Path | str, name: str, cells: Sequence[str], rows: Sequence[int]
) -> list[str]:
    commas = [COMMA.fullmatch(cell) is not None for cell in cells]
    odd = next((k for k, cell in enumerate(cells) if POINT.fullmatch(cell)), None)
    if any(commas) and odd is not None:
        raise InputError(
            f"{path}, row {rows[odd]}, column {name!r}: {cells[odd].strip()!r} has a point where "
            "the file's numbers have decimal commas; write all numbers one way, without marks "
            "between thousands."
        )
    found = zip(cells, commas, strict=True)
    return [cell.replace(",", ".") if comma else cell for cell, comma in found]


def find_dialect(first: str, body: Sequence[str], separator: str | None = None) -> Dialect:
    """The dialect of a file with the header `first`; `separator` where the file names it."""
    separator = separator or separator_of(first)
    if separator == ",":
        return Dialect()
    edge = re.escape(separator)
    number = re.compile(rf'(?:^|{edge})"?{NUMBER}"?(?:{edge}|$)')
    return Dialect(separator, any("," in line and number.search(line) for line in body))
