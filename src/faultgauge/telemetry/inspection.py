"""What is in a log, before any plant is fitted to it."""

from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from faultgauge.telemetry.logs import LogFile, Paths, open_logs
from faultgauge.telemetry.mapping import alias
from faultgauge.telemetry.oversampling import oversampled
from faultgauge.telemetry.rates import align
from faultgauge.telemetry.runs import Run, gaps
from faultgauge.telemetry.skeleton import called_like_input
from faultgauge.telemetry.statistics import Statistics, statistics
from faultgauge.telemetry.stuck import stuck_stretches
from faultgauge.telemetry.table import LARGEST, is_text, text_cells
from faultgauge.telemetry.timing import unit_map
from faultgauge.telemetry.writing import stamp

__all__ = ["ColumnReport", "Gap", "Inspection", "RunReport", "inspect_runs"]

UNEVEN = 0.2  # jitter worth a remark
MOST_NAMES = 6  # in one hint
FULL_RATE = 0.5  # of the cells of a column are there at least
# Steps of whole-number times that may be milliseconds: 1 kHz to 1 Hz. Other steps are as usual in
# seconds (2, 5, 30, 60) and rare as rates.
STEPS_IN_MS = (1.0, 10.0, 100.0, 1000.0)


@dataclass(frozen=True)
class Gap:
    """A hole in the time of a run: the last time before it and its length, s."""

    start: float
    length: float


@dataclass(frozen=True)
class RunReport:
    """One run: times in s, `rate` in Hz; `jitter` is the 95th percentile of |step - median| over
    the median step; `empty` counts the empty cells of each column. `start_clock` and `end_clock`
    are what the log's clock showed, ISO 8601, where it has one."""

    name: str
    source: str
    rows: int
    start: float
    end: float
    duration: float
    step: float
    rate: float
    jitter: float
    gaps: tuple[Gap, ...]
    empty: dict[str, int]
    start_clock: str | None = None
    end_clock: str | None = None


@dataclass(frozen=True)
class ColumnReport:
    """One column over all runs that have it: `kind` is number, text or empty; `unit` as the file
    gives it, or nothing; `share_empty` a fraction of their rows; no `statistics` for text."""

    name: str
    known_as: str
    kind: str
    unit: str
    share_empty: float
    statistics: Statistics | None


