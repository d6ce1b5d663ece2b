"""`--where CONDITION`: keep the rows of a log that meet it.

A condition compares expressions over the file's columns, in the grammar of `--map`, with
`== != < <= > >=`, joined by `and or not`, `&` or `|`. A text column is compared by `==` or `!=`
with text in quotes. It is parsed like every expression and never evaluated as Python.
"""

import ast
import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from faultgauge.errors import InputError
from faultgauge.plants.expression import (
    MAX_CHARACTERS,
    MAX_DEPTH,
    Name,
    Scope,
    evaluate,
    names_used,
    parse,
    unknown,
)
from faultgauge.telemetry.mapping import alias, find_column
from faultgauge.telemetry.rates import DROPOUT, FEWEST_OF_A_RATE, REGULAR, SLOWER
from faultgauge.telemetry.runs import GAP_STEPS, ROUNDING
from faultgauge.telemetry.table import LogTable, is_text

__all__ = ["keep_rows", "met"]

COMPARISONS = {
    ast.Eq: np.equal,
    ast.NotEq: np.not_equal,
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
}
DENSE = 0.5  # of the time of a run covered by samples of full rate: with dropouts, not on change
EXAMPLE = '--where "mode == 3 and abs(u) < 5" or --where "phase == \'cruise\'"'


class _Truth(NamedTuple):
    """Where a condition is true and where it is false; neither where a cell is empty."""

    yes: Bool[np.ndarray, "rows"]
    no: Bool[np.ndarray, "rows"]


def met(
    table: LogTable,
    condition: str,
    time: str,
    t: Float[np.ndarray, "rows"],
    runs: dict[str, Int[np.ndarray, "_"]],
) -> Bool[np.ndarray, "rows"]:
    """The rows of `table` that meet `condition`; one that rests on an empty cell is not met.

    Within each of `runs` (their rows; `t`, s, is the time, from column `time`) a column keeps its
    last value for as long as `_reach` says. Raises `InputError` for an unknown column, what is not
    a condition, and text compared with numbers.
    """
    return _Condition(table, condition, time, t, runs).truth().yes


