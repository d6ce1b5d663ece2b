"""Between which numbers integers and truth values of a program lie, whatever it is given.

An index that lies inside of its array needs no limit and no other case, and a condition that is
always so no other way: code that nobody can run is in nobody's way, but in the way of who must show
that it was tested. What comes from outside, a state that was restored too, may be any number.
"""

from collections.abc import Callable
from itertools import count
from typing import Any

import numpy as np

from faultgauge.export.program import OpBlock, Operation, Program, Value, tidy

__all__ = ["narrowed", "span_of"]

ROUNDS = 3  # turns of a loop, after which what still grows may be any number
Span = tuple[Any, Any]  # the least and the most of every element, or of one without axes
COMPARED: dict[str, Callable] = {"lt": np.less, "le": np.less_equal, "eq": np.equal}
TURNED = {"gt": "lt", "ge": "le"}
SAME_SHAPE = {"reshape", "squeeze", "expand_dims"}
MOVED = {
    "transpose", "rev", "dynamic_slice", "turn_of", "reduce_max", "reduce_min", "reduce_and",
    "reduce_or", "cummax", "cummin", "slice",
}  # fmt: skip
PUT = {"scatter", "dynamic_update_slice"}  # the first operand, and some elements of another


def narrowed(program: Program) -> None:
    """Put constants to where only one number can be, tell every value its `span`, and drop what
    is no more needed."""
    while True:
        _block(program.body)
        before = _count(program.body)
        tidy(program.body)
        if _count(program.body) == before:
            return


def _count(block: OpBlock) -> int:
    return sum(1 + sum(map(_count, each.blocks)) for each in block.operations)


def _block(block: OpBlock) -> None:
    for each in block.operations:
        if each.name == "scan":
            _scan(each)
        elif each.name == "cond":
            for inner in each.blocks:
                _block(inner)
            for k, out in enumerate(each.outputs):
                out.span = _union(out, [inner.outputs[k] for inner in each.blocks])
        elif each.outputs[0].dtype.kind in "iub":
            for out in each.outputs:
                _told(out, each)
        elif each.outputs[0].dtype.kind == "f":
            out = each.outputs[0]
            out.span = (np.zeros(out.shape), np.zeros(out.shape)) if _naught(each) else None


def _told(out: Value, each: Operation) -> None:
    whole = span_of(Value(out.shape, out.dtype))
    low, high = _found(each, out) or whole
    low, high = (np.broadcast_to(a, out.shape) for a in (low, high))
    inside = bool(np.all(low >= whole[0]) and np.all(high <= whole[1]))  # else it may wrap around
    out.span = (low, high) if inside else whole
    if inside and out.array is None and np.array_equal(low, high):
        out.array, out.known = low.astype(out.dtype), True


def _scan(each: Operation) -> None:
    body = each.blocks[0]
    carries = len(body.carries)
    for carry, start in zip(body.carries, each.inputs, strict=True):
        carry.span = span_of(start) if carry.dtype.kind in "iub" else None
    for turn in count():
        wider = False
        _forget(body)
        _block(body)
        for carry, after in zip(body.carries, body.outputs[:carries], strict=True):
            new = _union(carry, [carry, after])
            if carry.dtype.kind in "iub" and not all(map(np.array_equal, new, span_of(carry))):
                carry.span, wider = new if turn < ROUNDS else None, True
        if not wider:
            break
    for out, carry in zip(each.outputs, body.carries, strict=False):
        out.span = span_of(carry)
    for out, value in zip(each.outputs[carries:], body.outputs[carries:], strict=True):
        low, high = span_of(value)
        out.span = np.broadcast_to(low, out.shape), np.broadcast_to(high, out.shape)


def _forget(block: OpBlock) -> None:
    """What was found in an earlier turn, in which carries were narrower."""
    for each in block.operations:
        for out in each.outputs:
            if out.span is not None:
                out.span = out.array = None
                out.known = False
        for inner in each.blocks:
            _forget(inner)


def span_of(value: Value) -> Span:
    """What is known of it; infinite for real numbers, but for those that are 0 or no number."""
    if value.array is not None and value.dtype.kind in "iub":
        array = value.array.astype(float)
        return array, array
    if value.span is not None:
        return value.span
    if value.dtype.kind == "b":
        low, high = 0.0, 1.0
    elif value.dtype.kind in "iu":
        limits = np.iinfo(value.dtype)
        low, high = float(limits.min), float(limits.max)
    else:
        low, high = -np.inf, np.inf
    return np.full(value.shape, low), np.full(value.shape, high)


