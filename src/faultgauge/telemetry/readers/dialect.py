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

__all__ = ["SEPARATORS", "Dialect", "find_dialect", "separator_of"]

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
NUMBER = r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*"  # with a decimal comma
COMMA = re.compile(NUMBER)
POINT = re.compile(r"\s*[+-]?[\d.,]*\.[\d.,]*(?:[eE][+-]?\d+)?\s*")


def separator_of(line: str) -> str:
    """What separates the cells of a header `line`: a comma, unless there is more of another."""
    unquoted = Counter(re.sub(r'"[^"]*"', "", line))
    return max(SEPARATORS, key=lambda each: unquoted[each])  # the first of those that tie


@dataclass(frozen=True)
class Dialect:
    """The separator, and whether decimals have a comma."""

    separator: str = ","
    comma: bool = False

    def note(self, path: Path) -> tuple[str, ...]:
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


def _with_points(path: Path, name: str, cells: Sequence[str], rows: Sequence[int]) -> list[str]:
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
