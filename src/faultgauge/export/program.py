"""A jaxpr as a short list of operations on arrays: calls inlined, constants folded, copies gone.

What does not depend on the arguments is computed here, once; a `cond` whose index is known is
replaced by its branch. What C cannot carry is refused before anything is printed.
"""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal

import faultgauge.plants.plant  # noqa: F401  (it has JAX count in float64)
from faultgauge.errors import InputError

__all__ = ["OpBlock", "Operation", "Program", "Value", "tidy", "trace"]

CALLS = ("jaxpr", "call_jaxpr", "fun_jaxpr")
CONTROL = ("cond", "scan", "while")
SAME = ("stop_gradient", "copy", "copy_p", "reduce_precision", "optimization_barrier")


@dataclass(eq=False)
class Value:
    """An array of the program; `array` where it is known before the program runs, `span` the least
    and the most of every element, of integers and truth values, where that is known (`ranges`)."""

    shape: tuple[int, ...]
    dtype: np.dtype
    array: np.ndarray | None = None
    known: bool = False
    source: "Operation | None" = field(default=None, repr=False)
    span: "tuple[Any, Any] | None" = field(default=None, repr=False)

    @property
    def size(self) -> int:
        return int(np.prod(self.shape, dtype=int))


@dataclass(eq=False)
class Operation:
    """`blocks` are the branches of a `cond` or the body of a `scan`."""

    name: str
    params: dict[str, Any]
    inputs: list[Value]
    outputs: list[Value]
    blocks: "list[OpBlock]" = field(default_factory=list)


@dataclass(eq=False)
class OpBlock:
    """Operations in order; `carries` are what a turn of a loop leaves to the next."""

    operations: list[Operation]
    outputs: list[Value]
    carries: list[Value] = field(default_factory=list)


@dataclass
class Program:
    """A pure function of `inputs`; it may read what blocks around it define."""

    inputs: list[Value]
    body: OpBlock


def trace(function: Callable[..., Any], *arguments: Any) -> Program:
    """The program of a pure function of pytrees of arrays, whose leaves come in and go out in
    order. Raises `InputError` where it has no static shape or a loop without an end known."""
    closed = jax.make_jaxpr(function)(*arguments)
    return _Flattening().program(closed)


