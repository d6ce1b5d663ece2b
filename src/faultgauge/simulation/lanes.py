"""A function of one unit as a function of many, which stand last in every array.

`jax.vmap` puts them first, and the loops of small matrices that XLA makes of it run over columns of
three or thirteen, a number at a time. With the units last the innermost loop runs over them, and is
vector code. Arrays stay arrays, so that programs stay short, unlike those of `side_by_side`, which
writes out every number; the mathematics is the function's own.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, Literal
from jaxtyping import Array, Int

from faultgauge.products import written_out
from faultgauge.simulation.side_by_side import CALLS, ELEMENTWISE

__all__ = ["BY_NUMPY", "lanes_last"]

# what means the same where one more axis stands last
SAME = frozenset(
    {"argmax", "argmin", "cummax", "cumsum", "reduce_and", "reduce_max", "reduce_min", "reduce_or",
     "reduce_prod", "reduce_sum", "rev", "split", "squeeze"}
)  # fmt: skip
JOINS = frozenset({"concatenate", "stack"})
PUTS = {"scatter": lambda old, new: new, "scatter-add": jnp.add, "scatter-mul": jnp.multiply}
PIECES = 4  # slices that are joined rather than gathered
# numbers of a unit whose sum is written out: as a loop within what is around it, it and all that it
# sums (a network's hidden units) would be scalar code
TERMS = 32
TURNS = 4  # of a loop that are written out: what goes round in one is laid down and taken up again


def _broadcast(array: np.ndarray, shape: Any, broadcast_dimensions: Any, **_: Any) -> np.ndarray:
    sizes = np.ones(len(shape), int)
    sizes[list(broadcast_dimensions)] = array.shape
    return np.broadcast_to(array.reshape(sizes), shape)


def _iota(shape: Any, dimension: int, **_: Any) -> np.ndarray:
    return _broadcast(np.arange(shape[dimension]), shape, [dimension])


def _slice(array: np.ndarray, start_indices: Any, limit_indices: Any, strides: Any) -> np.ndarray:
    return array[tuple(map(slice, start_indices, limit_indices, strides or [1] * array.ndim))]


# what JAX would compile a program for, for every shape, to tell it of numbers that are known
BY_NUMPY: dict[str, Callable[..., np.ndarray]] = {
    "add": np.add,
    "broadcast_in_dim": _broadcast,
    "concatenate": lambda *arrays, dimension: np.concatenate(arrays, dimension),
    "convert_element_type": lambda array, **_: array,
    "eq": lambda a, b, **_: a == b,
    "iota": _iota,
    "lt": lambda a, b, **_: a < b,
    "select_n": lambda which, *cases: np.choose(which, cases),
    "slice": _slice,
    "squeeze": lambda array, dimensions: np.squeeze(array, tuple(dimensions)),
    "transpose": lambda array, permutation: np.transpose(array, permutation),
}


class _Value(NamedTuple):
    """An array of one unit; where it is each unit's `own`, of all units, which stand last."""

    array: Any
    own: bool


def lanes_last(function: Callable[..., Any], *args: Any) -> Any:
    """`function`, written for one unit, of `args` whose arrays have the units last; so has what it
    gives. What it takes from around it is the same for all units."""
    leaves, tree = jax.tree.flatten(args)
    units = leaves[0].shape[-1]
    of_one = [jax.ShapeDtypeStruct(a.shape[:-1], a.dtype) for a in leaves]
    with written_out:
        given = jax.tree.unflatten(tree, of_one)
        program, out = jax.make_jaxpr(function, return_shape=True)(*given)
    lanes = _Lanes(units)
    found = lanes.run(program, [_Value(a, True) for a in leaves])
    ends = [
        lanes.spread(a, _shape(own)) for a, own in zip(found, program.jaxpr.outvars, strict=True)
    ]
    return jax.tree.unflatten(jax.tree.structure(out), ends)