def _union(out: Value, values: "list[Value]") -> Span:
    """Of all elements of `values` of the shape of `out`, else of the least and most of all."""
    spans = [span_of(each) for each in values]
    if all(each.shape == out.shape for each in values):
        return np.min([s[0] for s in spans], axis=0), np.max([s[1] for s in spans], axis=0)
    low, high = min(s[0].min() for s in spans), max(s[1].max() for s in spans)
    return np.full(out.shape, low), np.full(out.shape, high)


def _found(each: Operation, out: Value) -> Span | None:
    """Of the result of an operation; None: of any number."""
    name, given = each.name, each.inputs
    if any(v.size == 0 for v in given):
        return None
    if name in ("argmax", "argmin"):
        (axis,) = each.params["axes"]
        return np.zeros(out.shape), np.full(out.shape, given[0].shape[axis] - 1.0)
    if name in COMPARED or name in TURNED or name == "ne":
        return _compared(name, given, out)
    if name in ("and", "or", "not", "xor") and out.dtype.kind != "b":
        return None
    if name in MOVED:
        return _union(out, given[:1])
    if name in PUT:
        return _union(out, [given[0], given[2 if name == "scatter" else 1]])
    if name == "gather":
        return _union(out, given[:1]) if inside(each) else None
    if name == "broadcast_in_dim":
        return _broadcast(each, out)
    if name in SAME_SHAPE:
        low, high = span_of(given[0])
        return low.reshape(out.shape), high.reshape(out.shape)
    if name in ("concatenate", "stack"):
        join = np.concatenate if name == "concatenate" else np.stack
        axis = int(each.params["dimension" if name == "concatenate" else "axis"])
        low, high = (join([span_of(v)[k] for v in given], axis=axis) for k in (0, 1))
        return low, high
    return _computed(name, [span_of(v) for v in given], each, out)


def _computed(name: str, spans: "list[Span]", each: Operation, out: Value) -> Span | None:
    """Of sums, products and choices, element by element."""
    (a, b), *others = spans
    c, d = others[0] if others else (a, b)
    match name:
        case "add":
            return a + c, b + d
        case "sub":
            return a - d, b - c
        case "mul":
            ends = np.array([a * c, a * d, b * c, b * d])
            return ends.min(axis=0), ends.max(axis=0)
        case "max" | "or":
            return np.maximum(a, c), np.maximum(b, d)
        case "min" | "and":
            return np.minimum(a, c), np.minimum(b, d)
        case "not":
            return 1 - b, 1 - a
        case "abs":
            return np.maximum(np.maximum(a, -b), 0.0), np.maximum(-a, b)
        case "sign":
            return np.sign(a), np.sign(b)
        case "clamp":
            (low, up) = others[1]
            return np.minimum(np.maximum(a, c), low), np.minimum(np.maximum(b, d), up)
        case "rem" if np.all(a >= 0) and np.all(c > 0):
            return np.where(b < c, a, 0.0), np.minimum(b, d - 1)
        case "div" if np.all(a >= 0) and np.all(c > 0):
            return np.floor(a / d), np.floor(b / c)
        case "convert_element_type" if each.inputs[0].dtype.kind in "iub":
            one = out.dtype.kind == "b"
            return (
                (np.minimum(np.abs(a), 1.0), np.minimum(b, 1.0))
                if one and np.all(a >= 0)
                else (None if one else (a, b))
            )
        case "reduce_sum":
            axes = tuple(int(k) for k in each.params["axes"])
            return a.sum(axis=axes), b.sum(axis=axes)
        case "select_n":
            others = [_if_chosen(each, k, span) for k, span in enumerate(others)]
            cases = [
                (np.broadcast_to(x, out.shape), np.broadcast_to(y, out.shape)) for x, y in others
            ]
            low, high = (np.broadcast_to(x, out.shape) for x in (a, b))
            can = [(low <= k) & (k <= high) for k in range(len(cases))]
            pairs = [*zip(can, cases, strict=True)]
            return (
                np.min([np.where(ok, x, np.inf) for ok, (x, _) in pairs], axis=0),
                np.max([np.where(ok, y, -np.inf) for ok, (_, y) in pairs], axis=0),
            )
    return None