class _Flattening:
    def __init__(self) -> None:
        self.before: list[tuple[Any, list[Value], list[Value]]] = []  # what is known, unevaluated

    def program(self, closed: ClosedJaxpr) -> Program:
        inputs = [_value(each.aval) for each in closed.jaxpr.invars]
        body = self._block(closed, inputs)
        self._evaluate(body)
        tidy(body)
        return Program(inputs, body)

    def _block(self, closed: Any, inputs: Sequence[Value]) -> OpBlock:
        operations: list[Operation] = []
        return OpBlock(operations, self._inlined(closed, inputs, operations))

    def _inlined(self, closed: Any, inputs: Sequence[Value], into: list[Operation]) -> list[Value]:
        """The outputs of a jaxpr at `inputs`, its operations appended to `into`."""
        jaxpr, constants = (
            (closed.jaxpr, closed.consts) if isinstance(closed, ClosedJaxpr) else (closed, ())
        )
        env: dict[Any, Value] = dict(zip(jaxpr.invars, inputs, strict=True))
        env |= {v: _constant(c) for v, c in zip(jaxpr.constvars, constants, strict=True)}

        def read(atom: Any) -> Value:
            return _constant(atom.val) if isinstance(atom, Literal) else env[atom]

        for equation in jaxpr.eqns:
            given = [read(each) for each in equation.invars]
            for variable, value in zip(
                equation.outvars, self._equation(equation, given, into), strict=True
            ):
                env[variable] = value
        return [read(each) for each in jaxpr.outvars]

    def _equation(self, equation: Any, given: list[Value], into: list[Operation]) -> list[Value]:
        name, params = equation.primitive.name, equation.params
        if equation.effects:
            raise InputError(
                f"the model's step has a side effect ({name}), which C code has none of; export a "
                "pure step."
            )
        outputs = [_value(each.aval) for each in equation.outvars]
        if name == "platform_index":
            order = [tuple(p or ("any",)) for p in params["platforms"]]
            for wanted in ("c", "cpu", "any"):
                at = next((k for k, p in enumerate(order) if wanted in p), None)
                if at is not None:
                    return [_constant(np.int32(at))]
        if name == "cond" and given[0].known:
            at = int(np.clip(self._now(given[0]), 0, len(params["branches"]) - 1))
            return self._inlined(params["branches"][at], given[1:], into)
        if name not in CONTROL:
            inner = next((params[key] for key in CALLS if key in params), None)
            if isinstance(inner, ClosedJaxpr | Jaxpr):
                return self._inlined(inner, given, into)
        if all(each.known for each in given):
            self.before.append((equation, given, outputs))
            for each in outputs:
                each.known = True
            return outputs
        if all(each.size == 0 for each in outputs):
            return [_constant(np.zeros(each.shape, each.dtype)) for each in outputs]
        if name in SAME:
            return given
        into.append(self._operation(name, params, given, outputs))
        return outputs

    def _operation(
        self, name: str, params: dict[str, Any], given: list[Value], outputs: list[Value]
    ) -> Operation:
        match name:
            case "cond":
                blocks = [self._block(each, given[1:]) for each in params["branches"]]
                made = Operation(name, params, given[:1], outputs, blocks)
            case "scan":
                made = self._scan(params, given, outputs)
            case "while":
                raise InputError(
                    "the model's step has a loop whose number of turns is known only while it "
                    "runs, and C code must have a longest time; use a loop of a fixed length."
                )
            case _:
                made = Operation(name, params, given, outputs)
        for each in outputs:
            each.source = made
        return made

    def _scan(self, params: dict[str, Any], given: list[Value], outputs: list[Value]) -> Operation:
        consts, carry = params["num_consts"], params["num_carry"]
        start, xs = given[consts : consts + carry], given[consts + carry :]
        carries = [Value(each.shape, each.dtype) for each in start]
        turn = Operation("turn", {}, [], [])  # its number stands for the loop's index
        reads, slices = [], []
        for each in xs:
            one = Value(each.shape[1:], each.dtype)
            one.source = Operation("turn_of", {"turn": turn}, [each], [one])
            reads.append(one.source)
            slices.append(one)
        body = self._block(params["jaxpr"], [*given[:consts], *carries, *slices])
        body.operations[:0] = reads
        body.carries = carries
        own = {"length": params["length"], "reverse": params["reverse"], "turn": turn}
        return Operation("scan", own, start, outputs, [body])

    def _now(self, value: Value) -> np.ndarray:
        """A known value, evaluated at once."""
        if value.array is None:
            equation, given, outputs = next(
                each for each in self.before if any(value is o for o in each[2])
            )
            found = _bind(equation, [self._now(each) for each in given])
            for each, array in zip(outputs, found, strict=True):
                each.array = np.asarray(array)
        assert value.array is not None
        return value.array

    def _evaluate(self, body: OpBlock) -> None:
        """All that is known and needed, in one program."""
        needed = {id(v) for v in _read(body) if v.known and v.array is None}
        for _, given, outputs in reversed(self.before):
            if any(id(each) in needed for each in outputs):
                needed |= {id(each) for each in given if each.array is None}
        wanted = [e for e in self.before if any(id(o) in needed for o in e[2])]
        wanted = [e for e in wanted if any(o.array is None for o in e[2])]

        def evaluated() -> list[list[Any]]:
            env: dict[int, Any] = {}
            for equation, given, outputs in wanted:
                values = [env.get(id(each), each.array) for each in given]
                found = _bind(equation, values)
                env |= {id(o): array for o, array in zip(outputs, found, strict=True)}
            return [[env[id(o)] for o in each[2]] for each in wanted]

        for (_, _, outputs), found in zip(wanted, jax.jit(evaluated)(), strict=True):
            for each, array in zip(outputs, found, strict=True):
                each.array = np.asarray(array)


