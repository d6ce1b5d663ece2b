"""Shapes and types of arrays, checked in every call while tests run; the rest is for pyright.

A function without an array among its annotations stays as it is, and so does a dataclass: to wrap
them all took a sixth of the time of the tests.
"""

import collections.abc
import dataclasses
import functools
from collections.abc import Callable
from types import CodeType, FunctionType
from typing import Any, get_args, get_origin

import jax
import jaxtyping
from beartype import BeartypeConf, beartype

__all__ = ["jaxtyped"]

_SCOPE = jaxtyping.jaxtyped("context")  # sizes of axes hold within one call
_CONF = BeartypeConf(violation_type=jaxtyping.TypeCheckError)
_HELD: dict[CodeType, bool] = {}
_KNOWN: dict[tuple[Any, ...], FunctionType] = {}


def jaxtyped(*, typechecker: Any) -> Callable[[Any], Any]:
    """As jaxtyping has it, whose hook puts it before every function and class."""
    del typechecker
    return _checked


def _checked(thing: Any) -> Any:
    if isinstance(thing, type):
        if dataclasses.is_dataclass(thing):
            thing.__init__ = _checked(thing.__init__)
        return thing
    return _within(thing) if isinstance(thing, FunctionType) else thing


def _within(function: FunctionType) -> Callable[..., Any]:
    if hasattr(function, "__wrapped__"):  # checked where it was written
        return function
    code, types = function.__code__, function.__annotations__.values()
    if code not in _HELD:
        _HELD[code] = any(map(_holds_arrays, types))
    if not _HELD[code]:
        return function
    key = code, *map(repr, types)
    if key not in _KNOWN:
        _KNOWN[key] = beartype(function, conf=_CONF)
    known = _KNOWN[key]
    # A function inside another is defined anew at every call: its checks are those of the first.
    defaults = {**(known.__kwdefaults__ or {}), "__beartype_func": function}
    check = FunctionType(known.__code__, known.__globals__, known.__name__, known.__defaults__)
    check.__kwdefaults__ = defaults

    @functools.wraps(function)
    def within(*args: Any, **kwargs: Any) -> Any:
        __tracebackhide__ = True
        with _SCOPE:
            return check(*args, **kwargs)

    return within


def _holds_arrays(each: Any) -> bool:
    if isinstance(each, str):
        return "[" in each and any(name in each for name in ("Float", "Int", "Bool", "Array"))
    if isinstance(each, type) and issubclass(each, (jaxtyping.AbstractArray, jax.Array)):
        return True
    # What a callable takes and gives is not looked at.
    given = () if get_origin(each) is collections.abc.Callable else get_args(each)
    return any(map(_holds_arrays, given))