def _if_chosen(each: Operation, case: int, span: Span) -> Span:
    """That of a case of a choice by a comparison of integers `v < limit`, and the like, where the
    case is v itself or v and a constant: v is then on that side of the limit."""
    test, given = each.inputs[0].source, each.inputs[1 + case]
    if test is None or test.name not in ("lt", "le", "gt", "ge"):
        return span
    v, limit = test.inputs
    if v.dtype.kind not in "iu" or limit.array is None:
        return span
    low, high = span_of(v)
    edge, under = limit.array.astype(float), (test.name in ("lt", "le")) == bool(case)
    closed = (test.name in ("le", "ge")) == bool(case)
    if under:
        high = np.minimum(high, edge if closed else edge - 1)
    else:
        low = np.maximum(low, edge if closed else edge + 1)
    if given is v:
        return low, high
    made = given.source
    if made is None or made.name not in ("add", "sub") or made.inputs[0] is not v:
        return span
    other = made.inputs[1].array
    if other is None:
        return span
    by = other.astype(float) * (1 if made.name == "add" else -1)
    return low + by, high + by


def _naught(each: Operation) -> bool:
    """Whether all of a real result is 0 or no number, whatever else goes in."""

    def zero(value: Value) -> bool:
        if value.array is not None:
            return bool(np.all(value.array == 0))
        low, high = span_of(value)
        return bool(np.all(low == 0) and np.all(high == 0))

    given = each.inputs
    if not given or any(v.size == 0 for v in given):
        return False
    match each.name:
        case "mul":
            return any(map(zero, given))
        case "sub" if given[0].array is not None and given[1].array is not None:
            return bool(np.all(given[0].array == given[1].array))
        case "add" | "sub" | "concatenate" | "stack":
            return all(map(zero, given))
        case "select_n":
            return all(map(zero, given[1:]))
        case "div" | "neg" | "reduce_sum" | "broadcast_in_dim" | "convert_element_type":
            return zero(given[0])
        case "gather" if each.params.get("fill_value") is None:
            return zero(given[0])
    return each.name in (SAME_SHAPE | MOVED) - {"turn_of"} and zero(given[0])


def _compared(name: str, given: "list[Value]", out: Value) -> Span | None:
    """Of a comparison. Nothing is above infinity; for all else of real numbers, which may be none,
    it may go either way."""
    if name in TURNED:
        name, given = TURNED[name], given[::-1]
    left, right = given
    never = np.zeros(out.shape)
    if left.dtype.kind == "f":
        above = left.array is not None and bool(np.all(np.isposinf(left.array)))
        below = right.array is not None and bool(np.all(np.isneginf(right.array)))
        (a, b), (c, d) = (_known(v) for v in given)
        apart = bool(np.all(a >= d))  # no number is below none either
        return (never, never) if name == "lt" and (above or below or apart) else None
    (a, b), (c, d) = span_of(left), span_of(right)
    apart = (b < c) | (d < a)
    if name in ("eq", "ne"):
        alike = (a == b) & (c == d) & (a == c)
        low, high = alike.astype(float), 1.0 - apart
        return (low, high) if name == "eq" else (1.0 - high, 1.0 - low)
    holds = COMPARED[name]
    low, high = holds(b, c).astype(float), holds(a, d).astype(float)
    return np.broadcast_to(low, out.shape), np.broadcast_to(high, out.shape)


def _known(value: Value) -> Span:
    """What is known of real numbers, but that they may be none."""
    return span_of(value) if value.array is None else (value.array, value.array)


def _broadcast(each: Operation, out: Value) -> Span:
    shape = [1] * len(out.shape)
    for k, d in enumerate(each.params["broadcast_dimensions"]):
        shape[d] = each.inputs[0].shape[k]
    low, high = (np.broadcast_to(a.reshape(shape), out.shape) for a in span_of(each.inputs[0]))
    return low, high


def inside(each: Operation) -> bool:
    """Whether all that a `gather` reads lies inside."""
    value, starts = each.inputs
    mapped = each.params["dimension_numbers"].start_index_map
    sizes = each.params["slice_sizes"]
    last = np.array([value.shape[d] - int(sizes[d]) for d in mapped], float)
    low, high = span_of(starts)
    return bool(np.all(low >= 0) and np.all(high <= last))
