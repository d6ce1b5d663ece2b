"""From the time column of a table to seconds."""

import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
from jaxtyping import Float, Int

from faultgauge.errors import InputError
from faultgauge.plants.dimensions import parse_unit, read_unit
from faultgauge.plants.expression import unknown
from faultgauge.telemetry.mapping import alias, find_column
from faultgauge.telemetry.table import LARGEST, LogTable, float_cells, is_text, text_error

__all__ = [
    "called_like_time",
    "check_form",
    "check_increasing",
    "clock_of",
    "epoch_note",
    "find_time",
    "in_seconds",
    "seconds",
    "timestamp",
    "unit_map",
]

# How a name ends -> what makes seconds of it.
UNITS = {"ms": "/1000", "us": "/1e6", "ns": "/1e9", "min": "*60"}
# Words for a unit of time, as netCDF has them: "seconds since 1970-01-01".
WORDS = {
    "sec": "s", "second": "s", "millisecond": "ms", "msec": "ms", "microsecond": "us", "usec": "us",
    "nanosecond": "ns", "nsec": "ns", "minute": "min", "hour": "h",
}  # fmt: skip
# Time since 1970 in units that are told by the size of the numbers -> how many make a second.
EPOCHS = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
NO_YEAR = 1900  # that `strptime` gives where a format has none; no log is as old
# Some that others write, to be proposed, never guessed.
FORMS = [
    f"{day} {hour}"
    for day in ("%d/%m/%Y", "%m/%d/%Y", "%Y/%m/%d", "%d-%m-%Y", "%m-%d-%Y", "%d-%b-%Y", "%b %d, %Y")
    for hour in ("%H:%M", "%H:%M:%S", "%H:%M:%S.%f", "%I:%M %p", "%I:%M:%S %p", "%I:%M:%S.%f %p")
]
NO_TIME = "neither seconds nor an ISO 8601 timestamp"
EARLIEST, LATEST = 946_684_800.0, 4_102_444_800.0  # s: 2000 and 2100
# Day before month, as every country writes it that has points between them.
DOTTED = re.compile(
    r"(\d{1,2})\.(\d{1,2})\.(\d{4}|\d\d)"
    r"(?:[ T,;]+(\d{1,2}):(\d\d)(?::(\d\d)(?:[.,](\d{1,9}))?)?)?"
)
# Not T, which is a torque or a temperature.
TIME_NAME = re.compile(
    r"(t|tout|(?i:time|timestamp|datetime|date|clock|epoch|sec|seconds))([\W_].*)?"
)


def find_time(table: LogTable, time: str | None, mapped: bool) -> str:
    """The time column: `t`, which a map may have made (`mapped`), or what `--time` named.

    Raises `InputError` that lists the columns and proposes likely ones.
    """
    if mapped and time not in (None, "t"):
        raise InputError(f"--time {time} and --map t=... both name the time; keep one of them.")
    column = find_column(table, time or "t")
    if column is not None:
        return column
    if time is not None:
        raise InputError(f"{table.source}, --time: {unknown('column', time, table.columns)}.")
    raise InputError(
        f"{table.source} has no time column 't'; its columns are {', '.join(table.columns)}; "
        f"{_proposal(table)}."
    )


def called_like_time(column: str) -> bool:
    """Whether a column's name is a usual one for time: `t_s`, `Time (ms)`, `group/time`."""
    last = re.split(r"[./]", column)[-1]
    return any(TIME_NAME.fullmatch(name) for name in (column, last))


def unit_map(column: str) -> str | None:
    """The `--map` that makes seconds of a time column named in ms, us, ns or min, if it is."""
    for unit, factor in UNITS.items():
        if re.search(rf"(?i)(^|[\W_\d]){unit}\W*$", column):
            return f'--map "t={alias(column)}{factor}"'
    return None


def _proposal(table: LogTable) -> str:
    scores = {name: _likely(table, name) for name in table.columns}
    best = max(1, *scores.values())
    likely = [name for name, score in scores.items() if score == best][:3]
    options = [unit_map(name) or f"--time {_quoted(name)}" for name in likely]
    if options:
        return f"try {' or '.join(options)}"
    return "name the time column with --time COLUMN, or log one (to a MAT file, its step Ts in s)"


