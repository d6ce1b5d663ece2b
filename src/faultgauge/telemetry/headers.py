"""Units where people write them: in the header, as `T [degC]`, `p (bar)` or `U/V`, or in a row of
their own beneath it.

Only what can be read as a unit is taken for one: `phase (A)` beside `phase (B)` are names.
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

from faultgauge.plants.dimensions import read_unit
from faultgauge.telemetry.table import LogTable, float_cells

__all__ = ["Headers", "is_stamp", "split_headers", "unit_row", "with_units"]

BRACKETS = (
    re.compile(r"(.*\S)\s*\[([^][]+)\]"),
    re.compile(r"(.*\S)\s*\(((?:[^()]|\([^()]*\))+)\)"),  # W/(m*K), too
)
SLASH = re.compile(r"([^/]*[^/\s])\s*/\s*([^/].*)")
NO_UNIT = ("-", "--", "none")
STAMP = re.compile(r"\d+[-./:]\d+")


class Headers(NamedTuple):
    """The names of columns without their units; the units, and the whole headers, by name."""

    names: list[str]
    units: dict[str, str]
    written: dict[str, str]


def split_headers(headers: Sequence[str]) -> Headers:
    """Names and units of `headers`. Where names would be the same without their units, they keep
    them; and what stands behind a slash is a unit in all headers that have one, or in none."""
    slashes = [SLASH.fullmatch(each) for each in headers if "/" in _bare(each)]
    by_slash = all(match is not None and _unit(match[2]) for match in slashes)
    parts = [_parts(each, by_slash) for each in headers]
    alike: dict[str, list[str | None]] = defaultdict(list)
    for name, unit in parts:
        alike[name].append(unit)
    found = Headers([], {}, {})
    for header, (name, unit) in zip(headers, parts, strict=True):
        short = len(alike[name]) == 1
        taken = name if short and unit is not None else header
        found.names.append(taken)
        if unit is not None and (short or _of_one_kind(alike[name])):
            found.units[taken] = unit
        if taken != header:
            found.written[taken] = header
    return found


def _parts(header: str, by_slash: bool) -> tuple[str, str | None]:
    """Name and unit; a header that only looks like one with a unit stands under its name, too, so
    that `U (A)` beside `U (B)` is no current."""
    for form in (*BRACKETS, *([SLASH] if by_slash else [])):
        match = form.fullmatch(header)
        if match is not None:
            unit = _unit(match[2])
            return (match[1], unit) if unit or form is not SLASH else (header, None)
    return header, None


def _bare(header: str) -> str:
    """`header` without what stands in brackets at its end."""
    match = next((m for form in BRACKETS if (m := form.fullmatch(header))), None)
    return match[1] if match else header


def _of_one_kind(units: Iterable[str | None]) -> bool:
    kinds = {None if unit is None else read_unit(unit).dimension for unit in units}
    return len(kinds) == 1 and None not in kinds


def _unit(text: str) -> str | None:
    """`text` as a unit; "1" where it says that there is none; None where it is no unit."""
    text = text.strip()
    if text.lower() in NO_UNIT:
        return "1"
    if not re.search(r"[^\W\d_]|[%°]", text):  # x [1] and x [2] are names
        return None
    try:
        read_unit(text)
    except ValueError:
        return None
    return text


def with_units(table: LogTable) -> LogTable:
    """`table` with the units that stand in its headers; those that the file gives elsewhere count
    first. A column is found by its whole header, too."""
    found = split_headers(list(table.columns))
    now = dict(zip(table.columns, found.names, strict=True))
    given = {now[name]: unit for name, unit in table.units.items()}
    return replace(
        table,
        columns={now[name]: cells for name, cells in table.columns.items()},
        units=found.units | given,
        written=found.written,
    )


def is_stamp(cell: str) -> bool:
    """Whether text looks like a date or a time of the day."""
    return STAMP.search(cell) is not None


def unit_row(cells: Sequence[str]) -> list[str] | None:
    """The units in a row beneath the header, "" where there is none; None where it is none.

    No cell of it is a number or a time, and more can be read as units, or stand in brackets, than
    cannot: those are kept as labels.
    """
    cells = [cell.strip() for cell in cells]
    there = [cell for cell in cells if cell]
    if not there or any(float_cells([c]) is not None or is_stamp(c) for c in there):
        return None
    bare = [re.sub(r"^[\[(](.*)[\])]$", r"\1", cell) for cell in cells]
    sure = sum(
        _unit(unit) is not None or unit != cell for unit, cell in zip(bare, cells, strict=True)
    )
    return [_unit(unit) or unit for unit in bare] if 2 * sure > len(there) else None
