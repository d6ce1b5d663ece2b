"""Places in arrays: sums of loop variables times constants."""

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Place", "linear", "strides"]


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
    def text(self) -> str:
        """In C."""
        found = ""
        for name, factor in self.terms:
            sign = (" - " if found else "-") if factor < 0 else (" + " if found else "")
            found += f"{sign}{name}" if abs(factor) == 1 else f"{sign}{abs(factor)} * {name}"
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
