"""How logs are read: what every verb that reads some takes beside its own arguments."""

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import wraps
from typing import Any, ParamSpec, TypeAlias, TypedDict, TypeVar

__all__ = ["How", "Maps", "Reading", "reads"]

Maps: TypeAlias = str | Iterable[str] | Mapping[str, str] | None
P = ParamSpec("P")
T = TypeVar("T")


class Reading(TypedDict, total=False):
    """The options of reading, as keyword arguments (`read` says what they mean)."""

    time: str | None
    time_format: str | None
    map: Maps
    where: str | None
    resample: float | None


@dataclass(frozen=True)
class How:
    """How logs are read: the name of the time column and how time is written, maps NAME=EXPRESSION
    (or a dict of them), a condition on rows, the rate [Hz] that they are brought to."""

    time: str | None = None
    time_format: str | None = None
    map: Maps = None
    where: str | None = None
    resample: float | None = None

    @property
    def said(self) -> dict[str, Any]:
        """What a model remembers of it for logs to come; no more than was said."""
        every = {"time": self.time, "time_format": self.time_format, "maps": self.maps}
        return {name: value for name, value in every.items() if value}

    @property
    def maps(self) -> list[str]:
        if self.map is None:
            return []
        if isinstance(self.map, str):
            return [self.map]
        if isinstance(self.map, Mapping):
            return [f"{name}={text}" for name, text in self.map.items()]
        return list(self.map)


def reads(verb: Callable[P, T]) -> Callable[P, T]:
    """`verb`, whose last argument is `**reading`: `help` and notebooks show every option of it, and
    a misspelt one is refused in the verb's name."""
    shown = inspect.signature(verb)
    own = list(shown.parameters.values())[:-1]
    options = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)
        for name, kind in Reading.__annotations__.items()
    ]
    whole = shown.replace(parameters=[*own, *options])

    @wraps(verb)
    def named(*args: P.args, **kwargs: P.kwargs) -> T:
        strange = next((each for each in kwargs if each not in whole.parameters), None)
        if strange is not None:
            raise TypeError(f"{verb.__name__}() got an unexpected keyword argument {strange!r}")
        return verb(*args, **kwargs)

    named.__signature__ = whole  # pyright: ignore[reportAttributeAccessIssue]
    return named