def _quoted(name: str) -> str:
    return name if re.fullmatch(r"[\w.-]+", name) else f'"{name}"'


def _likely(table: LogTable, name: str) -> int:
    """2 if called like a time, 1 if it only runs like one, else 0."""
    cells = table.columns[name]
    if called_like_time(name):
        return 2
    if is_text(cells):
        return int(all(timestamp(cell) is not None for cell in cells[:3]))
    return int(bool(np.all(np.diff(cells) > 0)))


def in_seconds(table: LogTable, column: str) -> LogTable:
    """`table` with its time `column` in seconds, where the file gives it a unit of time."""
    word = table.units.get(column, "").split(" since ")[0].strip()
    try:
        unit = read_unit(WORDS.get(word.lower().removesuffix("s"), word))
    except ValueError:
        return table
    cells = table.columns[column]
    if is_text(cells) or unit.dimension != parse_unit("s") or not 0 < unit.scale < np.inf:
        return table
    bare = replace(table, units={name: u for name, u in table.units.items() if name != column})
    epoch = _epoch_unit(bare, column)
    if epoch is not None and np.isclose(unit.scale * EPOCHS[epoch], 1):
        return bare  # since 1970, with a clock
    # 35 ms / 1000 is the number 0.035, 35 ms * 0.001 is not; 1 / 1e-9 misses 1e9 by its last bit.
    small = unit.scale < 1
    cells = cells / float(f"{1 / unit.scale:.15g}") if small else cells * unit.scale
    return replace(
        table, columns=table.columns | {column: cells}, units=table.units | {column: "s"}
    )


def seconds(table: LogTable, column: str, form: str | None = None) -> Float[np.ndarray, "rows"]:
    """Time column in seconds: numbers as they are, timestamps from the file's first.

    Timestamps are as `form` says (of `strptime`), else as `timestamp` reads them, good to a
    microsecond, or milli-, micro- or nanoseconds since 1970 (`epoch_note`); those with a time zone
    are compared as instants. Raises `InputError` for an empty or infinite time, text that is
    neither, and zones on some rows only.
    """
    cells = table.columns[column]
    if is_text(cells):
        return _since_first(table, column, form)
    if form is not None:
        raise InputError(
            f"{table.source}, --time-format: the time column {column!r} holds numbers, not text; "
            "leave the option out, or name another column with --time."
        )
    wrong = np.flatnonzero(~(np.abs(cells) <= LARGEST))
    if wrong.size:
        found = "empty" if np.isnan(cells[wrong[0]]) else cells[wrong[0]]
        raise _refusal(table, column, wrong[0], f"the time is {found}")
    unit = _epoch_unit(table, column)
    return cells if unit is None else (cells - cells[0]) / EPOCHS[unit]


def _epoch_unit(table: LogTable, column: str) -> str | None:
    """The unit of time since 1970 that number column `column` is in, if its size tells one.

    All of it must lie between 2000 and 2100. Seconds are left as they are, and so is what the file
    gives a unit.
    """
    cells = table.columns[column]
    if is_text(cells) or table.units.get(column):
        return None
    low, high = float(cells.min()), float(cells.max())
    for unit, per_second in EPOCHS.items():
        if low >= EARLIEST * per_second and high < LATEST * per_second:
            return unit
    return None


def epoch_note(table: LogTable, column: str) -> str | None:
    """A sentence where the time column was taken for milli-, micro- or nanoseconds since 1970."""
    unit = _epoch_unit(table, column)
    if unit is None:
        return None
    return (
        f"{table.source}: the time column {column!r} holds {unit} since 1970 by its size (the "
        f"first is {clock_of(table, column):%Y-%m-%d %H:%M:%S} UTC) and is read so, in seconds "
        "since its first."
    )


