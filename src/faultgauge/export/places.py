"""Places in arrays: sums of loop variables times constants.

While a program is printed, an element of an array stands in the text as `@ARRAY:PLACE@`, since
where the array will lie is decided at the end, and loops are still merged.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

__all__ = ["ELEMENT", "Place", "linear", "strides"]

ELEMENT = re.compile(r"@(\w+):([^@]*)@")


@dataclass(frozen=True)
class Place:
    """offset + sum of factor * variable; the variables in alphabetical order, no factor 0."""

    offset: int = 0
    terms: tuple[tuple[str, int], ...] = ()

    @staticmethod
    def variable(name: str) -> "Place":
        return Place(0, ((name, 1),))

    def __add__(self, other: "Place | int") -> "Place":
        if isinstance(other, int):
            return Place(self.offset + other, self.terms)
        factors = dict(self.terms)
        for name, factor in other.terms:
            factors[name] = factors.get(name, 0) + factor
        terms = tuple(sorted((n, f) for n, f in factors.items() if f))
        return Place(self.offset + other.offset, terms)

    def __mul__(self, factor: int) -> "Place":
        if factor == 0:
            return Place()
        return Place(self.offset * factor, tuple((n, f * factor) for n, f in self.terms))

    @property
    def coded(self) -> str:
        """As it stands in an element: the offset, then factor*variable."""
        return ",".join([str(self.offset), *(f"{factor}*{name}" for name, factor in self.terms)])

    @staticmethod
    @cache
    def parsed(coded: str) -> "Place":
        offset, *terms = coded.split(",")
        pairs = (each.split("*") for each in terms)
        return Place(int(offset), tuple((name, int(factor)) for factor, name in pairs))

    @property
    def text(self) -> str:
        """In C."""
        found = ""
        for name, factor in self.terms:
            sign = (" - " if found else "-") if factor < 0 else (" + " if found else "")
            alone = len(self.terms) == 1 and self.offset == 0
            product = f"{abs(factor)} * {name}"
            found += sign + (name if abs(factor) == 1 else product if alone else f"({product})")
        if not found:
            return str(self.offset)
        if self.offset == 0:
            return found
        return f"{found} {'-' if self.offset < 0 else '+'} {abs(self.offset)}"


def strides(shape: Sequence[int]) -> list[int]:
    """Of an array whose last axis runs fastest."""
    found = [1] * len(shape)
    for k in range(len(shape) - 2, -1, -1):
        found[k] = found[k + 1] * shape[k + 1]
    return found


def linear(index: Sequence[Place], shape: Sequence[int]) -> Place:
    """The place in memory of the element at `index`."""
    at = Place()
    for each, stride in zip(index, strides(shape), strict=True):
        at = at + each * stride
    return at
