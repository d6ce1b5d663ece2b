"""Operations that read elements elsewhere, and compute nothing."""

from itertools import accumulate

from faultgauge.export.elementwise import FLOATS
from faultgauge.export.fusion import reorders
from faultgauge.export.places import Place, linear
from faultgauge.export.printing import Cut, Index, Printer
from faultgauge.export.program import Operation
from faultgauge.export.windows import Axes, place_of, window

__all__ = ["VIEWS"]


def _broadcast(printer: Printer, each: Operation, index: Index) -> str:
    value = each.inputs[0]
    at = tuple(
        index[d] if value.shape[k] > 1 else Place()
        for k, d in enumerate(each.params["broadcast_dimensions"])
    )
    return printer.at(value, at)


def _slice(printer: Printer, each: Operation, index: Index) -> str:
    starts = each.params["start_indices"]
    steps = each.params["strides"] or [1] * len(starts)
    return printer.at(
        each.inputs[0],
        tuple(p * int(n) + int(s) for p, s, n in zip(index, starts, steps, strict=True)),
    )


def _transpose(printer: Printer, each: Operation, index: Index) -> str:
    at = [Place()] * len(index)
    for k, axis in enumerate(each.params["permutation"]):
        at[axis] = index[k]
    return printer.at(each.inputs[0], tuple(at))


def _reshape(printer: Printer, each: Operation, index: Index) -> str:
    value = each.inputs[0]
    if reorders(each):
        return printer.load(printer.held[id(value)], linear(index, each.outputs[0].shape))
    long = iter(p for p, n in zip(index, each.outputs[0].shape, strict=True) if n != 1)
    return printer.at(value, tuple(Place() if n == 1 else next(long) for n in value.shape))


def _reverse(printer: Printer, each: Operation, index: Index) -> str:
    value = each.inputs[0]
    turned = each.params["dimensions"]
    at = [p * -1 + (value.shape[k] - 1) if k in turned else p for k, p in enumerate(index)]
    return printer.at(value, tuple(at))


def _turn(printer: Printer, each: Operation, index: Index) -> str:
    return printer.at(each.inputs[0], (each.params["turn"].params["place"], *index))


def _joined(printer: Printer, each: Operation, index: Index) -> str:
    """One of the parts; where a loop runs through more of them, it is cut."""
    axis = int(each.params["dimension"])
    place = index[axis]
    ends = list(accumulate(v.shape[axis] for v in each.inputs))
    least = place.offset
    if place.terms:
        ((name, factor),) = place.terms
        span = printer.spans[name]
        least += min(0, factor * (span.length - 1))
        for end in ends[:-1]:  # the first turn that has passed it, forwards or back
            turn = (
                -((place.offset - end) // factor)
                if factor > 0
                else (end - place.offset) // factor + 1
            )
            if 0 < turn < span.length:
                raise Cut(span.over, span.first + turn)
    part = next(k for k, end in enumerate(ends) if least < end)
    start = ends[part] - each.inputs[part].shape[axis]
    return printer.at(each.inputs[part], (*index[:axis], place + -start, *index[axis + 1 :]))


def _dynamic(printer: Printer, each: Operation, index: Index) -> str:
    value, starts = each.inputs[0], each.inputs[1:]
    sizes = each.params["slice_sizes"]
    at = [
        p + place_of(printer, s, (), n - size)
        for p, s, n, size in zip(index, starts, value.shape, sizes, strict=True)
    ]
    return printer.at(value, tuple(at))


def _gathered(printer: Printer, each: Operation, index: Index) -> str:
    value, starts = each.inputs
    numbers = each.params["dimension_numbers"]
    sizes = each.params["slice_sizes"]
    batch = [p for d, p in enumerate(index) if d not in numbers.offset_dims]
    inner = [index[d] for d in numbers.offset_dims]
    fill = "FILL" in str(each.params["mode"])
    axes = Axes.of(
        numbers.start_index_map,
        numbers.collapsed_slice_dims,
        numbers.operand_batching_dims,
        numbers.start_indices_batching_dims,
    )
    at, inside = window(printer, value, starts, batch, inner, sizes, fill, axes)
    text = printer.at(value, at)
    if inside:
        kind = printer.kind(value)
        empty = "NAN" if kind in FLOATS else "0"
        text = f"({' && '.join(inside)} ? {text} : {empty})"
    return text


VIEWS = {
    "broadcast_in_dim": _broadcast,
    "slice": _slice,
    "transpose": _transpose,
    "reshape": _reshape,
    "squeeze": _reshape,
    "expand_dims": _reshape,
    "rev": _reverse,
    "turn_of": _turn,
    "concatenate": _joined,
    "dynamic_slice": _dynamic,
    "gather": _gathered,
}
