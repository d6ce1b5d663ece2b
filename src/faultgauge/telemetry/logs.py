"""From files and tables to logs whose time and runs are known, their columns not yet chosen."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from faultgauge.errors import InputError
from faultgauge.telemetry.clock import Clock
from faultgauge.telemetry.mapping import apply_maps, can_map, find_column, parse_maps
from faultgauge.telemetry.readers import logs_in, read_table, stem
from faultgauge.telemetry.readers.excel import in_workbook
from faultgauge.telemetry.summer_time import change_note, without_summer_time
from faultgauge.telemetry.table import LogTable, is_text
from faultgauge.telemetry.timing import (
    check_form,
    check_increasing,
    clock_of,
    epoch_note,
    find_time,
    in_seconds,
    seconds,
    timestamp,
)
from faultgauge.telemetry.where import keep_rows, met

__all__ = ["RUN", "Before", "LogFile", "Paths", "Source", "open_logs", "recalled"]

RUN = "run"

Source = str | Path | LogTable  # a file, or what is in memory already
Paths = Source | Sequence[Source]


@dataclass(frozen=True)
class Before:
    """What was said of other logs of the same kind: `--time`, `--time-format` and `--map`. A log is
    read so as far as it has those columns and nothing else is said of it."""

    time: str | None = None
    time_format: str | None = None
    maps: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class LogFile:
    """One file after `--map`: its time (s) and the samples of each of its runs; `clocks` are
    those of the runs, where the file tells; `holes` are the rows that stand for those that
    `--where` left out; `notes` say how it was understood, where that is not plain.

    `signals` are the names of all columns except the time, `t` and `run`.
    """

    table: LogTable
    time: str
    t: Float[np.ndarray, "rows"]
    runs: dict[str, Int[np.ndarray, "_"]]
    clocks: dict[str, Clock] = field(default_factory=dict)
    holes: Bool[np.ndarray, "rows"] | None = None
    notes: tuple[str, ...] = ()

    @cached_property
    def signals(self) -> list[str]:
        return [name for name in self.table.columns if name not in (self.time, "t", RUN)]


def open_logs(
    paths: Paths,
    time: str | None,
    maps: Iterable[str],
    where: str | None,
    time_format: str | None = None,
    before: Before | None = None,
) -> list[LogFile]:
    """Read files, apply `maps`, find the time (`time` names its column, `time_format` says how it
    is written), split into runs and keep the rows that meet the condition `where`. What is left
    open may have been said `before`. A folder that is no bag stands for the logs in it.

    A run is called after its file (a table: its source), `stem` or `stem:label` where a column
    `run` labels the rows; a name that is taken gets `#2`. Raises `InputError` for a file that
    cannot be read or comes twice, and for a time or run column that cannot be used.
    """
    given = [paths] if isinstance(paths, str | Path | LogTable) else list(paths)
    sources = [
        each
        for one in given
        for each in ([one] if isinstance(one, LogTable) else logs_in(Path(one)))
    ]
    if not sources:
        raise InputError("No log was given; name at least one file.")
    if time_format is not None:
        check_form(time_format)
    parsed = parse_maps(maps)
    seen: dict[tuple[int, int, str], Path] = {}
    taken: set[str] = set()
    logs = []
    for source in sources:
        if isinstance(source, LogTable):
            name, table = source.source, source
        else:
            name, table = stem(source), read_table(source)
            _check_new(source, seen)
        own_time, own_form, own_maps, note = recalled(table, time, time_format, parsed, before)
        table = apply_maps(table, own_maps)
        log = _log_file(name, table, own_time, own_form, "t" in own_maps, taken)
        log = replace(log, notes=(*table.readings, *note, *log.notes))
        logs.append(log if where is None else _kept(log, where))
        for name, samples in logs[-1].runs.items():
            check_increasing(logs[-1].table, logs[-1].time, logs[-1].t, samples, name)
    return logs


def recalled(
    table: LogTable,
    time: str | None,
    time_format: str | None,
    maps: dict[str, str],
    before: Before | None,
) -> tuple[str | None, str | None, dict[str, str], tuple[str, ...]]:
    """Time column, its format and maps, where they are left open as `before` as far as `table` has
    the columns; and a sentence that says so."""
    if before is None:
        return time, time_format, maps, ()
    said = []
    known = parse_maps(before.maps)
    if time is not None:
        known.pop("t", None)
    new = {n: e for n, e in known.items() if n not in maps and can_map(table, n, e)}
    maps = maps | new
    if time is None and "t" not in maps and before.time and find_column(table, before.time):
        time = before.time
        said.append(f"--time {time}")
    column = find_column(table, time or "t")
    if time_format is None and before.time_format and column is not None:
        cells = table.columns[column]
        if is_text(cells) and timestamp(cells[0], before.time_format) is not None:
            time_format = before.time_format
            said.append(f'--time-format "{time_format}"')
    said += [f'--map "{name}={expression}"' for name, expression in new.items()]
    note = (
        f"{table.source}: read as the logs of the fit, with {' '.join(said)}; give the option "
        "anew to say otherwise."
    )
    return time, time_format, maps, (note,) if said else ()


def _check_new(path: Path, seen: dict[tuple[int, int, str], Path]) -> None:
    file, sheet = in_workbook(path)
    status = os.stat(file)
    identity = (status.st_dev, status.st_ino, sheet)
    if identity in seen:
        raise InputError(f"{path} is the same file as {seen[identity]}; give it once.")
    seen[identity] = path


def _log_file(
    own: str, table: LogTable, time: str | None, form: str | None, mapped: bool, taken: set[str]
) -> LogFile:
    column = find_time(table, time, mapped)
    table = in_seconds(table, column)
    t, clock = seconds(table, column, form).copy(), clock_of(table, column, form)
    notes, runs, clocks = [], {}, {}
    for label, samples in _groups(table).items():
        name = _free_name(f"{own}:{label}" if label else own, taken)
        if len(samples) < 2:
            raise InputError(
                f"{table.source}: run {name!r} has only row {table.rows[samples[0]]}; a run needs "
                "at least two samples, so remove it or correct its label."
            )
        runs[name] = samples
        evenly, changes = without_summer_time(t, samples, clock)
        if clock is not None:
            clocks[name] = Clock(clock, tuple((each.when, each.by) for each in changes))
        t[samples] = evenly
        notes += [change_note(table.source, name, each.before) for each in changes]
    note = epoch_note(table, column)
    notes = tuple(notes if note is None else [*notes, note])
    return LogFile(table, column, t, runs, clocks, notes=notes)


def _kept(log: LogFile, where: str) -> LogFile:
    kept = met(log.table, where, log.time, log.t, log.runs)
    table, rows, runs, holes = keep_rows(log.table, log.time, log.runs, kept)
    if not runs:
        raise InputError(
            f"{table.source}, --where: no run has two rows that meet {where[:80]!r}; widen the "
            "condition, or leave the file out."
        )
    return LogFile(table, log.time, log.t[rows], runs, log.clocks, holes, log.notes)


def _groups(table: LogTable) -> dict[str, Int[np.ndarray, "_"]]:
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