def _since_first(table: LogTable, column: str, form: str | None) -> Float[np.ndarray, "rows"]:
    cells = table.columns[column]
    stamps: list[datetime] = []
    for k, cell in enumerate(cells):
        stamp = timestamp(cell, form)
        if stamp is None:
            if form is None and not stamps and _is_number(cell):
                raise text_error(table, column)
            if form is None and not stamps and cell.strip():
                raise InputError(
                    f"{table.source}, row {table.rows[k]}, column {column!r}: {cell[:40]!r} is "
                    f"{NO_TIME}; say how it is written, {_forms(cell)}."
                )
            wrong = NO_TIME if form is None else f"not of the form --time-format {form!r}"
            found = f"{cell[:40]!r} is {wrong}" if cell.strip() else "the time is empty"
            raise _refusal(table, column, k, found)
        stamps.append(stamp)
        if (stamp.tzinfo is None) != (stamps[0].tzinfo is None):
            raise _refusal(
                table, column, k, f"of {cell!r} and the first, {cells[0]!r}, only one has a zone"
            )
    return np.array([(stamp - stamps[0]).total_seconds() for stamp in stamps])


def _forms(cell: str) -> str:
    """The options that would read it."""
    fitting = [f'--time-format "{each}"' for each in FORMS if timestamp(cell, each)]
    return " or ".join(fitting) or 'as in --time-format "%d/%m/%Y %H:%M:%S"'


def clock_of(table: LogTable, column: str, form: str | None = None) -> datetime | None:
    """What the clock showed at 0 s of `seconds`, where the time column holds timestamps with a
    date."""
    cells = table.columns[column]
    if is_text(cells):
        stamp = timestamp(cells[0], form)
        return None if stamp is None or stamp.year <= NO_YEAR else stamp
    unit = _epoch_unit(table, column)
    if unit is None:
        return None
    return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=float(cells[0]) / EPOCHS[unit])


def timestamp(cell: str, form: str | None = None) -> datetime | None:
    """A timestamp: as `form` of `strptime` says, else ISO 8601 or day.month.year; None if none."""
    cell = cell.strip()
    try:
        return datetime.fromisoformat(cell) if form is None else datetime.strptime(cell, form)
    except ValueError:
        return _dotted(cell) if form is None else None


def _dotted(cell: str) -> datetime | None:
    match = DOTTED.fullmatch(cell)
    if match is None:
        return None
    day, month, year, hour, minute, second = (int(part or 0) for part in match.groups()[:6])
    micro = int(f"{match[7] or 0:0<6}"[:6])
    try:
        return datetime(year + 2000 * (year < 100), month, day, hour, minute, second, micro)
    except ValueError:
        return None


def check_form(form: str) -> None:
    """Refuse a `--time-format` that `strptime` cannot read."""
    try:
        datetime.strptime(datetime(2026, 11, 22).strftime(form), form)
        if "%" in form:
            return
    except (ValueError, re.error):
        pass
    raise InputError(
        f"--time-format {form!r} is no format of a time; write %Y %m %d %H %M %S and %f for "
        'year, month, day, hour, minute, second and its fraction, as in "%d/%m/%Y %H:%M:%S.%f".'
    )


def _is_number(cell: str) -> bool:
    return float_cells([cell]) is not None and bool(cell.strip())


def _refusal(table: LogTable, column: str, sample: int | np.integer, found: str) -> InputError:
    return InputError(
        f"{table.source}, row {table.rows[sample]}, column {column!r}: {found}; every row needs a "
        "time in seconds or a timestamp, so correct or remove the row."
    )


def check_increasing(
    table: LogTable,
    column: str,
    t: Float[np.ndarray, "rows"],
    samples: Int[np.ndarray, "samples"],
    run: str,
) -> None:
    """Raises `InputError` unless `t` increases from each to the next of `samples` (one run)."""
    wrong = np.flatnonzero(np.diff(t[samples]) <= 0)
    if not wrong.size:
        return
    before, after = samples[wrong[0]], samples[wrong[0] + 1]
    what = "is the same again" if t[after] == t[before] else "runs backwards"
    cells = table.columns[column]
    raise InputError(
        f"{table.source}, column {column!r}, run {run!r}: time {what} from row "
        f"{table.rows[before]} ({cells[before]}) to row {table.rows[after]} ({cells[after]}); "
        "sort or remove rows, or tell runs apart by a column 'run'."
    )
