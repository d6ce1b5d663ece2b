"""The user's TOML files: read, typed by pydantic, and every mistake answered by its key."""

import io
import re
import reprlib
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

import pydantic

from faultgauge.errors import InputError
from faultgauge.files import read_within
from faultgauge.plants.expression import unknown

__all__ = ["Number", "Positive", "SchemaTable", "parse_toml", "read_text", "typed", "values_in"]

MAX_BYTES = 1_000_000  # of a plant file or scenario

LEAST, LARGEST = 1e-50, 1e50  # of a number that is not 0: squares and ratios are numbers too
MOST_DOTS = re.compile(r"""(?<![\w'"-])(?:[\w'"-]++[ \t]*+\.[ \t]*+){20}""")
AT_LINE = re.compile(r"at line (\d+)")
READABLE = 100  # characters of a line that is shown


def _sensible(value: float) -> float:
    if value and not LEAST <= abs(value) <= LARGEST:
        raise ValueError(f"should be 0 or of a size between {LEAST:g} and {LARGEST:g}")
    return value


Number = Annotated[float, pydantic.Field(allow_inf_nan=False), pydantic.AfterValidator(_sensible)]
Positive = Annotated[Number, pydantic.Field(gt=0)]


class SchemaTable(pydantic.BaseModel):
    """A table of the schema: its keys and their types; unknown keys are refused."""

    model_config = pydantic.ConfigDict(extra="forbid", strict=True)


T = TypeVar("T", bound=SchemaTable)


def read_text(path: Path, kind: str, advice: str) -> str:
    """Text of a file of the user's; `kind` is what it should be, `advice` what to give instead."""
    try:
        data = read_within(path, MAX_BYTES, f"which no {kind} does; check the path")
        return io.TextIOWrapper(io.BytesIO(data), "utf-8-sig").read()
    except UnicodeDecodeError:
        raise InputError(
            f"{path}: not a text file; a {kind} is TOML in UTF-8 (did you pass a log or a "
            "fitted model?)."
        ) from None
    except OSError as failure:
        raise InputError(f"{path}: cannot be read ({failure.strerror}); {advice}.") from None


def _line(text: str, failure: Exception) -> str:
    """The line of `text` that a `failure` names, as far as it is one to be read."""
    place = AT_LINE.search(str(failure))
    line = text.split("\n")[int(place[1]) - 1].strip() if place else ""
    return f", in {line!r}" if 0 < len(line) <= READABLE and line.isprintable() else ""


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """The tables of a TOML text."""
    found = MOST_DOTS.search(text)
    if found:  # of which TOML's parser takes the square in time
        raise InputError(f"{source}: {found[0][:40]!r}... has more than 20 parts; no key has.")
    try:
        tables = tomllib.loads(text)
    except (ValueError, RecursionError) as failure:  # ValueError: also a number of 5000 digits
        raise InputError(f"{source}: not valid TOML: {failure}{_line(text, failure)}.") from None
    for (*places, key), value in values_in(tables):
        if isinstance(value, int) and value.bit_length() > 63:
            digits = str(value) if value.bit_length() < 10_000 else hex(value)
            place = f"[{'.'.join(places)}] " if places else ""
            raise InputError(
                f"{source}: {place}{key} = {digits[:20]}...: a whole number of more than 63 bits; "
                "give a smaller one, or write it as 1e20."
            )
    return tables


def values_in(tree: Any, place: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """(keys, value) of everything in what TOML holds that is no table; lists are their items."""
    if isinstance(tree, dict):
        for key, each in tree.items():
            yield from values_in(each, (*place, key))
    elif isinstance(tree, list):
        for each in tree:
            yield from values_in(each, place)
    else:
        yield place, tree


def typed(
    model: type[T],
    data: Mapping[str, Any],
    source: str,
    *,
    also: Sequence[str] = (),
) -> T:
    """`data` as `model`. Raises `InputError` that begins with `source` and names the key.

    `also` are keys that are legal beside those of `model` and were taken out before.
    """
    try:
        return model.model_validate(data)
    except pydantic.ValidationError as failure:
        raise InputError(f"{source}: {_first(failure, model, also)}") from None


def _first(
    failure: pydantic.ValidationError,
    model: type[SchemaTable],
    also: Sequence[str],
) -> str:
    """The first thing wrong, as one sentence."""
    # a misspelt key also leaves the right one missing: speak of what was written
    error = min(failure.errors(), key=lambda each: each["type"] != "extra_forbidden")
    path = _path(error["loc"])
    if not path:
        return f"{error['msg'].removeprefix('Value error, ')}."
    *tables, key = path
    place = f"[{'.'.join(tables)}] " if tables else ""
    legal = [*also, *_legal(model, tables)]
    match error["type"]:
        case "extra_forbidden":
            return f"{place}{unknown('key', key, legal)}; correct or remove it."
        case "missing":
            return f"{place}key {key!r} is missing; add it (legal here: {', '.join(legal)})."
        case _:
            message = "should be a table of keys"
            if error["type"] not in ("model_type", "dict_type"):
                message = error["msg"].replace("Input should be", "should be")
                message = message.removeprefix("Value error, ")
                message = message.replace("a valid integer", "a whole number")
                message = message.replace("valid ", "")
            return f"{place}{key} = {reprlib.repr(error['input'])}: {message}."


def _path(location: tuple[int | str, ...]) -> list[str]:
    """Keys from the outermost table on; an item of a list belongs to its key: `times[1]`."""
    path: list[str] = []
    for part in location:
        if isinstance(part, int):
            path[-1] += f"[{part}]"
        else:
            path.append(part)
    return path


def _legal(model: type[SchemaTable], tables: Sequence[str]) -> list[str]:
    """Keys of the table that `tables` leads to: through fields, and through dicts of tables."""
    kind: Any = model
    for key in tables:
        is_table = isinstance(kind, type) and issubclass(kind, SchemaTable)
        kind = kind.model_fields[key].annotation if is_table else get_args(kind)[-1]
    return (
        list(kind.model_fields) if isinstance(kind, type) and issubclass(kind, SchemaTable) else []
    )
