"""Reading telemetry: files in, runs of checked signals out."""

import difflib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.plants.dimensions import change_of, conversion
from faultgauge.telemetry.logs import Before, LogFile, Paths, open_logs
from faultgauge.telemetry.mapping import alias, find_column, parse_maps
from faultgauge.telemetry.rates import align
from faultgauge.telemetry.resampling import check_rate, resampled, same_rate
from faultgauge.telemetry.runs import Run
from faultgauge.telemetry.table import LARGEST, LogTable, is_text, text_error

__all__ = [
    "at_rate",
    "check_present",
    "check_same_units",
    "finite_or_empty",
    "read_telemetry",
    "unit_change",
]


def read_telemetry(
    paths: Paths,
    *,
    time: str | None = None,
    maps: Iterable[str] = (),
    names: Sequence[str] | None = None,
    optional: Sequence[str] | None = None,
    held: Collection[str] = (),
    where: str | None = None,
    units: Mapping[str, str] | None = None,
    resample: float | None = None,
    averaged: Collection[str] = (),
    slower: Literal["refuse", "keep"] = "refuse",
    time_format: str | None = None,
    before: Before | None = None,
) -> list[Run]:
    """Read one log or several into runs.

    **Arguments**

    - `paths`: one path (or `LogTable`) or several; several files are several runs, and so are the
      labels of a column `run` (rows of one label need not be together).
    - `time`: the time column, `t` by default; seconds, or timestamps (ISO 8601, day.month.year, or
      as `time_format` has them, a format of `strptime`), which become seconds since the first
      sample of their file. Another unit that the file gives is converted.
    - `maps`: `NAME=EXPRESSION` texts over the file's columns.
    - `names`: columns that every run must have, after mapping, in the units of the log.
    - `optional`: columns that are taken where they are. With neither, all number columns are.
    - `held`: columns that keep their value between samples, as inputs do. It matters where
      columns are sampled at different rates: they are brought onto common rows (`align`).
    - `where`: a condition over the file's columns; only rows that meet it are kept.
    - `units`: those that columns are brought to where the file gives them one: readings, with
      the zero of degC and degF. What a map computes has none; what it only renames keeps its own.
    - `resample`: a rate [Hz] that runs are brought to, anti-aliased (`resampled`): `held` columns
      and those `averaged`, which jump with them, by their means.
    - `slower`: what becomes of a run that has a lower rate than that. A fitted model's own rate
      asks for `resample=model.resample, slower="keep"`.
    - `before`: what was said of other such logs, where it is not said of these.

    Raises `InputError` that names file, column and row for a file that cannot be read, a missing
    required column, text or Inf in a column that is taken, an all-empty one, and a time that is
    missing, empty, repeated or reversed, a condition that no row meets, and a unit of something
    else, or other than in another of the files; and for a rate that cannot be had.
    """
    if resample is not None:
        check_rate(resample)
    maps, wanted, runs = list(maps), units or {}, []
    for log in open_logs(paths, time, maps, where, time_format, before):
        log, columns = _converted(log, _columns(log, names, optional), wanted, maps)
        required = set(names or ())
        for name, samples in log.runs.items():
            runs.append(_run(log, name, samples, columns, required, held))
    check_same_units(runs, maps)
    return runs if resample is None else at_rate(runs, resample, held, averaged, slower)


def at_rate(
    runs: Sequence[Run],
    rate: float,
    held: Collection[str],
    averaged: Collection[str],
    slower: Literal["refuse", "keep"],
) -> list[Run]:
    """`runs` brought to `rate` [Hz]; those that are slower are refused, or kept as they are."""
    kept = [
        slower == "keep" and rate * run.step > 1 and not same_rate(rate, 1 / run.step)
        for run in runs
    ]
    return [
        run if as_it_is else resampled(run, rate, held, averaged)
        for run, as_it_is in zip(runs, kept, strict=True)
    ]


def check_same_units(runs: Iterable[Run], maps: Iterable[str] = ()) -> None:
    """Refuse logs, read with `maps`, that give one column in units of different size, or of
    different things."""
    known: dict[str, Run] = {}
    for run in runs:
        for name, unit in run.units.items():
            first = known.setdefault(name, run)
            change = conversion(unit, first.units[name])
            if change == "":
                continue
            source = parse_maps(maps).get(name, alias(name))
            said = (
                f"{run.source}: column {name!r} is in {unit!r}, but in {first.source} it is in "
                f"{first.units[name]!r}"
            )
            if change is None:
                raise InputError(f"{said}, which is no unit of the same; take another column.")
            raise InputError(
                f"{said}, and --map serves all logs of a call; convert it in the file, or give "
                f"this log to a call of its own, with --map '{name}={source}{change}'."
            )


def _columns(
    log: LogFile, names: Sequence[str] | None, optional: Sequence[str] | None
) -> dict[str, Float[np.ndarray, "rows"]]:
    table = log.table
    if names is None and optional is None:
        found = {name: name for name in log.signals if not is_text(table.columns[name])}
    else:
        check_present(table, names or ())
        wanted = dict.fromkeys([*(names or ()), *(optional or ())])
        found = {name: at for name in wanted if (at := find_column(table, name)) is not None}
    return {name: _numbers(table, column) for name, column in found.items()}


