"""beartype, once for each signature: a function inside another is defined anew at every call.

jaxtyping has signatures checked by functions without a body of their own, so that one of them
serves all functions of one place and one signature: one that looks at the arguments, and one that
gets the result besides, as an argument that it returns. What a check looks like is told when it is
first called, as most functions are never called in a process that runs some tests of all.
"""

from collections.abc import Callable
from typing import Any

from beartype import beartype

__all__ = ["checked"]

_KNOWN: dict[tuple[Any, ...], Callable[..., Any]] = {}


def checked(thing: Any) -> Any:
    """`thing` with its arguments and what it returns checked."""
    if isinstance(thing, type):
        return beartype(thing)
    if thing.__defaults__ or thing.__kwdefaults__:
        return _Check(thing).first
    types = tuple(map(repr, thing.__annotations__.values()))
    key = thing.__module__, thing.__qualname__, thing.__code__, types
    if key not in _KNOWN:
        _KNOWN[key] = _Check(thing).first
    return _KNOWN[key]


class _Check:
    """What beartype makes of a function, once it is called."""

    def __init__(self, thing: Any) -> None:
        if _gets_the_result(thing):  # its arguments were looked at before
            told = thing.__annotations__
            thing.__annotations__ = {"return": told["return"]} if "return" in told else {}
        self.thing = thing
        self.made: Callable[..., Any] | None = None

    def first(self, *args: Any, **kwargs: Any) -> Any:
        if self.made is None:
            self.made = beartype(self.thing)
        return self.made(*args, **kwargs)


def _gets_the_result(thing: Any) -> bool:
    code = thing.__code__
    names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    last = names[-1] if code.co_kwonlyargcount else ""
    return last.startswith("ret") and last[3:].isdigit() and thing.__annotations__[last] is Any
