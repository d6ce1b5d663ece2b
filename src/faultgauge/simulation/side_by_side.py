"""A function of one unit as a function of many, each number of it a row over the units.

`jax.vmap` keeps vectors and small matrices and adds an axis: a batch of 3 x 3 products becomes a
batch of small loops, each a kernel of its own. Here a vector of three becomes three rows, sums are
written out, zeros and ones of constant matrices are left out, and what remains is arithmetic on
long rows, of which XLA makes vector code. The mathematics is the function's own.
"""

import dataclasses
import os
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.extend.core import ClosedJaxpr, JaxprEqn, Literal
from jaxtyping import Array

__all__ = ["CALLS", "ELEMENTWISE", "Rows", "cores", "rows", "side_by_side", "whole"]

ELEMENTWISE = frozenset(
    {"abs", "acos", "acosh", "add", "and", "asin", "asinh", "atan", "atan2", "atanh", "ceil",
     "clamp", "convert_element_type", "copy", "cos", "cosh", "div", "eq", "erf", "erf_inv",
     "erfc", "exp", "exp2", "expm1", "floor", "ge", "gt", "integer_pow", "is_finite", "le",
     "log", "log1p", "logistic", "lt", "max", "min", "mul", "ne", "neg", "not", "or", "pow",
     "rem", "round", "rsqrt", "select_n", "shift_left", "shift_right_arithmetic",
     "shift_right_logical", "sign", "sin", "sinh", "sqrt", "square", "stop_gradient", "sub",
     "tan", "tanh", "xor"}
)  # fmt: skip
# What only moves numbers: where each comes from is found by moving their places.
MOVES = frozenset(
    {"broadcast_in_dim", "expand_dims", "reshape", "rev", "slice", "squeeze", "transpose"}
)
CALLS = frozenset(
    {"checkpoint", "closed_call", "custom_jvp_call", "custom_vjp_call", "jit", "pjit", "remat"}
)
REDUCTIONS = {
    "reduce_sum": "add", "reduce_max": "max", "reduce_min": "min", "reduce_prod": "mul",
    "reduce_and": "and", "reduce_or": "or",
}  # fmt: skip
ARITHMETIC = {
    "add": jax.lax.add, "mul": jax.lax.mul, "max": jax.lax.max, "min": jax.lax.min,
    "and": jax.lax.bitwise_and, "or": jax.lax.bitwise_or,
}  # fmt: skip
LONG = 8  # terms of a sum that is worth a division

# Arrays of objects: a row over the units, a number that is all units' alike, or one that is known.
Numbers = np.ndarray


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Rows:
    """An array of one unit, for many: `shape` as of one unit, a row for each of its numbers. The
    form that a loop had best carry, which else cuts arrays into rows and joins them at every step.
    """

    rows: tuple[Array, ...]
    shape: tuple[int, ...] = dataclasses.field(metadata={"static": True})


def cores() -> int:
    """How many cores of the processor this process may use; not every system tells."""
    tells = getattr(os, "sched_getaffinity", None)
    return len(tells(0)) if tells else os.cpu_count() or 1


def rows(tree: Any) -> Any:
    """Each leaf, units last, as `Rows`."""
    return jax.tree.map(
        lambda a: Rows(tuple(a[k] for k in np.ndindex(a.shape[:-1])), a.shape[:-1]), tree
    )


def whole(tree: Any) -> Any:
    """Each `Rows` as an array, units last."""
    return jax.tree.map(
        lambda a: jnp.stack(a.rows).reshape(*a.shape, -1),
        tree,
        is_leaf=lambda a: isinstance(a, Rows),
    )


def side_by_side(function: Callable[..., Any], *args: Any, one: Array | None = None) -> Any:
    """`function`, written for one unit, of `args` whose leaves are `Rows`; gives `Rows`. What it
    takes from around it is the same for all units.

    `one` is 1, which the compiler must not know: long sums are divided by it. XLA reckons a sum,
    and what is summed, anew at every place that reads it, but not a quotient.
    """
    leaves, tree = jax.tree.flatten(args, is_leaf=lambda a: isinstance(a, Rows))
    units = leaves[0].rows[0].shape
    of_one = [jax.ShapeDtypeStruct(a.shape, a.rows[0].dtype) for a in leaves]
    program, out = jax.make_jaxpr(function, return_shape=True)(*jax.tree.unflatten(tree, of_one))
    given = [_objects(a.rows, a.shape) for a in leaves]
    found = _Batch(units, one).run(program, given)
    return jax.tree.unflatten(
        jax.tree.structure(out),
        [Rows(tuple(_spread(v, units) for v in a.flat), a.shape) for a in found],
    )