class _Lanes:
    """Runs a program of one unit on arrays of many."""

    def __init__(self, units: int) -> None:
        self.units = units

    def run(self, program: ClosedJaxpr, given: Sequence[_Value]) -> list[_Value]:
        jaxpr: Jaxpr = program.jaxpr
        values = dict(zip(jaxpr.invars, given, strict=True))
        values |= {
            v: _Value(c, False) for v, c in zip(jaxpr.constvars, program.consts, strict=True)
        }

        def read(atom: Any) -> _Value:
            return _Value(atom.val, False) if isinstance(atom, Literal) else values[atom]

        for eqn in jaxpr.eqns:
            found = self.operation(eqn, [read(a) for a in eqn.invars])
            values |= zip(eqn.outvars, found, strict=True)
        return [read(a) for a in jaxpr.outvars]

    def operation(self, eqn: JaxprEqn, args: list[_Value]) -> list[_Value]:
        """What one operation gives."""
        name = eqn.primitive.name
        if name in CALLS:
            return self.run(eqn.params["jaxpr" if "jaxpr" in eqn.params else "call_jaxpr"], args)
        if not any(each.own for each in args):
            return _of_all(eqn, [each.array for each in args])
        shapes = [_shape(v) for v in (*eqn.invars, *eqn.outvars)]
        if name in ELEMENTWISE:
            return self.bound(eqn, [self.spread(each, shapes[-1]) for each in args])
        if name in JOINS:
            joined = zip(args, shapes, strict=False)
            return self.bound(eqn, [self.spread(each, shape) for each, shape in joined])
        if name == "cond" and _known(args[0]):
            branches = eqn.params["branches"]
            which = int(np.clip(args[0].array, 0, len(branches) - 1))
            return self.run(branches[which], args[1:])
        if name == "reduce_sum" and _whole(eqn) and 0 < shapes[0][0] <= TERMS:
            return [_Value(reduce(jnp.add, list(args[0].array)), True)]
        if len(args) == 1 and (more := self.shaped(eqn)) is not None:
            return self.bound(eqn, [args[0].array], **more)
        if name == "scan":
            return self.scanned(eqn, args)
        if name in ("gather", "dynamic_slice") and all(map(_known, args[1:])):
            return [self.taken(eqn, args)]
        if name in PUTS and _known(args[1]) and (into := _landing(eqn, args[1])) is not None:
            return [self.put(eqn, args, into)]
        return self.mapped(eqn, args)

    def scanned(self, eqn: JaxprEqn, args: list[_Value]) -> list[_Value]:
        """A loop, whose state is each unit's own."""
        body = eqn.params["jaxpr"]
        inner, outer = (list(map(_shape, some)) for some in (body.jaxpr.outvars, eqn.outvars))
        # what is given or told step by step has an axis more than in the body
        kept = sum(len(a) == len(b) for a, b in zip(inner, outer, strict=True))
        pairs = zip(body.jaxpr.invars, eqn.invars, strict=True)
        begin = sum(len(_shape(a)) == len(_shape(b)) for a, b in pairs)
        same, given = args[: begin - kept], args[begin:]
        first = [
            self.spread(*each) for each in zip(args[begin - kept : begin], outer, strict=False)
        ]

        def step(state: list[Array], now: list[Any]) -> tuple[list[Array], list[Array]]:
            values = [_Value(a, each.own) for a, each in zip(now, given, strict=True)]
            out = self.run(body, [*same, *(_Value(a, True) for a in state), *values])
            ends = [self.spread(*each) for each in zip(out, inner, strict=True)]
            return ends[:kept], ends[kept:]

        arrays = [jnp.asarray(each.array) for each in given]
        length, back = eqn.params["length"], eqn.params["reverse"]
        unroll = max(length, 1) if length <= TURNS else 1
        ends, said = jax.lax.scan(step, first, arrays, length, back, unroll)
        return [_Value(a, True) for a in (*ends, *said)]

    def bound(self, eqn: JaxprEqn, given: Sequence[Any], **more: Any) -> list[_Value]:
        return [_Value(a, True) for a in _bind(eqn, given, **more)]

    def spread(self, each: _Value, shape: tuple[int, ...]) -> Array:
        """As an array of this shape for every unit."""
        if each.own:
            return jnp.broadcast_to(each.array, (*shape, self.units))
        array = jnp.asarray(each.array)
        return jnp.broadcast_to(array[..., None], (*shape, self.units))

    def shaped(self, eqn: JaxprEqn) -> dict[str, Any] | None:
        """What an operation on one array, which moves or sums numbers, is told anew of its shape;
        None where it is another one."""
        params, name = eqn.params, eqn.primitive.name
        if name in SAME:
            return {}
        if name == "broadcast_in_dim":
            at, shape = params["broadcast_dimensions"], params["shape"]
            return {"broadcast_dimensions": (*at, len(shape)), "shape": (*shape, self.units)}
        if name == "transpose":
            order = params["permutation"]
            return {"permutation": (*order, len(order))}
        if name == "reshape" and params["dimensions"] is None:
            return {"new_sizes": (*params["new_sizes"], self.units)}
        if name == "slice":
            strides = params["strides"]
            return {
                "start_indices": (*params["start_indices"], 0),
                "limit_indices": (*params["limit_indices"], self.units),
                "strides": strides if strides is None else (*strides, 1),
            }
        return None

    def taken(self, eqn: JaxprEqn, args: list[_Value]) -> _Value:
        """Numbers at places that are known: those where their own places come from."""
        array = args[0].array
        shape = array.shape[:-1]
        places = np.arange(int(np.prod(shape)), dtype=float).reshape(shape)
        (moved,) = _alike(eqn, [places, *(each.array for each in args[1:])])
        found = _at(array.reshape(-1, self.units), moved.reshape(-1).astype(int))
        return _Value(found.reshape(*moved.shape, self.units), True)

    def put(self, eqn: JaxprEqn, args: list[_Value], into: Int[np.ndarray, "..."]) -> _Value:
        """Numbers put at places that are known: at each of `into` the new one's number, or -1."""
        old, new = (self.spread(args[k], _shape(eqn.invars[k])) for k in (0, 2))
        flat = new.reshape(-1, self.units)
        there = _at(flat, np.maximum(into, 0).reshape(-1)).reshape(old.shape)
        found = PUTS[eqn.primitive.name](old, there)
        return _Value(jnp.where((into >= 0)[..., None], found, old), True)

    def mapped(self, eqn: JaxprEqn, args: list[_Value]) -> list[_Value]:
        """As JAX itself does it."""
        axes = tuple(-1 if each.own else None for each in args)
        over = jax.vmap(lambda *given: _bind(eqn, given), axes, -1)
        return [_Value(a, True) for a in over(*(each.array for each in args))]


