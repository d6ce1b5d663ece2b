"""The tables of a plant file as its text."""

import json
import math
from collections.abc import Mapping
from typing import Any

from faultgauge.errors import InputError

__all__ = ["toml_text"]


def toml_text(tables: Mapping[Any, Any]) -> str:
    """A plant file of the same content: values first, then a section per table. Raises
    `InputError` for what no plant file holds."""
    lines = [
        f"{_key(key)} = {_value(value, key)}"
        for key, value in tables.items()
        if not isinstance(value, Mapping)
    ]
    for key, table in tables.items():
        if isinstance(table, Mapping):
            lines += ["", f"[{_key(key)}]"]
            lines += [f"{_key(name)} = {_value(value, key)}" for name, value in table.items()]
    return "\n".join(lines) + "\n"


def _key(name: Any) -> str:
    return json.dumps(str(name), ensure_ascii=False)


def _value(value: Any, key: Any) -> str:
    if isinstance(value, Mapping):
        inner = ", ".join(f"{_key(name)} = {_value(each, name)}" for name, each in value.items())
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(each, key) for each in value)}]"
    if isinstance(value, str | bool):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, int):
        return str(value)
    try:
        number = float(value)  # NumPy's numbers too
    except (TypeError, ValueError):
        raise InputError(
            f"the plant's dict, {key}: a {type(value).__name__} is neither a number, a text nor a "
            "table of them; correct it."
        ) from None
    return repr(number) if math.isfinite(number) else str(number)