def _bind(equation: Any, values: Sequence[Any]) -> Sequence[Any]:
    found = equation.primitive.bind(*values, **equation.params)
    return found if equation.primitive.multiple_results else [found]


def _value(aval: Any) -> Value:
    if not all(isinstance(each, int | np.integer) for each in aval.shape):
        raise InputError("the model's step has a shape that is known only while it runs.")
    return Value(tuple(int(each) for each in aval.shape), np.dtype(aval.dtype))


def _constant(array: Any) -> Value:
    array = np.asarray(array)
    return Value(array.shape, array.dtype, array, True)


def _read(block: OpBlock) -> Iterator[Value]:
    """Whatever the block reads."""
    yield from block.outputs
    for each in block.operations:
        yield from each.inputs
        for inner in each.blocks:
            yield from _read(inner)


# -- the same with fewer operations


def tidy(body: OpBlock) -> None:
    """Drop what changes nothing, what was computed already, and what nobody reads; take out of
    loops what every turn would compute alike."""
    _same(body, {}, {})
    _hoisted(body)
    _used(body, set())


def _same(block: OpBlock, alias: dict[int, Value], known: dict[Any, list[Value]]) -> None:
    """`alias` leads from a value to an equal one, `known` from an operation to its results."""

    def final(value: Value) -> Value:
        return alias.get(id(value), value)

    kept = []
    for each in block.operations:
        each.inputs = [final(v) for v in each.inputs]
        for inner in each.blocks:
            _same(inner, dict(alias), dict(known))
        equal = _nothing(each)
        if equal is not None:
            alias[id(each.outputs[0])] = equal
            continue
        if each.name == "cond" and each.inputs[0].array is not None:
            taken = each.blocks[int(np.clip(each.inputs[0].array, 0, len(each.blocks) - 1))]
            alias |= {id(o): v for o, v in zip(each.outputs, taken.outputs, strict=True)}
            kept += taken.operations
            continue
        if each.name == "cond":
            _passed_on(each, alias)
        if each.blocks:
            kept.append(each)
            continue
        key = (each.name, str(sorted(each.params.items(), key=lambda kv: kv[0])))
        key = (*key, *(_key(v) for v in each.inputs), each.outputs[0].dtype)
        if key in known:
            alias |= {id(o): k for o, k in zip(each.outputs, known[key], strict=True)}
            continue
        known[key] = each.outputs
        kept.append(each)
    block.operations = kept
    block.outputs = [final(v) for v in block.outputs]


def _passed_on(each: Operation, alias: dict[int, Value]) -> None:
    """Take outputs that are the same whichever branch is taken from a `cond`."""
    kept = []
    for k, out in enumerate(each.outputs):
        first, *others = (inner.outputs[k] for inner in each.blocks)
        if all(_key(first) == _key(other) for other in others):
            alias[id(out)] = first
        else:
            kept.append(k)
    each.outputs = [each.outputs[k] for k in kept]
    for inner in each.blocks:
        inner.outputs = [inner.outputs[k] for k in kept]


def _key(value: Value) -> Any:
    if value.array is None:
        return id(value)
    return value.array.dtype.str, value.shape, hashlib.sha256(value.array.tobytes()).digest()