def _objects(values: Sequence[Any], shape: tuple[int, ...]) -> Numbers:
    found = np.empty(len(values), object)
    for k, value in enumerate(values):  # NumPy would look into them
        found[k] = value
    return found.reshape(shape)


def _spread(value: Any, units: tuple[int, ...]) -> Array:
    return value if np.ndim(value) else jnp.broadcast_to(jnp.asarray(value), units)


def _known(value: Any) -> bool:
    return isinstance(value, np.generic)


def _numbers(value: Any) -> Numbers:
    """An array that is the same for all units; known where no tracer stands for it."""
    if isinstance(value, Tracer):
        return _objects([value[k] for k in np.ndindex(value.shape)], value.shape)
    value = np.asarray(value)
    return _objects([value[k] for k in np.ndindex(value.shape)], value.shape)


class _Batch:
    """Runs a program of one unit on rows."""

    def __init__(self, units: tuple[int, ...], one: Array | None) -> None:
        self.units, self.one = units, one

    def run(self, program: ClosedJaxpr, given: Sequence[Numbers]) -> list[Numbers]:
        jaxpr = program.jaxpr
        values: dict[Any, Numbers] = dict(zip(jaxpr.invars, given, strict=True))
        values |= zip(jaxpr.constvars, map(_numbers, program.consts), strict=True)

        def read(atom: Any) -> Numbers:
            if isinstance(atom, Literal):
                return _numbers(np.asarray(atom.val, _kind(atom)))
            return values[atom]

        for eqn in jaxpr.eqns:
            values |= zip(
                eqn.outvars, self.operation(eqn, [read(a) for a in eqn.invars]), strict=True
            )
        return [read(a) for a in jaxpr.outvars]

    def operation(self, eqn: JaxprEqn, args: list[Numbers]) -> list[Numbers]:
        """What one operation gives."""
        name = eqn.primitive.name
        if all(_known(v) for a in args for v in a.flat):
            return self.bound(eqn, args)
        if name in ELEMENTWISE:
            return [self.elementwise(eqn, args)]
        if name in MOVES:
            places = np.arange(args[0].size).reshape(args[0].shape)
            with jax.ensure_compile_time_eval():
                moved = np.asarray(eqn.primitive.bind(jnp.asarray(places), **eqn.params))
            return [args[0].reshape(-1)[moved.reshape(-1)].reshape(moved.shape)]
        if name in CALLS:
            called = "jaxpr" if "jaxpr" in eqn.params else "call_jaxpr"
            return self.run(eqn.params[called], args)
        if name in REDUCTIONS:
            return [self.reduced(REDUCTIONS[name], args[0], eqn.params["axes"])]
        if name == "concatenate":
            return [np.concatenate(args, axis=eqn.params["dimension"])]
        if name == "stack":
            return [np.stack(args, axis=eqn.params["axis"])]
        if name == "dot_general":
            return [self.contracted(args[0], args[1], eqn.params["dimension_numbers"])]
        if name == "argmax" and args[0].ndim == 1:
            return [self.first_largest(args[0], eqn.params["index_dtype"])]
        if name == "scan":
            return self.scanned(eqn, args)
        return self.bound(eqn, args)

    def bound(self, eqn: JaxprEqn, args: list[Numbers]) -> list[Numbers]:
        """By JAX itself: once where nothing differs between units, else over all of them."""
        if all(_known(v) for a in args for v in a.flat):
            with jax.ensure_compile_time_eval():
                given = [
                    np.array(a.tolist(), _kind(v)).reshape(a.shape)
                    for a, v in zip(args, eqn.invars, strict=True)
                ]
                found = eqn.primitive.bind(*map(jnp.asarray, given), **eqn.params)
                found = found if eqn.primitive.multiple_results else [found]
                return [_numbers(np.asarray(a)) for a in found]
        batched = [any(np.ndim(v) for v in a.flat) for a in args]
        given = [
            jnp.stack([_spread(v, self.units) if own else jnp.asarray(v) for v in a.flat]).reshape(
                *a.shape, *(self.units if own else ())
            )
            for a, own in zip(args, batched, strict=True)
        ]

        def bind(*args: Array) -> Any:
            found = eqn.primitive.bind(*args, **eqn.params)
            return found if eqn.primitive.multiple_results else [found]

        if not any(batched):
            return [_numbers(a) for a in bind(*given)]
        axes = [-1 if own else None for own in batched]
        found = jax.vmap(bind, in_axes=axes, out_axes=-1)(*given)
        return [_objects([a[k] for k in np.ndindex(a.shape[:-1])], a.shape[:-1]) for a in found]

    def elementwise(self, eqn: JaxprEqn, args: list[Numbers]) -> Numbers:
        every = np.broadcast_arrays(*args)
        found = np.empty(every[0].shape, object)
        for k in np.ndindex(found.shape):
            found[k] = self.value(eqn, [a[k] for a in every])
        return found

    def value(self, eqn: JaxprEqn, args: list[Any]) -> Any:
        name = eqn.primitive.name
        if name == "select_n" and _known(args[0]):
            return args[1 + int(args[0])]
        if name in ("add", "mul"):
            return self.combined(name, *args)
        if name == "sub" and _known(args[1]) and args[1] == 0:
            return args[0]
        if all(map(_known, args)):
            with jax.ensure_compile_time_eval():
                return np.asarray(eqn.primitive.bind(*map(jnp.asarray, args), **eqn.params))[()]
        return eqn.primitive.bind(*self.alike(args), **eqn.params)

    def alike(self, args: Sequence[Any]) -> list[Array]:
        if any(np.ndim(v) for v in args):
            return [_spread(v, self.units) for v in args]
        return [jnp.asarray(v) for v in args]

    def combined(self, name: str, a: Any, b: Any) -> Any:
        """Of two numbers; a product with 0 is 0, whatever the other is."""
        if _known(a) and not _known(b):
            a, b = b, a
        if _known(b):
            if _known(a):
                with jax.ensure_compile_time_eval():
                    return np.asarray(ARITHMETIC[name](a, b))[()]
            if (name, b) in (("add", 0), ("mul", 1)):
                return a
            if name == "mul" and b == 0:
                return b
        return ARITHMETIC[name](*self.alike([a, b]))

    def reduced(self, name: str, a: Numbers, axes: Sequence[int]) -> Numbers:
        kept = [k for k in range(a.ndim) if k not in axes]
        turned = a.transpose(*kept, *axes).reshape(*(a.shape[k] for k in kept), -1)
        found = np.empty(turned.shape[:-1], object)
        for k in np.ndindex(found.shape):
            found[k] = reduce(lambda x, y: self.combined(name, x, y), turned[k])
            if self.one is not None and name == "add" and turned.shape[-1] >= LONG:
                found[k] = jax.lax.div(*self.alike([found[k], self.one]))
        return found

    def first_largest(self, a: Numbers, kind: Any) -> Numbers:
        most, at = a[0], jnp.zeros((), kind)
        for k, value in enumerate(a[1:], 1):
            most, value = self.alike([most, value])
            at = jnp.where(value > most, jnp.asarray(k, kind), at)
            most = jnp.maximum(most, value)
        return _objects([at], ())

    def contracted(self, a: Numbers, b: Numbers, numbers: Any) -> Numbers:
        """`dot_general`: sums of products, written out."""
        (over_a, over_b), (batch_a, batch_b) = numbers
        free_a = [k for k in range(a.ndim) if k not in (*over_a, *batch_a)]
        free_b = [k for k in range(b.ndim) if k not in (*over_b, *batch_b)]
        same = [a.shape[k] for k in batch_a]
        left = a.transpose(*batch_a, *free_a, *over_a)
        right = b.transpose(*batch_b, *free_b, *over_b)
        shape = (*same, *(a.shape[k] for k in free_a), *(b.shape[k] for k in free_b))
        found = np.empty(shape, object)
        for k in np.ndindex(shape):
            i, rest = k[: len(same)], k[len(same) :]
            x = left[(*i, *rest[: len(free_a)], ...)]
            y = right[(*i, *rest[len(free_a) :], ...)]
            terms = [
                self.combined("mul", p, q) for p, q in zip(np.ravel(x), np.ravel(y), strict=True)
            ]
            found[k] = reduce(lambda p, q: self.combined("add", p, q), terms)
        return found

    def scanned(self, eqn: JaxprEqn, args: list[Numbers]) -> list[Numbers]:
        """A loop of its own, on rows: what is the same for all units at every step stays so."""
        body, length = eqn.params["jaxpr"], eqn.params["length"]
        shapes = [_shape(v) for v in (*eqn.outvars, *body.jaxpr.outvars)]
        # what is given or told step by step has an axis more than in the body
        kept = sum(map(_alike, shapes[: len(eqn.outvars)], shapes[len(eqn.outvars) :]))
        inner = [_shape(v) for v in body.jaxpr.invars]
        begin = sum(_alike(a.shape, own) for a, own in zip(args, inner, strict=True))
        constants, given = args[: begin - kept], args[begin:]
        first = [v for a in args[begin - kept : begin] for v in a.flat]
        columns = [list(column) for a in given for column in a.reshape(length, -1).T]
        fixed = [_settled(column) for column in columns]
        moving = [
            jnp.stack(self.alike(column))
            for column, known in zip(columns, fixed, strict=True)
            if known is None
        ]

        def step(carry: list[Any], now: list[Any]) -> tuple[list[Any], list[Any]]:
            rest = iter(now)
            values = [next(rest) if known is None else known for known in fixed]
            out = self.run(body, [*constants, *_cut([*carry, *values], inner[begin - kept :])])
            ends, said = ([v for a in part for v in a.flat] for part in (out[:kept], out[kept:]))
            return ends, said

        own = self.own(step, first, [column[0] for column in moving])

        def held(values: list[Any]) -> list[Array]:
            return [
                _spread(v, self.units) if each else jnp.asarray(v)
                for v, each in zip(values, own, strict=True)
            ]

        def one(carry: list[Any], now: list[Any]) -> tuple[list[Array], list[Array]]:
            ends, said = step(carry, now)
            return held(ends), [*map(jnp.asarray, said)]

        backwards = eqn.params["reverse"]
        ends, said = jax.lax.scan(one, held(first), moving, length=length, reverse=backwards)
        told = _cut(said, shapes[len(eqn.outvars) + kept :])
        return [
            *_cut(ends, shapes[:kept]),
            *(
                _objects([v[k] for k in range(length) for v in a.flat], (length, *a.shape))
                for a in told
            ),
        ]

    def own(self, step: Callable, first: list[Any], now: list[Array]) -> list[bool]:
        """Which of what a loop carries is each unit's own, at its end if not at its beginning."""
        own = [bool(np.ndim(v)) for v in first]
        while True:
            carry = [
                _spread(v, self.units) if each else jnp.asarray(v)
                for v, each in zip(first, own, strict=True)
            ]
            ends = jax.eval_shape(lambda *a: [*map(jnp.asarray, step(*a)[0])], carry, now)
            after = [bool(v.ndim) or each for v, each in zip(ends, own, strict=True)]
            if after == own:
                return own
            own = after


def _shape(atom: Any) -> tuple[int, ...]:
    return atom.aval.shape


def _kind(atom: Any) -> Any:
    return atom.aval.dtype


def _alike(outside: tuple[int, ...], inside: tuple[int, ...]) -> bool:
    return len(outside) == len(inside)


def _cut(values: Sequence[Any], shapes: Sequence[tuple[int, ...]]) -> list[Numbers]:
    """The numbers one after the other as arrays of these shapes."""
    ends = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)])
    return [
        _objects(values[a:b], shape)
        for a, b, shape in zip(ends[:-1], ends[1:], shapes, strict=True)
    ]


def _settled(column: Sequence[Any]) -> Any:
    """The number that all of a column are, where it is known; else none."""
    if not all(map(_known, column)):
        return None
    same = all(v == column[0] or (v != v and column[0] != column[0]) for v in column)
    return column[0] if same else None
