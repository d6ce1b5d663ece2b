"""From files and tables to logs whose time and runs are known, their columns not yet chosen."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from faultgauge.errors import InputError
from faultgauge.telemetry.mapping import apply_maps, parse_maps
from faultgauge.telemetry.readers import read_table, stem
from faultgauge.telemetry.table import Table, is_text
from faultgauge.telemetry.timing import (
    check_increasing,
    clock_of,
    epoch_note,
    find_time,
    in_seconds,
    seconds,
)
from faultgauge.telemetry.where import keep_rows, met

__all__ = ["LogFile", "Paths", "Source", "open_logs"]

RUN = "run"

Source = str | Path | Table  # a file, or what is in memory already
Paths = Source | Sequence[Source]


@dataclass(frozen=True, eq=False)
class LogFile:
    """One file after `--map`: its time (s) and the samples of each of its runs; `clock` is what
    a clock showed at 0 s, where the file tells; `holes` are the rows that stand for those that
    `--where` left out; `notes` say how its time was understood, where that is not plain.

    `signals` are the names of all columns except the time, `t` and `run`.
    """

    table: Table
    time: str
    t: Float[np.ndarray, "rows"]
    runs: dict[str, Int[np.ndarray, "_"]]
    clock: datetime | None = None
    holes: Bool[np.ndarray, "rows"] | None = None
    notes: tuple[str, ...] = ()

    @cached_property
    def signals(self) -> list[str]:
        return [name for name in self.table.columns if name not in (self.time, "t", RUN)]


def open_logs(
    paths: Paths, time: str | None, maps: Iterable[str], where: str | None
) -> list[LogFile]:
    """Read files, apply `maps`, find the time (`time` names its column), split into runs and keep
    the rows that meet the condition `where`.

    A run is called after its file (a table: its source), `stem` or `stem:label` where a column
    `run` labels the rows; a name that is taken gets `#2`. Raises `InputError` for a file that
    cannot be read or comes twice, and for a time or run column that cannot be used.
    """
    sources = [paths] if isinstance(paths, str | Path | Table) else list(paths)
    if not sources:
        raise InputError("No log was given; name at least one file.")
    parsed = parse_maps(maps)
    seen: dict[tuple[int, int], Path] = {}
    taken: set[str] = set()
    logs = []
    for source in sources:
        if isinstance(source, Table):
            name, table = source.source, source
        else:
            name, table = stem(Path(source)), read_table(Path(source))
            _check_new(Path(source), seen)
        log = _log_file(name, apply_maps(table, parsed), time, "t" in parsed, taken)
        logs.append(log if where is None else _kept(log, where))
        for name, samples in logs[-1].runs.items():
            check_increasing(logs[-1].table, logs[-1].time, logs[-1].t, samples, name)
    return logs


def _check_new(path: Path, seen: dict[tuple[int, int], Path]) -> None:
    status = os.stat(path)
    identity = (status.st_dev, status.st_ino)
    if identity in seen:
        raise InputError(f"{path} is the same file as {seen[identity]}; give it once.")
    seen[identity] = path


def _log_file(own: str, table: Table, time: str | None, mapped: bool, taken: set[str]) -> LogFile:
    column = find_time(table, time, mapped)
    table = in_seconds(table, column)
    t = seconds(table, column)
    runs = {}
    for label, samples in _groups(table).items():
        name = _free_name(f"{own}:{label}" if label else own, taken)
        if len(samples) < 2:
            raise InputError(
                f"{table.source}: run {name!r} has only row {table.rows[samples[0]]}; a run needs "
                "at least two samples, so remove it or correct its label."
            )
        runs[name] = samples
    note = epoch_note(table, column)
    notes = () if note is None else (note,)
    return LogFile(table, column, t, runs, clock_of(table, column), notes=notes)


def _kept(log: LogFile, where: str) -> LogFile:
    kept = met(log.table, where, log.time, log.t, log.runs)
    table, rows, runs, holes = keep_rows(log.table, log.time, log.runs, kept)
    if not runs:
        raise InputError(
            f"{table.source}, --where: no run has two rows that meet {where[:80]!r}; widen the "
            "condition, or leave the file out."
        )
    return LogFile(table, log.time, log.t[rows], runs, log.clock, holes, log.notes)


def _groups(table: Table) -> dict[str, Int[np.ndarray, "_"]]:
    """Samples of each run label, labels in order of appearance; one unlabelled run if none."""
    if RUN not in table.columns:
        return {"": np.arange(len(table.rows))}
    cells = table.columns[RUN]
    if is_text(cells):
        labels = np.array([cell.strip() for cell in cells], dtype=object)
        wrong = labels == ""
    else:
        labels, wrong = cells, ~np.isfinite(cells)
    if wrong.any():
        raise InputError(
            f"{table.source}, row {table.rows[np.argmax(wrong)]}, column {RUN!r}: the row has no "
            "run label; give every row one."
        )
    distinct, first, group = np.unique(labels, return_index=True, return_inverse=True)
    by_group = np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1])
    names = [_label(label) for label in distinct.tolist()]
    return {names[k]: by_group[k] for k in np.argsort(first)}


def _label(label: str | float) -> str:
    if isinstance(label, str):
        return label
    return str(int(label)) if label == int(label) else repr(label)


def _free_name(name: str, taken: set[str]) -> str:
    free, count = name, 1
    while free in taken:
        count += 1
        free = f"{name}#{count}"
    taken.add(free)
    return free
