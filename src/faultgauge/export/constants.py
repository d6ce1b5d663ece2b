"""An element of a constant array: a number where all are alike, an expression where they count,
else one of a table."""

import numpy as np

from faultgauge.export.elementwise import Kind, literal
from faultgauge.export.places import Place, linear
from faultgauge.export.tables import Tables

__all__ = ["counting", "element_of"]


def element_of(array: np.ndarray, kind: Kind, index: tuple[Place, ...], tables: Tables) -> str:
    """The element at `index`, as an expression."""
    for axis in range(array.ndim):  # along which all are alike
        first = np.take(array, [0], axis)
        if array.shape[axis] > 1 and _equal(array, first):
            array = first
    at = [p if n > 1 else Place() for p, n in zip(index, array.shape, strict=True)]
    if not any(p.terms for p in at):
        return literal(array[tuple(p.offset for p in at)].item(), kind, tables.single)
    counted = counting(array)
    if counted is not None:
        place = Place(counted[0])
        for p, factor in zip(at, counted[1:], strict=True):
            place = place + p * factor
        return f"({place.text})" if place.terms else place.text
    return f"@{tables.of(array, kind)}:{linear(at, array.shape).coded}@"


def _equal(array: np.ndarray, first: np.ndarray) -> bool:
    if array.dtype.kind == "f":
        return bool(np.all((array == first) | (np.isnan(array) & np.isnan(first))))
    return bool(np.all(array == first))


def counting(array: np.ndarray) -> list[int] | None:
    """[a0, a1, ...] where the integers are a0 + a1 i1 + ..."""
    if array.dtype.kind not in "iu" or array.size == 0:
        return None
    first = int(array.flat[0])
    factors = []
    for axis, length in enumerate(array.shape):
        at = [0] * array.ndim
        at[axis] = 1
        factors.append(int(array[tuple(at)]) - first if length > 1 else 0)
    expected = first + sum(
        factor * index for factor, index in zip(factors, np.indices(array.shape), strict=True)
    )
    return [first, *factors] if np.array_equal(array, expected) else None