@dataclass(frozen=True)
class Inspection:
    """Runs, columns, and hints in plain sentences."""

    runs: tuple[RunReport, ...]
    columns: tuple[ColumnReport, ...]
    hints: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The same as plain dicts, lists, strings and finite numbers, for JSON."""
        return asdict(self)


def inspect_runs(
    paths: Paths,
    *,
    time: str | None = None,
    maps: Iterable[str] = (),
    where: str | None = None,
    time_format: str | None = None,
    inputs: Collection[str] = (),
) -> Inspection:
    """Describe logs, read as `read_telemetry` reads them; some columns are known to be `inputs`.

    Raises `InputError` for the same files, maps and times; a column that holds text or Inf, or
    nothing at all, is described and not refused.
    """
    logs = open_logs(paths, time, maps, where, time_format)
    runs = tuple(_run(log, name) for log in logs for name in log.runs)
    names = list(dict.fromkeys(name for log in logs for name in log.signals))
    columns = tuple(_column([log for log in logs if name in log.signals], name) for name in names)
    hints = [note for log in logs for note in (*log.table.notes, *log.notes)]
    hints += [*_time_hints(logs, runs), *(hint for log in logs for hint in _cell_hints(log))]
    hints += [hint for column in columns for hint in _column_hints(column)]
    hints += _renamed(columns)
    driven = {
        column.name
        for column in columns
        if column.name in inputs
        or called_like_input(column.known_as, column.unit)
        or (column.statistics and column.statistics.held)
    }
    hints += [h for log in logs for name in log.runs for h in _sensor_hints(log, name, driven)]
    hints += [h for log in logs for name in log.runs for h in _rate_hints(log, name, driven)]
    return Inspection(runs, columns, tuple(dict.fromkeys(hints)))


def _empty_cells(log: LogFile, name: str) -> np.ndarray:
    cells = log.table.columns[name]
    if is_text(cells):
        return np.array([not cell.strip() for cell in cells])
    return np.isnan(cells)


def _run(log: LogFile, name: str) -> RunReport:
    samples = log.runs[name]
    t = log.t[samples]
    steps = np.diff(t)
    step = float(np.median(steps))
    return RunReport(
        name=name,
        source=log.table.source,
        rows=len(t),
        start=float(t[0]),
        end=float(t[-1]),
        duration=float(t[-1] - t[0]),
        step=step,
        rate=1 / step,
        jitter=float(np.percentile(np.abs(steps - step), 95) / step),
        gaps=tuple(Gap(float(t[k]), float(steps[k])) for k in np.flatnonzero(gaps(t))),
        empty={signal: int(_empty_cells(log, signal)[samples].sum()) for signal in log.signals},
        start_clock=stamp(log.clocks.get(name), float(t[0])),
        end_clock=stamp(log.clocks.get(name), float(t[-1])),
    )


def _column(logs: list[LogFile], name: str) -> ColumnReport:
    empty = float(np.concatenate([_empty_cells(log, name) for log in logs]).mean())
    unit = next((log.table.units[name] for log in logs if name in log.table.units), "")
    if any(is_text(log.table.columns[name]) for log in logs):
        return ColumnReport(name, alias(name), "text", unit, empty, None)
    parts = [(log, samples) for log in logs for samples in log.runs.values()]
    found = statistics(
        [log.t[samples] for log, samples in parts],
        [log.table.columns[name][samples] for log, samples in parts],
    )
    return ColumnReport(name, alias(name), "number" if empty < 1 else "empty", unit, empty, found)


def _time_hints(logs: list[LogFile], runs: tuple[RunReport, ...]) -> list[str]:
    hints = []
    for log in logs:
        known = bool(log.clocks) or log.table.units.get(log.time) == "s"
        if known or is_text(log.table.columns[log.time]):
            continue
        conversion = unit_map(log.time)
        if conversion:
            hints.append(
                f"Time column {log.time!r} is taken as seconds but its name says otherwise: "
                f"use {conversion} instead."
            )
        elif log.time == "t" and not np.any(log.t % 1):
            step = float(np.median(np.diff(log.t)))
            if step in STEPS_IN_MS:
                hints.append(
                    f"Time column 't' holds whole numbers {step:g} apart, taken as seconds: if "
                    f"they are milliseconds, of a log at {1000 / step:g} Hz, use "
                    '--map "t=t/1000".'
                )
    for run in runs:
        if run.gaps:
            longest = max(gap.length for gap in run.gaps)
            hints.append(
                f"Run {run.name!r} has {len(run.gaps)} gap(s) in time, the longest {longest:.4g} s:"
                " a fit splits the run there and an estimate judges nothing there."
            )
        if run.jitter > UNEVEN:
            hints.append(
                f"Run {run.name!r} is sampled unevenly: 5 % of its steps differ by more than "
                f"{100 * run.jitter:.0f} % from the median of {run.step:.4g} s."
            )
    return hints


def _cell_hints(log: LogFile) -> list[str]:
    hints = []
    for name in log.signals:
        cells = log.table.columns[name]
        if is_text(cells):
            text = text_cells(cells)
            if text.mean() < 0.5:
                first = np.argmax(text)
                hints.append(
                    f"{log.table.source}, row {log.table.rows[first]}: column {name!r} would hold "
                    f"numbers but for {text.sum()} cell(s) such as {cells[first][:40]!r}; correct "
                    "or empty them."
                )
        elif (infinite := np.abs(cells) > LARGEST).any():
            row = log.table.rows[np.argmax(infinite)]
            hints.append(
                f"{log.table.source}, row {row}: column {name!r} is infinite or too large; "
                "commands that need it refuse it until the cell is corrected or emptied."
            )
    return hints


def _renamed(columns: tuple[ColumnReport, ...]) -> list[str]:
    other = [f"{c.name!r} is {c.known_as}" for c in columns if c.known_as != c.name]
    more = f" and {len(other) - MOST_NAMES} more" if len(other) > MOST_NAMES else ""
    names = ", ".join(other[:MOST_NAMES])
    return [f"In --map, --where and plant files, {names}{more}."] if other else []


def _sensor_hints(log: LogFile, name: str, driven: set[str]) -> list[str]:
    """What one run says of its sensors: rates of their own, and stretches where one is stuck.

    Columns that are `driven`, and not measured, stay on a value for good reason.
    """
    samples = log.runs[name]
    numbers = [each for each in log.signals if not is_text(log.table.columns[each])]
    columns = {each: log.table.columns[each][samples] for each in numbers}
    run = Run(name, log.table.source, log.t[samples], columns)
    hints = []
    for each in align(run.t, columns).filled:
        own = run.t[np.isfinite(columns[each])]
        hints.append(
            f"Column {each!r} has a sample every {np.median(np.diff(own)):.4g} s in run {name!r}, "
            "at other times than the rest: it is interpolated between them, and held where it is "
            "an input."
        )
    for each in numbers:
        stuck = stuck_stretches(run, each) if each not in driven else []
        if stuck:
            longest = max(stuck, key=lambda part: part.stop - part.start)
            start, end = run.t[longest.start], run.t[longest.stop - 1]
            hints.append(
                f"Column {each!r} stays on exactly {columns[each][longest.start]:.6g} from "
                f"t = {start:.6g} to {end:.6g} s in run {name!r} while others move: "
                "stuck or saturated, unless it is an input; --where leaves such rows out."
            )
    return hints


def _rate_hints(log: LogFile, name: str, driven: set[str]) -> list[str]:
    """A hint where all that a run measures moves far more slowly than it is sampled."""
    samples = log.runs[name]
    t = log.t[samples]
    columns = {each: log.table.columns[each] for each in log.signals if each not in driven}
    columns = {
        each: cells[samples]
        for each, cells in columns.items()
        if not is_text(cells) and np.isfinite(cells[samples]).mean() > FULL_RATE
    }
    run = Run(name, log.table.source, t, columns)
    return [f"{text[0].upper()}{text[1:]}." for text in oversampled([run], columns)]


def _column_hints(column: ColumnReport) -> list[str]:
    hints = []
    if column.kind == "empty":
        hints.append(f"Column {column.name!r} is empty: leave it out of the plant file.")
    if column.statistics is not None and column.statistics.constant:
        hints.append(
            f"Column {column.name!r} never changes ({column.statistics.min:.6g}): nothing can be "
            "learned from it."
        )
    return hints
