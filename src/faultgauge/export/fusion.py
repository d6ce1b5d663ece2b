"""Which arrays are kept in memory, and which are computed where they are read.

An array is computed anew for every reader where that costs less than storing and loading it; read
once, it never needs memory of its own, so that a chain of elementwise operations becomes one loop.
"""

from collections import defaultdict
from math import prod

from faultgauge.export.program import OpBlock, Operation, Program

__all__ = ["FUNCTIONS", "VIEWS", "kept_values", "ordered_values", "reorders", "whole"]

VIEWS = {
    "broadcast_in_dim", "slice", "transpose", "squeeze", "expand_dims", "rev", "dynamic_slice",
    "gather", "reshape", "turn_of", "concatenate",
}  # fmt: skip
SOUGHT = {"dynamic_slice", "gather", "turn_of"}  # views of places that the program finds
WHOLE = {
    "stack", "pad", "scatter", "scatter-add", "scatter-mul", "scatter-min",
    "scatter-max", "dynamic_update_slice", "cumsum", "cumprod", "cummax", "cummin", "sort",
    "cond", "scan",
}  # fmt: skip
DEAR = {"div": 4.0, "sqrt": 4.0, "rsqrt": 8.0, "integer_pow": 2.0}
FUNCTIONS = {
    "exp", "log", "log1p", "expm1", "tanh", "erf", "erfc", "erf_inv", "logistic", "pow", "sin",
    "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "exp2", "cbrt",
}  # fmt: skip
PARTS = 3  # at most, that are read where they are, without being joined,
LARGE = 512  # where joining takes longer than a loop that is cut
MANY = 32  # calls of a function from which on their vector is worth its memory
CHEAP = {"neg", "not", "convert_element_type", "select_n", "is_finite"}


def whole(each: Operation) -> bool:
    """Whether the result is in memory, written part by part."""
    if each.name != "concatenate":
        return each.name in WHOLE
    return len(each.inputs) > PARTS or each.outputs[0].size < LARGE


def kept_values(program: Program) -> set[int]:
    """The ids of the values that get memory (or, where they are scalars, a variable)."""
    cost: dict[int, float] = {}
    joined: set[int] = set()  # what reads parts of several arrays, which a loop must know
    dear: set[int] = set()  # what calls a function
    _costs(program.body, cost, joined, dear)
    kept: set[int] = set()
    # how often each value is computed, by where: once per place, however many read it there
    reads: dict[int, dict[tuple[int, ...], float]] = defaultdict(dict)
    _decide(program.body, 1.0, cost, kept, reads, joined, dear)
    return kept


def ordered_values(program: Program) -> set[int]:
    """The ids of the values whose last axis must run fastest in memory: some reshape takes their
    elements in that order, or they are written part by part."""
    found: set[int] = set()
    _ordered(program.body, found)
    return found


def _ordered(block: OpBlock, found: set[int]) -> None:
    for each in block.operations:
        if reorders(each):
            found.add(id(each.inputs[0]))
        if whole(each) and each.name not in ("concatenate", "stack"):
            found |= {id(v) for v in each.outputs}
        for inner in each.blocks:
            _ordered(inner, found)


def _costs(block: OpBlock, cost: dict[int, float], joined: set[int], dear: set[int]) -> None:
    """Of one element, in additions; what it reads costs a load at most, since it will be kept where
    it costs more."""
    for each in block.operations:
        for inner in each.blocks:
            _costs(inner, cost, joined, dear)
        inputs = {id(v): v for v in each.inputs if not v.known}
        reads = [min(cost.get(key, 1.0), 1.0) for key in inputs]
        below = max(reads, default=0.0) if each.name == "concatenate" else sum(reads)
        for out in each.outputs:
            cost[id(out)] = 1.0 if whole(each) else _own(each) + below * _turns(each)
            if not whole(each) and (each.name == "concatenate" or not joined.isdisjoint(inputs)):
                joined.add(id(out))
            calls = each.name in FUNCTIONS or not dear.isdisjoint(inputs)
            if calls and not whole(each) and not _gathers(each):
                dear.add(id(out))


def _own(each: Operation) -> float:
    if each.name in VIEWS:
        return 0.0
    if each.name in FUNCTIONS:
        return 20.0
    if each.name in CHEAP:
        return 0.5
    return DEAR.get(each.name, 1.0) * _turns(each)


def _gathers(each: Operation) -> bool:
    """Whether an element takes many elements of another array."""
    reduces = each.name.startswith(("reduce_", "argm")) and each.name != "reduce_precision"
    return reduces or each.name == "dot_general"


def _turns(each: Operation) -> float:
    """Elements that one element of the output takes."""
    if each.name == "dot_general":
        (lhs, _), _ = each.params["dimension_numbers"]
        return float(prod(each.inputs[0].shape[k] for k in lhs))
    if _gathers(each):
        return each.inputs[0].size / max(each.outputs[0].size, 1)
    return 1.0


def _decide(
    block: OpBlock,
    times: float,
    cost: dict[int, float],
    kept: set[int],
    reads: dict[int, dict[tuple[int, ...], float]],
    joined: set[int],
    dear: set[int],
) -> None:
    """From the end to the beginning, since what is kept depends on who reads it."""
    called: set[int] = set()  # what a loop reads that calls a function
    for out in block.outputs:
        kept.add(id(out))
    for each in reversed(block.operations):
        if each.name in ("cond", "scan"):
            for v in each.inputs:
                kept.add(id(v))
            for inner in each.blocks:
                _decide(
                    inner, times * each.params.get("length", 1), cost, kept, reads, joined, dear
                )
            continue
        if each.name == "sort":
            kept |= {id(v) for v in each.outputs}
        out = each.outputs[0]
        places = reads[id(out)]
        total, once = sum(places.values()), out.size * times
        spared = cost[id(out)] * (total - once)
        if whole(each) or spared > (0.0 if out.shape == () else total + once):
            kept.add(id(out))
        _apart(each, kept, called, dear)
        if id(out) in kept:
            places = {(id(out),): once}
        if reorders(each) or (each.name in SOUGHT and id(each.inputs[0]) in joined):
            kept.add(id(each.inputs[0]))
        turns = _turns(each)
        for k, v in enumerate(each.inputs):
            elementwise = each.name not in VIEWS and not whole(each) and turns == 1.0
            for place, count in places.items():
                at = place if elementwise and v.shape == out.shape else (*place, id(each), k)
                if whole(each):
                    count = v.size * times
                elif each.name == "concatenate":
                    count = count * v.size / out.size
                reads[id(v)][at] = max(count * turns, reads[id(v)].get(at, 0.0))


def _apart(each: Operation, kept: set[int], called: set[int], dear: set[int]) -> None:
    """Keep apart what compilers make vectors of and what not: functions from sums, and what is
    looked up from functions, where `called` are what a loop reads that calls one."""
    out = each.outputs[0]
    if each.name in SOUGHT and id(out) in called and out.size >= MANY:
        kept.add(id(out))
    if each.name in FUNCTIONS or (id(out) in called and id(out) not in kept):
        called |= {id(v) for v in each.inputs}
    if _gathers(each):
        kept |= {id(v) for v in each.inputs if id(v) in dear and v.size >= MANY}


def reorders(each: Operation) -> bool:
    """Whether a reshape does more than add or drop axes of length 1."""
    if each.name != "reshape":
        return False
    before = [n for n in each.inputs[0].shape if n != 1]
    return before != [n for n in each.outputs[0].shape if n != 1]