def check_present(table: LogTable, names: Sequence[str]) -> None:
    """Raises `InputError` where `table` lacks one of `names`, with what may have been meant."""
    missing = [name for name in names if find_column(table, name) is None]
    if not missing:
        return
    close = difflib.get_close_matches(missing[0], list(table.columns), n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    raise InputError(
        f"{table.source} has no column {', '.join(map(repr, missing))}{hint}; it has "
        f"{', '.join(table.columns)}; rename or convert one with "
        f'--map "{missing[0]}=EXPRESSION".'
    )


def _converted(
    log: LogFile,
    columns: dict[str, Float[np.ndarray, "rows"]],
    wanted: Mapping[str, str],
    maps: Iterable[str],
) -> tuple[LogFile, dict[str, Float[np.ndarray, "rows"]]]:
    """Columns in the units that are `wanted`; notes of the log say which were converted."""
    units, found, told = dict(log.table.units), dict(columns), []
    for name, values in columns.items():
        factor, offset = unit_change(log.table, name, wanted.get(name, ""), maps)
        if (factor, offset) != (1, 0):
            found[name] = factor * values + offset
            column = find_column(log.table, name) or name
            told.append(f"{column!r} from {units[column]} to {wanted[name]}")
            units[column] = wanted[name]
    if not told:
        return log, columns
    note = f"{log.table.source}: converted to the plant's units: {', '.join(told)}."
    return replace(log, table=replace(log.table, units=units), notes=(*log.notes, note)), found


def unit_change(
    table: LogTable, name: str, wanted: str, maps: Iterable[str] = ()
) -> tuple[float, float]:
    """(factor, offset) that bring column `name` to the unit `wanted`, as `change_of`. Raises
    `InputError` where the file gives it a unit of something else."""
    column = find_column(table, name) or name
    given = _unit(table, name)
    change = change_of(given, wanted)
    if change is None:
        source = parse_maps(maps).get(name, alias(column))  # a computed column has no unit
        raise InputError(
            f"{table.source}: column {column!r} is in {given!r}, but {name!r} of the plant is in "
            f"{wanted!r}, which is no unit of the same; take another column, or this one as it is, "
            f"with --map '{name}={source}*1'."
        )
    return change


def _unit(table: LogTable, name: str) -> str:
    """The unit that the file gives for column `name`; "" where it gives none."""
    return table.units.get(find_column(table, name) or name, "").strip()


def _numbers(table: LogTable, column: str) -> Float[np.ndarray, "rows"]:
    values = finite_or_empty(table, column)
    if np.isnan(values).all():
        raise InputError(
            f"{table.source}: column {column!r} is empty in all {len(values)} rows; fill it or "
            "remove it from the file."
        )
    return values


def finite_or_empty(table: LogTable, column: str) -> Float[np.ndarray, "rows"]:
    """A column as numbers, NaN where empty. Raises `InputError` for text and Inf."""
    values = table.columns[column]
    if is_text(values):
        raise text_error(table, column)
    infinite = np.flatnonzero(np.abs(values) > LARGEST)
    if infinite.size:
        what = "not a finite number" if np.isinf(values[infinite[0]]) else "too large a number"
        raise InputError(
            f"{table.source}, row {table.rows[infinite[0]]}, column {column!r}: "
            f"{values[infinite[0]]} is {what}; correct the cell, or leave it empty "
            "where nothing was sampled."
        )
    return values


def _run(
    log: LogFile,
    name: str,
    samples: np.ndarray,
    columns: dict[str, Float[np.ndarray, "rows"]],
    required: set[str],
    held: Collection[str],
) -> Run:
    """One run; a column that is empty in this run only is absent from it, unless required."""
    t = log.t[samples]
    taken = {column: values[samples] for column, values in columns.items()}
    empty = [column for column, values in taken.items() if np.isnan(values).all()]
    for column in empty:
        if column in required:
            raise InputError(
                f"{log.table.source}: column {column!r} is empty in all rows of run {name!r}; "
                "fill it or remove the run."
            )
        del taken[column]
    holes = None if log.holes is None else log.holes[samples]
    aligned = align(t, taken, held, holes)
    columns = dict(aligned.columns)
    for column in [column for column, values in columns.items() if np.isnan(values).all()]:
        if column in required:
            raise InputError(
                f"{log.table.source}: column {column!r} of run {name!r} is sampled at irregular "
                "times of its own, so that no row holds it together with the rest; log it at a "
                "regular rate."
            )
        del columns[column]
    sampled = {column: cells for column, cells in aligned.sampled.items() if column in columns}
    units = {column: _unit(log.table, column) for column in columns}
    return Run(
        name,
        log.table.source,
        t[aligned.kept],
        columns,
        clock=log.clocks.get(name),
        sampled=sampled,
        units={column: unit for column, unit in units.items() if unit},
        notes=log.notes,
    )
