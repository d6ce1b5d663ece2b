"""Windows into arrays at places that the program finds: the places, and whether they lie inside."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from faultgauge.export.constants import counting, element_of
from faultgauge.export.places import Place
from faultgauge.export.printing import Index, Printer
from faultgauge.export.program import Value
from faultgauge.export.ranges import span_of

__all__ = ["Axes", "place_of", "window"]

VIEWS_OF_ONE = ("reshape", "squeeze", "broadcast_in_dim", "expand_dims")


class Axes(NamedTuple):
    """Of an array that is read or written by windows: `mapped`, along which the windows start where
    the indices say; `dropped`, which a window does not have; `batched` with the axes `theirs` of
    the indices."""

    mapped: tuple[int, ...]
    dropped: tuple[int, ...]
    batched: tuple[int, ...]
    theirs: tuple[int, ...]

    @staticmethod
    def of(*axes: Iterable[Any]) -> "Axes":
        return Axes(*(tuple(int(a) for a in each) for each in axes))


def window(
    printer: Printer,
    value: Value,
    starts: Value,
    batch: Sequence[Place],
    inner: Sequence[Place],
    sizes: Sequence[int],
    checked: bool,
    axes: Axes,
) -> tuple[Index, list[str]]:
    """(where in `value` the element `inner` of a window lies, what must hold for it to be
    inside)."""
    rest, at, inside = iter(inner), [], []
    for d, length in enumerate(value.shape):
        place = Place()
        if d in axes.mapped:
            j = axes.mapped.index(d)
            last = length - int(sizes[d])
            which = (*batch, Place(j))
            place = place_of(printer, starts, which, last)
            if checked and not _within(starts, j, last):
                text = printer.at(starts, which)
                inside += [f"({text} >= 0)", f"({text} <= {last})"]
        if d in axes.batched:
            place = place + batch[axes.theirs[axes.batched.index(d)]]
        elif d not in axes.dropped:
            place = place + next(rest)
        at.append(place)
    return tuple(at), inside


def place_of(printer: Printer, value: Value, index: Index, last: int) -> Place:
    """The integer at `index` as a place between 0 and `last`."""
    if last <= 0:
        return Place()
    if value.array is not None:
        array = np.clip(value.array, 0, last)
        if not any(p.terms for p in index):
            return Place(int(array[tuple(p.offset for p in index)]))
        counted = counting(array)
        if counted is not None and array.ndim == len(index):
            place = Place(counted[0])
            for p, factor in zip(index, counted[1:], strict=True):
                place = place + p * factor
            return place
        text = f"(int32_t){element_of(array, printer.kind(value), index, printer.tables)}"
    elif (turn := _turn_of(value)) is not None:
        return turn
    elif _between(value, 0, last):
        text = f"(int32_t){printer.at(value, index)}"
    else:
        text = f"fg_at({printer.at(value, index)}, {last})"
        printer.helpers.add("fg_at")
    key = (id(value), (*index, Place(last)))
    for scope in printer.scopes:
        if key in scope.names:
            return Place.variable(scope.names[key])
    name = printer.name("k")
    printer.line(f"const int32_t {name} = {text};")
    printer.depth[name] = len(printer.scopes) - 1
    printer.scopes[-1].names[key] = name
    return Place.variable(name)


def _turn_of(value: Value) -> Place | None:
    """The place that a loop counts through, turn by turn, where `value` is that."""
    each = value.source
    while each is not None and each.name in ("convert_element_type", *VIEWS_OF_ONE):
        each = each.inputs[0].source
    if each is None or each.name != "turn_of" or each.inputs[0].array is None:
        return None
    counted = counting(each.inputs[0].array)
    if counted is None or len(counted) != 2:
        return None
    return each.params["turn"].params["place"] * counted[1] + counted[0]


def _within(starts: Value, j: int, last: int) -> bool:
    """Whether all places are known to lie inside."""
    if starts.array is None and starts.span is None:
        return False
    low, high = (each[..., j] for each in span_of(starts))
    return bool(np.all(low >= 0) and np.all(high <= last))


def _between(value: Value, least: int, most: int) -> bool:
    return value.span is not None and bool(
        np.all(value.span[0] >= least) and np.all(value.span[1] <= most)
    )
