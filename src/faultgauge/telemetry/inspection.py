"""What is in a log, before any plant is fitted to it."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from faultgauge.telemetry.logs import LogFile, Paths, open_logs
from faultgauge.telemetry.mapping import alias
from faultgauge.telemetry.runs import gaps
from faultgauge.telemetry.statistics import Statistics, statistics
from faultgauge.telemetry.table import is_text, text_cells
from faultgauge.telemetry.timing import unit_map

__all__ = ["ColumnReport", "Gap", "Inspection", "RunReport", "inspect_runs"]

UNEVEN = 0.2  # jitter worth a remark
COARSE_STEP = 1.0  # s: whole-number times with steps of this or more may be milliseconds


@dataclass(frozen=True)
class Gap:
    """A hole in the time of a run: the last time before it and its length, s."""

    start: float
    length: float


@dataclass(frozen=True)
class RunReport:
    """One run: times in s, `rate` in Hz; `jitter` is the 95th percentile of |step - median| over
    the median step; `empty` counts the empty cells of each column."""

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


@dataclass(frozen=True)
class ColumnReport:
    """One column over all runs that have it: `kind` is number, text or empty; `share_empty` a
    fraction of their rows; no `statistics` for text."""

    name: str
    known_as: str
    kind: str
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


def inspect_runs(paths: Paths, *, time: str | None = None, maps: Iterable[str] = ()) -> Inspection:
    """Describe logs, read as `read_telemetry` reads them.

    Raises `InputError` for the same files, maps and times; a column that holds text or Inf, or
    nothing at all, is described and not refused.
    """
    logs = open_logs(paths, time, maps)
    runs = tuple(_run(log, name) for log in logs for name in log.runs)
    names = list(dict.fromkeys(name for log in logs for name in log.signals))
    columns = tuple(_column([log for log in logs if name in log.signals], name) for name in names)
    hints = [*_time_hints(logs, runs), *(hint for log in logs for hint in _cell_hints(log))]
    hints += [hint for column in columns for hint in _column_hints(column)]
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
    )


def _column(logs: list[LogFile], name: str) -> ColumnReport:
    empty = float(np.concatenate([_empty_cells(log, name) for log in logs]).mean())
    if any(is_text(log.table.columns[name]) for log in logs):
        return ColumnReport(name, alias(name), "text", empty, None)
    parts = [(log, samples) for log in logs for samples in log.runs.values()]
    found = statistics(
        [log.t[samples] for log, samples in parts],
        [log.table.columns[name][samples] for log, samples in parts],
    )
    return ColumnReport(name, alias(name), "number" if empty < 1 else "empty", empty, found)


def _time_hints(logs: list[LogFile], runs: tuple[RunReport, ...]) -> list[str]:
    hints = []
    for log in logs:
        conversion = unit_map(log.time)
        if is_text(log.table.columns[log.time]):
            continue
        if conversion:
            hints.append(
                f"Time column {log.time!r} is taken as seconds but its name says otherwise: use "
                f"{conversion} instead."
            )
        elif log.time == "t" and np.median(np.diff(log.t)) >= COARSE_STEP and not np.any(log.t % 1):
            hints.append(
                "Time column 't' holds whole numbers: if they are not seconds but, say, "
                'milliseconds, use --map "t=t/1000".'
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
        elif np.isinf(cells).any():
            row = log.table.rows[np.argmax(np.isinf(cells))]
            hints.append(
                f"{log.table.source}, row {row}: column {name!r} is infinite; commands that "
                "need it refuse it until the cell is corrected or emptied."
            )
    return hints


def _column_hints(column: ColumnReport) -> list[str]:
    hints = []
    if column.kind == "empty":
        hints.append(
            f"Column {column.name!r} is empty: commands that need it refuse it; remove or fill it."
        )
    if column.statistics is not None and column.statistics.constant:
        hints.append(
            f"Column {column.name!r} never changes ({column.statistics.min:.6g}): nothing can be "
            "learned from it."
        )
    if column.known_as != column.name:
        hints.append(
            f"Column {column.name!r} is called {column.known_as} in --map and in plant files."
        )
    return hints