def _nothing(each: Operation) -> Value | None:
    """The input that the operation only passes on, if it does."""
    if not each.inputs or len(each.outputs) != 1:
        return None
    first, out = each.inputs[0], each.outputs[0]
    same = first.shape == out.shape and first.dtype == out.dtype
    match each.name:
        case "convert_element_type" | "reshape" | "squeeze" | "broadcast_in_dim" | "slice":
            return first if same and not _strided(each) else None
        case "pad":
            return first if same and not any(map(any, each.params["padding_config"])) else None
        case "transpose":
            order = tuple(each.params["permutation"])
            return first if order == tuple(range(len(order))) else None
        case "clamp" | "max" | "min" if out.dtype.kind in "iu":
            return _within(each)
        case "add" | "mul" | "and" | "or" if out.dtype == np.bool_ or each.name in ("add", "mul"):
            one = 0 if each.name in ("add", "or") else 1
            for v, other in (each.inputs, each.inputs[::-1]):
                if v.shape == out.shape and _everywhere(other, one):
                    return v
        case "sub" | "div":
            one = 0 if each.name == "sub" else 1
            return first if same and _everywhere(each.inputs[1], one) else None
        case "select_n" if len({_key(v) for v in each.inputs[1:]}) == 1:
            return each.inputs[1] if each.inputs[1].shape == out.shape else None
        case "select_n" if first.array is not None and first.size:
            at = int(first.array.flat[0])
            if np.all(first.array == at) and each.inputs[1 + at].shape == out.shape:
                return each.inputs[1 + at]
    return None


def _within(each: Operation) -> Value | None:
    """The one of integers that limits never change."""
    place = 1 if each.name == "clamp" else 0
    value = each.inputs[place]
    limits = [v.array for k, v in enumerate(each.inputs) if k != place]
    if value.span is None or value.shape != each.outputs[0].shape:
        return None
    low, high = value.span
    least, most = (limits * 2)[:2]
    above = each.name == "min" or (least is not None and bool(np.all(low >= least)))
    below = each.name == "max" or (most is not None and bool(np.all(high <= most)))
    return value if above and below else None


def _strided(each: Operation) -> bool:
    strides = each.params.get("strides")
    return strides is not None and any(s != 1 for s in strides)


def _everywhere(value: Value, number: int) -> bool:
    """Whether `value` is that number, or that truth."""
    return value.array is not None and bool(np.all(value.array == number))


def _hoisted(block: OpBlock) -> None:
    """Put what does not depend on the turn of a loop before the loop, also where only some turns
    need it, but not what a condition within them spares."""
    kept = []
    for each in block.operations:
        for inner in each.blocks:
            _hoisted(inner)
        if each.name == "scan":
            own = {id(v) for v in each.blocks[0].carries}
            kept += _outside(each.blocks[0], own, 1)
        kept.append(each)
    block.operations = kept


def _outside(block: OpBlock, own: set[int], depth: int) -> list[Operation]:
    """Operations that read nothing of their `own` loop, taken out of its body, and out of as many
    conditions in each other as `depth` says."""
    out, kept = [], []
    for each in block.operations:
        if each.name == "cond" and depth:
            for inner in each.blocks:
                out += _outside(inner, own, depth - 1)
        mine = each.name == "turn_of" or bool(each.blocks)
        if mine or any(id(v) in own for v in each.inputs):
            own |= {id(v) for v in each.outputs}
            kept.append(each)
        else:
            out.append(each)
    block.operations = kept
    return out


def _used(block: OpBlock, used: set[int]) -> None:
    """Drop operations of which no output is read; `used` are those read behind the block."""
    used |= {id(v) for v in block.outputs if v.array is None}
    kept = []
    for each in reversed(block.operations):
        if not any(id(o) in used for o in each.outputs):
            continue
        if each.name == "cond":
            live = [k for k, o in enumerate(each.outputs) if id(o) in used]
            each.outputs = [each.outputs[k] for k in live]
            for inner in each.blocks:
                inner.outputs = [inner.outputs[k] for k in live]
        for inner in each.blocks:
            _used(inner, used)
        used |= {id(v) for v in each.inputs if v.array is None}
        kept.append(each)
    block.operations = kept[::-1]
