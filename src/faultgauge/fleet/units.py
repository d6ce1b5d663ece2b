"""Which logs belong to which unit: a folder with a log or a folder of logs for each, or one table
with a column `unit`."""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from faultgauge.errors import InputError
from faultgauge.telemetry.readers import READERS, is_log, logs_in, read_table, stem
from faultgauge.telemetry.table import LogTable, is_text

__all__ = ["Unit", "units_in"]

UNIT = "unit"
NAME = re.compile(r"\w[\w .+-]{0,99}")
HIDDEN = (".", "~$")  # macOS and Excel put their own beside the logs


@dataclass(frozen=True, eq=False)
class Unit:
    """A unit of a fleet: its logs, a file, a folder of files or a table; and its model file's
    bytes, where it has one."""

    name: str
    source: Path | LogTable
    model: bytes | None = None


def units_in(paths: Sequence[str | Path]) -> list[Unit]:
    """The units whose logs are in `paths`, by name: of one folder, every log and every folder in
    it; of several paths, each; of one file, those that its column `unit` tells apart.

    Raises `InputError` for a file that is no log, two units of one name, a name that no file can
    have, and a single file without a column `unit`.
    """
    given = [Path(each) for each in paths]
    if len(given) == 1 and _is_folder(given[0]):
        entries = sorted(each for each in given[0].iterdir() if not each.name.startswith(HIDDEN))
        if not entries:
            raise InputError(f"{given[0]}: is empty; give a folder with the logs of the units.")
        found = [Unit(stem(each), each) for each in entries]
    elif len(given) == 1:
        found = _by_column(read_table(given[0]))
    else:
        found = [Unit(stem(each), each) for each in given]
    for unit in found:
        if isinstance(unit.source, Path):
            _check_log(unit.source)
    _check_names(found)
    return found


def _is_folder(path: Path) -> bool:
    return os.path.isdir(path) and not (path / "metadata.yaml").is_file()  # that of a ROS 2 bag


def _check_log(path: Path) -> None:
    if _is_folder(path):
        if logs_in(path) == [path]:
            raise InputError(
                f"{path}: holds no log; a folder within that of a fleet is a unit, with its logs "
                "in it, so fill or remove it."
            )
    elif not is_log(path) and not os.path.isdir(path):
        raise InputError(
            f"{path}: is no log, and every file in the folder of a fleet is that of a unit; move "
            f"it elsewhere, or convert it to one of {', '.join(READERS)}."
        )


def _check_names(units: Sequence[Unit]) -> None:
    seen: dict[str, Unit] = {}
    for unit in units:
        if not NAME.fullmatch(unit.name):
            raise InputError(
                f"{_where(unit)}: {unit.name[:100]!r} is no name of a unit, which becomes that of "
                "a file; legal are letters, digits, and . _ + - within it, 100 at most."
            )
        other = seen.setdefault(unit.name.casefold(), unit)
        if other is not unit:
            raise InputError(
                f"{_where(other)} and {_where(unit)} are both of unit {unit.name!r}; rename one, "
                "or put them into a folder of that name if they are of one unit."
            )


def _where(unit: Unit) -> str:
    return str(unit.source) if isinstance(unit.source, Path) else unit.source.source


def _by_column(table: LogTable) -> list[Unit]:
    if UNIT not in table.columns:
        raise InputError(
            f"{table.source}: has no column {UNIT!r} that tells the units of a fleet apart; add "
            "it, or give a folder with a log for each."
        )
    cells = table.columns[UNIT]
    names = np.array([str(each).strip() for each in cells] if is_text(cells) else cells)
    empty = names == "" if is_text(cells) else ~np.isfinite(cells)
    if empty.any():
        raise InputError(
            f"{table.source}, row {table.rows[np.argmax(empty)]}, column {UNIT!r}: is empty; give "
            "every row its unit."
        )
    found = []
    for name in np.unique(names).tolist():
        label = name if isinstance(name, str) else f"{name:.15g}"
        rows = names == name
        columns = {k: v[rows] for k, v in table.columns.items() if k != UNIT}
        part = replace(
            table, source=f"{table.source}:{label}", columns=columns, rows=table.rows[rows]
        )
        found.append(Unit(label, part))
    return found
