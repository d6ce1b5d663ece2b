"""beartype, once for each signature: a function inside another is defined anew at every call.

jaxtyping has signatures checked by functions without a body of their own, so that one of them
serves all functions of one place and one signature.
"""

from collections.abc import Callable
from typing import Any

from beartype import beartype

__all__ = ["checked"]

_KNOWN: dict[tuple[Any, ...], Callable[..., Any]] = {}


def checked(thing: Any) -> Any:
    """`thing` with its arguments and what it returns checked."""
    if isinstance(thing, type) or thing.__defaults__ or thing.__kwdefaults__:
        return beartype(thing)
    types = tuple(map(repr, thing.__annotations__.values()))
    key = thing.__module__, thing.__qualname__, thing.__code__, types
    if key not in _KNOWN:
        _KNOWN[key] = beartype(thing)
    return _KNOWN[key]
