"""beartype, once for each signature: a function inside another is defined anew at every call.

jaxtyping has signatures checked by functions without a body of their own, so that one of them
serves all functions of one place and one signature: one that looks at the arguments, and one that
gets the result besides, as an argument that it returns. What a check looks like is told when it is
first called, as most functions are never called in a process that runs some tests of all.
Functions that say nothing of arrays have no shapes to remember, and are checked without jaxtyping,
which binds all arguments anew for every call.
"""

import inspect
from collections.abc import Callable
from functools import partial, wraps
from types import CodeType, FunctionType
from typing import Any

from beartype import beartype
from jaxtyping import jaxtyped
from jaxtyping._decorator import _make_fn_with_signature

__all__ = ["checked", "quickly_typed"]

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


def quickly_typed(thing: Any = None, *, typechecker: Any = None) -> Any:
    """In place of `jaxtyping.jaxtyped`."""
    if thing is None:
        return partial(quickly_typed, typechecker=typechecker)
    if type(thing) is not FunctionType:
        return jaxtyped(thing, typechecker=typechecker)
    told = thing.__annotations__
    known = _PLAIN.get(id(thing.__code__))
    if known is None or known.told != told:
        known = _PLAIN[id(thing.__code__)] = _Plain(thing)
    return known.around(thing) if known.plain else jaxtyped(thing, typechecker=typechecker)


class _Plain:
    """What is looked at in all functions of one place that say nothing of arrays."""

    def __init__(self, thing: FunctionType) -> None:
        self.code: CodeType = thing.__code__  # kept, as its number is the key
        self.told = dict(thing.__annotations__)
        yields = inspect.isgeneratorfunction(thing) or inspect.iscoroutinefunction(thing)
        said = self.told.values()
        self.plain = not yields and not any(
            isinstance(each, str) or "jaxtyping" in repr(each) for each in said
        )
        if self.plain:
            signature = inspect.signature(thing).replace(return_annotation=Any)
            names = thing.__name__, thing.__qualname__, thing.__module__
            given = _make_fn_with_signature(*names, signature, output=False)
            self.given, self.gives = _Check(given), _Check(_result(thing))

    def around(self, thing: FunctionType) -> Callable[..., Any]:
        given, gives = self.given.first, self.gives.first
        if not self.told:
            return thing

        @wraps(thing)
        def called(*args: Any, **kwargs: Any) -> Any:
            __tracebackhide__ = True
            given(*args, **kwargs)
            return gives(thing(*args, **kwargs))

        return called


_PLAIN: dict[int, _Plain] = {}


def _result(thing: FunctionType) -> FunctionType:
    """Gives what it is given, which is what `thing` says that it gives."""

    def result(given):
        return given

    told = thing.__annotations__
    result.__annotations__ = {"return": told["return"]} if "return" in told else {}
    result.__module__, result.__qualname__ = thing.__module__, thing.__qualname__
    return result
