"""`--map NAME=EXPRESSION`: new columns from those of the file.

An expression can only spell identifiers. A column whose name is not one is therefore also known
under the name that `alias` gives: every character that an identifier cannot have becomes `_`, so
`wheel speed` is also `wheel_speed`. Where a unit was taken from its header, `wheel speed [rpm]`, it
is known by the whole header, too. This holds wherever a column is named, in `--map`, in `--time`
and in a plant file. Two columns that one name could mean are refused when it is used.
"""

import keyword
import unicodedata
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.plants.expression import Expression, Name, Scope, evaluate, names_used, parse
from faultgauge.telemetry.table import LogTable, is_text, text_error

__all__ = ["alias", "apply_maps", "can_map", "find_column", "parse_maps"]


def alias(name: str) -> str:
    """The identifier that column `name` is known under: itself, if it is one.

    `motor.temp` gives `motor_temp`, `2nd` gives `_2nd`, and `lambda`, which no expression can
    spell, gives `lambda_`.
    """
    characters = unicodedata.normalize("NFKC", name)  # as Python's parser spells it
    spelled = "".join(c if f"_{c}".isidentifier() else "_" for c in characters)
    if keyword.iskeyword(spelled):
        return spelled + "_"
    return spelled if spelled.isidentifier() else "_" + spelled


def find_column(table: LogTable, name: str) -> str | None:
    """The column of `table` that `name` means, by its own name, its whole header or the alias of
    either; None if none.

    Raises `InputError` if several could be meant.
    """
    meant = [column for column in table.columns if name in _known_as(table, column)]
    if len(meant) > 1:
        raise InputError(
            f"{table.source}: {name!r} could mean columns {' and '.join(map(repr, meant))}; "
            "rename one of them in the file."
        )
    return meant[0] if meant else None


def _known_as(table: LogTable, column: str) -> tuple[str, ...]:
    written = table.written.get(column, column)
    return column, alias(column), written, alias(written)


def parse_maps(maps: Iterable[str]) -> dict[str, str]:
    """`NAME=EXPRESSION` texts as {NAME: EXPRESSION}.

    Raises `InputError` if one has no `=`, a NAME is not an identifier, or two have one NAME.
    """
    parsed: dict[str, str] = {}
    for text in maps:
        name, equals, expression = (part.strip() for part in text.partition("="))
        if not equals:
            raise InputError(
                f'--map {text!r} has no "="; write NAME=EXPRESSION, as in --map "h=rpm*0.088".'
            )
        if not name or alias(name) != name:
            raise InputError(
                f"--map {text!r}: {name!r} is not a name; use letters, digits and _, and no "
                f"digit in front, as in {alias(name or 'h')!r}."
            )
        if name in parsed:
            raise InputError(f"--map gives {name!r} twice; keep one of them.")
        parsed[name] = expression
    return parsed


def apply_maps(table: LogTable, maps: dict[str, str]) -> LogTable:
    """`table` with the columns that `maps` ({NAME: EXPRESSION}) defines.

    Expressions see the file's own columns, never other maps; a new column hides one of the same
    name; an expression that is only a name renames a column, text or numbers, and keeps its
    unit. An empty cell makes an empty cell. Raises `InputError` for an unknown or ambiguous column,
    text, or a value that is not a finite number, naming the row.
    """
    scope = _scope(table)
    new, units = {}, {}
    for name, text in maps.items():
        where = f"{table.source}, --map {name}"
        expression = parse(text, where, scope)
        sources = {used: find_column(table, used) or used for used in names_used(expression)}
        if isinstance(expression.tree, Name):
            source = sources[expression.tree.name]
            new[name] = table.columns[source]
            if source in table.units:
                units[name] = table.units[source]
        else:
            new[name] = _values(table, where, expression, sources)
    kept = {column: cells for column, cells in table.columns.items() if alias(column) not in new}
    old = {column: unit for column, unit in table.units.items() if column in kept}
    written = {column: header for column, header in table.written.items() if column in kept}
    return replace(table, columns=kept | new, units=old | units, written=written)


def can_map(table: LogTable, name: str, text: str) -> bool:
    """Whether `table` has every column that the map `name=text` reads."""
    try:
        parse(text, f"--map {name}", _scope(table))
    except InputError:
        return False
    return True


def _scope(table: LogTable) -> Scope:
    """What expressions may read, names before whole headers."""
    spelled = [alias(each) for each in (*table.columns, *table.written.values())]
    return Scope(names=list(dict.fromkeys(spelled)))


def _values(
    table: LogTable, where: str, expression: Expression, sources: dict[str, str]
) -> Float[np.ndarray, "rows"]:
    for column in sources.values():
        if is_text(table.columns[column]):
            raise text_error(table, column)
    values = {used: table.columns[column] for used, column in sources.items()}
    try:
        with np.errstate(all="ignore"):
            result = np.asarray(evaluate(expression.tree, values, np))
    except (ZeroDivisionError, OverflowError) as failure:
        raise InputError(f"{where}: {expression.text!r} has no value ({failure}).") from None
    if np.iscomplexobj(result):
        raise InputError(f"{where}: {expression.text!r} has no real value.")
    result = np.array(np.broadcast_to(result, table.rows.shape), dtype=np.float64)
    sampled = ~np.any([np.isnan(column) for column in values.values()], axis=0)
    _check_finite(table, where, expression.text, result, sampled)
    return np.where(sampled, result, np.nan)


def _check_finite(
    table: LogTable,
    where: str,
    text: str,
    result: Float[np.ndarray, "rows"],
    sampled: np.ndarray | np.bool_,
) -> None:
    """Where every source has a sample the result must be one; NaN would pass for "not sampled"."""
    wrong = np.flatnonzero(sampled & ~np.isfinite(result))
    if wrong.size:
        raise InputError(
            f"{where}: {text!r} is {result[wrong[0]]} in row {table.rows[wrong[0]]}; limit it, as "
            "with max(..., 0.001), or empty the cells of that row."
        )