def _bind(eqn: JaxprEqn, given: Sequence[Any], **more: Any) -> list[Any]:
    found = eqn.primitive.bind(*given, **{**eqn.params, **more})
    return list(found) if eqn.primitive.multiple_results else [found]


def _of_all(eqn: JaxprEqn, given: list[Any]) -> list[_Value]:
    """What is the same for all units; a number at once where all that it comes from is known."""
    if any(isinstance(a, Tracer) for a in given):
        return [_Value(a, False) for a in _bind(eqn, given)]
    if eqn.primitive.name in BY_NUMPY and not _cut_off(eqn):
        arrays = [np.asarray(a, _type(v)) for a, v in zip(given, eqn.invars, strict=True)]
        found = BY_NUMPY[eqn.primitive.name](*arrays, **eqn.params)
        return [_Value(np.asarray(found, _type(eqn.outvars[0])), False)]
    return [_Value(a, False) for a in _alike(eqn, given)]


def _alike(eqn: JaxprEqn, given: Sequence[Any]) -> list[np.ndarray]:
    with jax.ensure_compile_time_eval():
        return [np.asarray(a) for a in _bind(eqn, [jnp.asarray(a) for a in given])]


def _cut_off(eqn: JaxprEqn) -> bool:
    """Whether numbers become integers, which XLA and NumPy do in ways of their own."""
    kinds = {_type(v).kind for v in eqn.invars}, {_type(v).kind for v in eqn.outvars}
    return eqn.primitive.name == "convert_element_type" and kinds[0] == {"f"} != kinds[1]


def _known(each: _Value) -> bool:
    return not each.own and not isinstance(each.array, Tracer)


def _landing(eqn: JaxprEqn, at: _Value) -> Int[np.ndarray, "..."] | None:
    """The number of what is put at each place, -1 for none; None where two come to one place."""
    old, new = (np.zeros(_shape(eqn.invars[k])) for k in (0, 2))
    numbers = 2.0 + np.arange(new.size).reshape(new.shape)
    blank = old + (eqn.primitive.name == "scatter-mul")
    (found,) = _alike(eqn, [blank, at.array, numbers])
    landed = np.sort(found[found != blank])
    alone = np.array_equal(landed, np.sort(numbers.reshape(-1)))
    return np.where(found == blank, -1, found - 2).astype(int) if alone else None


def _at(array: Array, places: Int[np.ndarray, "some"]) -> Array:
    """`array[places]`, by slices where they are few."""
    pieces = list(_even(places))
    if not 0 < len(pieces) <= PIECES:
        return array[places]
    cut = [array[piece] for piece in pieces]
    return cut[0] if len(cut) == 1 else jnp.concatenate(cut)


def _even(places: Int[np.ndarray, "some"]) -> Iterator[slice]:
    """Slices one after the other that are these places."""
    first = 0
    while first < len(places):
        rest = np.diff(places[first:])
        stride = int(rest[0]) if len(rest) and rest[0] > 0 else 1
        count = 1 + int(np.argmax(np.append(rest != stride, True)))
        begin = int(places[first])
        yield slice(begin, begin + stride * (count - 1) + 1, stride)
        first += count


def _whole(eqn: JaxprEqn) -> bool:
    """Whether a sum is of all numbers of a vector."""
    return len(_shape(eqn.invars[0])) == 1 and eqn.params["axes"] == (0,)


def _shape(atom: Any) -> tuple[int, ...]:
    return atom.aval.shape


def _type(atom: Any) -> np.dtype:
    return atom.aval.dtype