def keep_rows(
    table: LogTable, time: str, runs: dict[str, np.ndarray], kept: Bool[np.ndarray, "rows"]
) -> tuple[LogTable, np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """`table` without the rows that are not `kept`, the rows it has now, `runs` in it, and which of
    its rows are holes.

    Of each hole inside a run one row stays, empty but for its `time`, so that the run is split
    there however short the hole is. A run with fewer than two rows left is dropped.
    """
    rows = np.zeros(len(kept), dtype=bool)
    blank = np.zeros(len(kept), dtype=bool)
    left = {}
    for name, samples in runs.items():
        good = kept[samples]
        if good.sum() < 2:
            continue
        last = np.flatnonzero(good)[-1]
        marks = np.append(False, good[:-1]) & ~good
        marks[last:] = False
        stay = good | marks
        rows[samples[stay]] = True
        blank[samples[marks]] = True
        left[name] = samples[stay]
    place = np.cumsum(rows) - 1
    columns = {
        name: (cells if name == time else _blanked(cells, blank))[rows]
        for name, cells in table.columns.items()
    }
    smaller = replace(table, columns=columns, rows=table.rows[rows])
    left = {name: place[samples] for name, samples in left.items()}
    return smaller, rows, left, blank[rows]


def _blanked(cells: Shaped[np.ndarray, "rows"], blank: Bool[np.ndarray, "rows"]) -> np.ndarray:
    return np.where(blank, "" if is_text(cells) else np.nan, cells).astype(cells.dtype)


class _Condition:
    def __init__(
        self,
        table: LogTable,
        text: str,
        time: str,
        t: Float[np.ndarray, "rows"],
        runs: dict[str, Int[np.ndarray, "_"]],
    ) -> None:
        self.table, self.text = table, text.strip()
        self.time, self.t, self.runs = time, t, runs
        self.where = f"{table.source}, --where"
        self.names = list(dict.fromkeys(alias(name) for name in table.columns))

    def truth(self) -> _Truth:
        depth = 0
        for character in self.text:
            depth += (character in "([{") - (character in ")]}")
            if depth > MAX_DEPTH:
                raise self.error(f"has more than {MAX_DEPTH} nested parentheses")
        if len(self.text) > MAX_CHARACTERS:
            raise self.error(f"is longer than {MAX_CHARACTERS} characters")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # Python's advice on text that is refused below
                tree = ast.parse(self.text, mode="eval").body
        except (SyntaxError, ValueError, MemoryError, RecursionError):
            raise self.error(
                "is not a condition; check operators, quotes and parentheses"
            ) from None
        return self.convert(tree, 0)

    def error(self, message: str) -> InputError:
        return InputError(f"{self.where}: {self.text[:80]!r} {message}, as in {EXAMPLE}.")

    def convert(self, node: ast.expr, depth: int) -> _Truth:
        if depth > MAX_DEPTH:
            raise self.error(f"is nested deeper than {MAX_DEPTH}")
        match node:
            case ast.BoolOp():
                parts = [self.convert(part, depth + 1) for part in node.values]
                return _joined(parts, isinstance(node.op, ast.And))
            case ast.BinOp(op=ast.BitAnd() | ast.BitOr()):
                parts = [self.convert(part, depth + 1) for part in (node.left, node.right)]
                return _joined(parts, isinstance(node.op, ast.BitAnd))
            case ast.UnaryOp(op=ast.Not()):
                yes, no = self.convert(node.operand, depth + 1)
                return _Truth(no, yes)
            case ast.Compare():
                sides = [node.left, *node.comparators]
                pairs = zip(sides, node.ops, sides[1:], strict=False)
                return _joined([self.compare(*pair) for pair in pairs], every=True)
            case _:
                found = ast.get_source_segment(self.text, node) or self.text
                raise self.error(f"holds {found[:40]!r}, which is no condition; compare something")

    def compare(self, left: ast.expr, operator: ast.cmpop, right: ast.expr) -> _Truth:
        if type(operator) not in COMPARISONS:
            raise self.error("compares with a word; use == != < <= > or >=")
        for side in (left, right):
            if any(isinstance(part, ast.BitAnd | ast.BitOr) for part in ast.walk(side)):
                raise self.error("needs parentheses around each side of & and |, or 'and', 'or'")
        first, second = self.value(left), self.value(right)
        if is_text(first) != is_text(second):
            raise self.error("compares text with a number; put quotes round text and only there")
        if not is_text(first):
            known = ~np.isnan(first) & ~np.isnan(second)
        elif isinstance(operator, ast.Eq | ast.NotEq):
            known = (first != "") & (second != "")
        else:
            raise self.error("sorts text; compare it with == or !=")
        result = COMPARISONS[type(operator)](first, second).astype(bool)
        return _Truth(result & known, ~result & known)

    def value(self, node: ast.expr) -> Shaped[np.ndarray, "rows"]:
        count = len(self.table.rows)
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            return np.full(count, node.value.strip(), dtype=object)
        text = ast.get_source_segment(self.text, node) or ""
        expression = parse(text, self.where, Scope(names=self.names))
        columns = {name: self.column(name) for name in names_used(expression)}
        texts = [name for name, cells in columns.items() if is_text(cells)]
        if texts and isinstance(expression.tree, Name):
            return columns[texts[0]]
        if texts:
            raise self.error(f"calculates with {texts[0]!r}, which holds text; compare it alone")
        with np.errstate(all="ignore"):
            result = np.asarray(evaluate(expression.tree, columns, np), dtype=np.float64)
        return np.broadcast_to(result, (count,))

    def column(self, name: str) -> Shaped[np.ndarray, "rows"]:
        column = find_column(self.table, name)
        if column is None:
            raise self.error(unknown("column", name, self.names))
        cells = self.table.columns[column]
        if not is_text(cells):
            return self.held(
                cells, discrete=not np.any(cells != np.round(cells), where=~np.isnan(cells))
            )
        texts = np.array([cell.strip() for cell in cells])
        labels, codes = np.unique(texts, return_inverse=True)
        held = self.held(np.where(texts == "", np.nan, codes), discrete=True)
        return np.where(np.isnan(held), "", labels[np.nan_to_num(held).astype(int)]).astype(object)

    def held(self, cells: Float[np.ndarray, "rows"], discrete: bool) -> Float[np.ndarray, "rows"]:
        """`cells` with the empty ones filled that the sample before them reaches."""
        if not np.isnan(cells).any():
            return cells
        result = cells.copy()
        for rows in self.runs.values():
            t, sampled = self.t[rows], ~np.isnan(cells[rows])
            if not sampled.any():
                continue
            longest, alone = _reach(t, cells[rows], discrete, self.fastest(rows))
            own = np.flatnonzero(sampled)
            steps = np.append(np.diff(t[own]), np.inf)
            last = np.searchsorted(own, np.arange(len(rows)), side="right") - 1
            before = own[last]  # of rows before the first sample, the last: not used
            linked = (steps[last] <= longest) | (t - t[before] < alone)
            fill = ~sampled & (last >= 0) & linked
            result[rows[fill]] = cells[rows[before[fill]]]
        return result

    def fastest(self, rows: Int[np.ndarray, "_"]) -> Float[np.ndarray, "_"]:
        """The times, s, of the column with most samples: rows of several clocks lie closer."""
        t = self.t[rows]
        most = t[:0]
        for name, cells in self.table.columns.items():
            if name in (self.time, "t", "run"):  # on every row, whatever is sampled there
                continue
            found = cells[rows]
            own = t[found != ""] if is_text(cells) else t[~np.isnan(found)]
            most = max(most, own, key=len)
        return most


def _reach(
    t: Float[np.ndarray, "rows"],
    cells: Float[np.ndarray, "rows"],
    discrete: bool,
    fastest: Float[np.ndarray, "_"],
) -> tuple[float, float]:
    """How long a column keeps a value, s: to a next sample this far, and with none so near.

    It is told by the pattern of its samples in one run. A periodic column of the rate of
    `fastest` (s) that misses a sample has dropped out, a slower one that misses three; its value
    then stands for one interval. Anything else is logged when it changes and keeps its value until
    the next: samples without a rate, and `discrete` ones that never repeat, as on a clock some do.
    """
    own = ~np.isnan(cells)
    if own.sum() < FEWEST_OF_A_RATE:
        return np.inf, np.inf
    steps = np.diff(t[own])
    interval = float(np.median(steps))
    fast = interval <= SLOWER * np.median(np.diff(fastest))
    regular = np.mean(np.abs(steps - interval) <= 0.5 * interval) >= REGULAR
    on_change = discrete and bool(np.all(cells[own][1:] != cells[own][:-1]))
    dense = own.sum() * interval >= DENSE * (t[-1] - t[0])
    if fast and (dense or (regular and not on_change)):
        return DROPOUT * interval, (DROPOUT - 1) * interval
    if regular and not on_change:
        return (GAP_STEPS + ROUNDING) * interval, (1 - ROUNDING) * interval
    return np.inf, np.inf


def _joined(parts: list[_Truth], every: bool) -> _Truth:
    both, either = np.logical_and.reduce, np.logical_or.reduce
    yes, no = [part.yes for part in parts], [part.no for part in parts]
    return _Truth(both(yes), either(no)) if every else _Truth(either(yes), both(no))
