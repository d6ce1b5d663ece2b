"""A program as statements of C: loops over static shapes, one for every array that is kept."""

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import prod
from typing import Any, NamedTuple

import numpy as np

from faultgauge.errors import InputError
from faultgauge.export.elementwise import (
    ELEMENTWISE,
    FLOATS,
    HELPERS,
    LETTERS,
    Kind,
    kind_of,
    literal,
)
from faultgauge.export.fusion import FUNCTIONS, WHOLE, kept_values
from faultgauge.export.memory import Array, Branch, Loop, Node, Statement
from faultgauge.export.places import Place, linear
from faultgauge.export.program import Block, Operation, Program, Value
from faultgauge.export.tables import Tables

__all__ = ["Printer"]

Index = tuple[Place, ...]
LONG = 60  # characters of an expression that gets a name
UPDATES = {
    "scatter": "{0} = {1};",
    "scatter-add": "{0} += {1};",
    "scatter-mul": "{0} *= {1};",
    "scatter-min": "{0} = fg_min_{2}({0}, {1});",
    "scatter-max": "{0} = fg_max_{2}({0}, {1});",
}
RUNNING = {
    "cumsum": "{0} + {1}",
    "cumprod": "{0} * {1}",
    "cummax": "fg_max_{2}({0}, {1})",
    "cummin": "fg_min_{2}({0}, {1})",
}
REDUCED = {  # the start, and what an element does to it
    "reduce_sum": (0.0, "{0} += {1};"),
    "reduce_prod": (1.0, "{0} *= {1};"),
    "reduce_max": (-np.inf, "{0} = fg_max_{2}({0}, {1});"),
    "reduce_min": (np.inf, "{0} = fg_min_{2}({0}, {1});"),
    "reduce_and": (True, "{0} = {0} && {1};"),
    "reduce_or": (False, "{0} = {0} || {1};"),
}


@dataclass
class Scope:
    """A loop that is open, or the statement around it: its lines, and what has a name in it."""

    lines: list[str] = field(default_factory=list)
    names: dict[tuple[int, Index], str] = field(default_factory=dict)
    turns: int = 1


class _Axes(NamedTuple):
    """Of an array that is read or written by windows: `mapped`, along which the windows start where
    the indices say; `dropped`, which a window does not have; `batched` with the axes `theirs` of
    the indices."""

    mapped: tuple[int, ...]
    dropped: tuple[int, ...]
    batched: tuple[int, ...]
    theirs: tuple[int, ...]

    @staticmethod
    def of(*axes: Iterable[Any]) -> "_Axes":
        return _Axes(*(tuple(int(a) for a in each) for each in axes))


class Printer:
    """Prints one program. `operations` counts what one run does at most; `helpers` are the C
    functions that it needs."""

    def __init__(
        self,
        program: Program,
        tables: Tables,
        single: bool,
        fast_tanh: bool,
        wide: Collection[int] = (),
    ) -> None:
        self.program, self.tables, self.single = program, tables, single
        self.wide = wide  # ids of values
        self.suffix = "f" if single else ""
        self.fast_tanh = fast_tanh
        self.kept = kept_values(program)
        self.uses = Counter(_uses(program.body))
        self.arrays: list[Array] = []
        self.held: dict[int, Array] = {}  # by the id of the value
        self.scalars: dict[int, str] = {}
        self.helpers: set[str] = set()
        self.operations: Counter[str] = Counter()
        self.nodes: list[Node] = []
        self.scopes: list[Scope] = []
        self.depth: dict[str, int] = {}  # of the scope that a variable belongs to
        self.reads: list[tuple[Array, Place]] = []
        self.turns = 1
        self.count = 0
        self.lines: list[str] = []  # what `_atom` takes, and the arrays that it reads
        self.read: set[Array] = set()

    # -- blocks

    def run(self) -> list[Node]:
        """All statements; what the program leaves is where `leaf` says."""
        self._block(self.program.body)
        return self.nodes

    def given(self, value: Value, member: str) -> None:
        """`value` comes in as `member`."""
        if value.shape == ():
            name = self._name("a")
            kind = self._kind(value)
            text = f"{member} != 0" if kind == "bool" else member
            self.nodes.append(Statement([f"const {self._declared(kind)} {name} = {text};"]))
            self.scalars[id(value)] = name
        else:
            self.held[id(value)] = self._array(value, fixed=member)

    def leave(self, values: Sequence[Value], members: Sequence[str]) -> None:
        """Put the program's outputs to where they go: all are read before one is overwritten."""
        here = {each.fixed: each for each in self.arrays if each.fixed}
        taken = {}
        for value, member in zip(values, members, strict=True):
            old = self.held.get(id(value))
            if old is not None and old.fixed is not None and old.fixed != member:
                taken[member] = self._copied(value)
        for value, member in zip(values, members, strict=True):
            if value.size == 0:
                continue
            if value.shape == ():
                text = self._atom(value)
                lines = [*self.lines, f"{member} = {text};"]
                self.nodes.append(Statement(lines, reads=self.read))
                continue
            into = here.get(member) or self._array(value, fixed=member)
            if member in taken:
                self._move(taken[member], into)
            elif self.held.get(id(value)) is not into:
                self._store(value, into, copy=True)

    def _move(self, source: Array, into: Array) -> None:
        with self._statement() as statement:
            with self._loops([source.size]) as (at,):
                self._line(f"{self._in(into, at)} = {self._load(source, at)};")
            statement.writes, statement.copy = {into}, True
            self._note(statement, at)

    def _copied(self, value: Value) -> Array:
        into = self._array(value)
        self._store(value, into, copy=True)
        return into

    def _block(self, block: Block) -> None:
        for each in block.operations:
            self._operation(each)

    def _operation(self, each: Operation) -> None:
        if each.name == "cond":
            self._cond(each)
        elif each.name == "scan":
            self._scan(each)
        elif each.name == "sort":
            self._sort(each)
        elif id(each.outputs[0]) in self.kept:
            value = each.outputs[0]
            if value.shape == () and each.name not in WHOLE:
                with self._statement() as statement:
                    name = self._new(value, (), "v")
                    self.scalars[id(value)] = name
                statement.reads = {array for array, _ in self.reads}
                return
            array = self.held[id(value)] = self._array(value)
            if each.name in WHOLE:
                self._whole(each, array)
            else:
                del self.held[id(value)]
                self._store(value, array)
                self.held[id(value)] = array

    def _cond(self, each: Operation) -> None:
        choice = self._atom(each.inputs[0])
        for out in each.outputs:
            self._reserve(out)
        ways: list[tuple[str, list[Node]]] = []
        counts: list[Counter[str]] = []
        order = [1, 0] if len(each.blocks) == 2 else list(range(len(each.blocks)))
        before = self.operations.copy()
        outside = self.nodes
        for turn, k in enumerate(order):
            self.nodes, self.operations = [], Counter()
            block = each.blocks[k]
            self._block(block)
            for out, value in zip(each.outputs, block.outputs, strict=True):
                self._assign(out, value)
            last = turn == len(order) - 1
            head = "" if last else f"{choice} == {k}" if len(order) > 2 else choice
            if len(order) > 2 and k == 0:
                head = f"{choice} <= 0"
            ways.append((head, self.nodes))
            counts.append(self.operations)
        self.nodes = outside
        self.nodes.append(Branch(ways))
        most = max(counts, key=lambda c: sum(c.values()))
        self.operations = before + most

    def _scan(self, each: Operation) -> None:
        body, length = each.blocks[0], each.params["length"]
        carries, ys = each.outputs[: len(body.carries)], each.outputs[len(body.carries) :]
        for start, carry, out in zip(each.inputs, body.carries, carries, strict=True):
            self._reserve(carry)
            self._assign(carry, start)
            if id(carry) in self.held:
                self.held[id(out)] = self.held[id(carry)]
            else:
                self.scalars[id(out)] = self.scalars[id(carry)]
        for y in ys:
            array = self.held[id(y)] = self._array(y)
            self.nodes.append(Statement([], {array}))  # it begins here
        turn = f"n{self._name('')}"
        self.depth[turn] = 0
        place = Place.variable(turn)
        if each.params["reverse"]:
            place = place * -1 + (length - 1)
        each.params["turn"].params["place"] = place
        outside, self.nodes = self.nodes, []
        self.turns *= length
        self._block(body)
        new, slices = body.outputs[: len(carries)], body.outputs[len(carries) :]
        for y, value in zip(ys, slices, strict=True):
            self._store(value, self.held[id(y)], head=place * value.size, part=True)
        self._turned(body.carries, new)
        self.turns //= length
        head = f"for (int32_t {turn} = 0; {turn} < {length}; {turn}++) {{"
        body_nodes, self.nodes = self.nodes, outside
        self.nodes.append(Loop(head, body_nodes))

    def _turned(self, carries: Sequence[Value], new: Sequence[Value]) -> None:
        """The new carries in the place of the old: all are read before one is overwritten."""
        moved = {id(v) for v in carries}
        copies: dict[int, Any] = {}
        for carry, value in zip(carries, new, strict=True):
            if value is carry or id(value) not in moved:
                continue
            if value.shape == ():
                name, kind = self._name("x"), self._declared(self._kind(value))
                line = f"const {kind} {name} = {self.scalars[id(value)]};"
                self.nodes.append(Statement([line]))
                copies[id(carry)] = name
            else:
                copies[id(carry)] = self._copied(value)
        for carry, value in zip(carries, new, strict=True):
            if value is carry:
                continue
            if id(carry) in copies and value.shape == ():
                line = f"{self.scalars[id(carry)]} = {copies[id(carry)]};"
                self.nodes.append(Statement([line]))
            elif id(carry) in copies:
                self._move(copies[id(carry)], self.held[id(carry)])
            else:
                self._assign(carry, value)

    def _reserve(self, value: Value) -> None:
        if value.shape == ():
            name = self._name("v")
            self.nodes.append(Statement([f"{self._declared(self._kind(value))} {name};"]))
            self.scalars[id(value)] = name
        else:
            self.held[id(value)] = self._array(value)

    def _assign(self, into: Value, value: Value) -> None:
        if value.size == 0:
            return
        if value.shape == ():
            text = self._atom(value)
            lines = [*self.lines, f"{self.scalars[id(into)]} = {text};"]
            self.nodes.append(Statement(lines, reads=self.read))
        else:
            self._store(value, self.held[id(into)], copy=True)

    # -- statements

    @contextmanager
    def _statement(self) -> Iterator[Statement]:
        """What is printed inside becomes one statement."""
        statement = Statement([])
        self.scopes, self.reads = [Scope()], []
        yield statement
        statement.lines = self.scopes[0].lines
        self.scopes = []
        self.nodes.append(statement)

    def _atom(self, value: Value) -> str:
        """A scalar, outside of all loops."""
        self.scopes, self.reads = [Scope()], []
        text = self._at(value, ())
        self.lines = self.scopes[0].lines
        self.read = {array for array, _ in self.reads}
        self.scopes = []
        return text

    def _store(
        self,
        value: Value,
        into: Array,
        *,
        head: Place | None = None,
        part: bool = False,
        copy: bool = False,
    ) -> None:
        """`value` in memory, element by element; `head` is where its first one goes."""
        head = head or Place()
        with self._statement() as statement:
            with self._loops(value.shape) as index:
                to = linear(index, value.shape) + head
                text = self._at(value, index)
                self._line(f"{self._in(into, to)} = {_bare(text)};")
            statement.writes, statement.part = {into}, part
            self._note(statement, to)
            source = self.held.get(id(value))
            alone = source is not None and {each for each, _ in self.reads} == {source}
            statement.copy = copy and alone and not part

    def _note(self, statement: Statement, to: Place | None) -> None:
        """What the statement read, and whether only where it then writes."""
        for array in {each for each, _ in self.reads}:
            same = to is not None and all(p == to for a, p in self.reads if a is array)
            (statement.there if same else statement.reads).add(array)

    @contextmanager
    def _loops(self, shape: Sequence[int]) -> Iterator[Index]:
        """Nested loops over `shape`; inside, the index of an element."""
        index, opened = [], []
        for length in shape:
            if length == 1:
                index.append(Place())
                continue
            name = f"i{len(self.scopes) - 1}"
            self.depth[name] = len(self.scopes)
            self.scopes.append(Scope(turns=length))
            opened.append((name, length))
            index.append(Place.variable(name))
        yield tuple(index)
        for name, length in reversed(opened):
            inner = self.scopes.pop()
            head = f"for (int32_t {name} = 0; {name} < {length}; {name}++) {{"
            lines = [head, *(f"    {line}" for line in inner.lines), "}"]
            self.scopes[-1].lines += lines

    def _line(self, text: str) -> None:
        self.scopes[-1].lines.append(text)

    def _new(self, value: Value, index: Index, letter: str = "x") -> str:
        """A named constant of the innermost scope."""
        text = self._computed(value, index)
        name, kind = self._name(letter), self._kind(value)
        self._line(f"const {self._declared(kind)} {name} = {_bare(text)};")
        return name

    # -- elements

    def _at(self, value: Value, index: Index) -> str:
        """The element of `value` at `index`, as an expression without side effects."""
        # axes of length 1 are alike to any other, as in NumPy
        index = tuple(p if n > 1 else Place() for p, n in zip(index, value.shape, strict=True))
        if value.array is not None:
            return self._constant(value, index)
        if id(value) in self.scalars:
            return self.scalars[id(value)]
        if id(value) in self.held:
            return self._load(self.held[id(value)], linear(index, value.shape))
        key = (id(value), index)
        for scope in self.scopes:
            if key in scope.names:
                return scope.names[key]
        level = max((self.depth[n] for each in index for n, _ in each.terms), default=0)
        inner, self.scopes = self.scopes, self.scopes[: level + 1]
        text = self._computed(value, index)
        source = value.source
        assert source is not None
        short = self.uses[id(value)] <= 1 and len(text) <= LONG and source.name not in FUNCTIONS
        if not _simple(text) and not short:
            name, kind = self._name("x"), self._kind(value)
            self._line(f"const {self._declared(kind)} {name} = {_bare(text)};")
            text = name
        self.scopes[-1].names[key] = text
        self.scopes = inner
        return text

    def _computed(self, value: Value, index: Index) -> str:
        each = value.source
        assert each is not None, "an input that was not given"
        if each.name in MAKERS:
            return MAKERS[each.name](self, each, index)
        if each.name in ELEMENTWISE:
            if each.name in ("div", "rem") and not _divides(each.inputs[1]):
                raise refused(each)
            arguments = [self._at(v, index if v.shape else ()) for v in each.inputs]
            kinds = [self._kind(v) for v in each.inputs]
            kind = "wide" if "wide" in kinds else kinds[0]
            text = self._function(each.name, arguments, kind)
            narrow = kind == "wide" and self._kind(value) == "real"
            return f"((real){text})" if narrow else text
        raise refused(each)

    def _function(self, name: str, arguments: Sequence[str], kind: Kind) -> str:
        infinite = {"max": "-INFINITY", "min": "INFINITY"}.get(name)
        if infinite is not None and infinite in arguments:
            return arguments[1 - list(arguments).index(infinite)]
        if name == "mul" and "1.0" in arguments:
            return arguments[1 - list(arguments).index("1.0")]
        self._done(name)
        text = ELEMENTWISE[name](arguments, kind, "" if kind == "wide" else self.suffix)
        if name == "tanh" and self.fast_tanh:
            text = f"fg_tanh({arguments[0]})"
        self._need(text)
        return text

    def _need(self, text: str) -> None:
        """The helper that an expression calls, if it does."""
        name = text[: text.find("(")]
        if name.startswith("fg_"):
            if name not in HELPERS:
                raise InputError(
                    "the model's step takes an extreme or a sign of truth values, which the C "
                    "printer has no form of; use `and`, `or` or `where`."
                )
            self.helpers.add(name)

    def _done(self, name: str, times: int = 1) -> None:
        """Count an operation as often as the open loops do it."""
        for scope in self.scopes:
            times *= scope.turns
        sort = "divisions and roots" if name in ("div", "sqrt", "rsqrt", "rem") else "simple"
        self.operations["functions" if name in FUNCTIONS else sort] += times * self.turns

    def _constant(self, value: Value, index: Index) -> str:
        array, kind = value.array, self._kind(value)
        assert array is not None
        for axis in range(array.ndim):  # along which all are alike
            first = np.take(array, [0], axis)
            if array.shape[axis] > 1 and _equal(array, first):
                array = first
        at = [p if n > 1 else Place() for p, n in zip(index, array.shape, strict=True)]
        if not any(p.terms for p in at):
            return literal(array[tuple(p.offset for p in at)].item(), kind, self.single)
        counted = _counting(array)
        if counted is not None:
            place = Place(counted[0])
            for p, factor in zip(at, counted[1:], strict=True):
                place = place + p * factor
            return f"({place.text})" if place.terms else place.text
        return f"{self.tables.of(array, kind)}[{linear(at, array.shape).text}]"

    def _load(self, array: Array, at: Place) -> str:
        self.reads.append((array, at))
        return self._in(array, at)

    def _in(self, array: Array, at: Place) -> str:
        """An element, wherever the array will lie: see `text`."""
        terms = Place(0, at.terms).text if at.terms else ""
        return f"@{self.arrays.index(array)}:{at.offset}:{terms}@"

    # -- what reads elements elsewhere

    def _broadcast(self, each: Operation, index: Index) -> str:
        value = each.inputs[0]
        at = tuple(
            index[d] if value.shape[k] > 1 else Place()
            for k, d in enumerate(each.params["broadcast_dimensions"])
        )
        return self._at(value, at)

    def _slice(self, each: Operation, index: Index) -> str:
        starts = each.params["start_indices"]
        steps = each.params["strides"] or [1] * len(starts)
        return self._at(
            each.inputs[0],
            tuple(p * int(n) + int(s) for p, s, n in zip(index, starts, steps, strict=True)),
        )

    def _transpose(self, each: Operation, index: Index) -> str:
        at = [Place()] * len(index)
        for k, axis in enumerate(each.params["permutation"]):
            at[axis] = index[k]
        return self._at(each.inputs[0], tuple(at))

    def _reshape(self, each: Operation, index: Index) -> str:
        value = each.inputs[0]
        if id(value) in self.held:
            return self._load(self.held[id(value)], linear(index, each.outputs[0].shape))
        long = iter(p for p, n in zip(index, each.outputs[0].shape, strict=True) if n != 1)
        return self._at(value, tuple(Place() if n == 1 else next(long) for n in value.shape))

    def _reverse(self, each: Operation, index: Index) -> str:
        value = each.inputs[0]
        turned = each.params["dimensions"]
        at = [p * -1 + (value.shape[k] - 1) if k in turned else p for k, p in enumerate(index)]
        return self._at(value, tuple(at))

    def _turn(self, each: Operation, index: Index) -> str:
        return self._at(each.inputs[0], (each.params["turn"].params["place"], *index))

    def _dynamic(self, each: Operation, index: Index) -> str:
        value, starts = each.inputs[0], each.inputs[1:]
        sizes = each.params["slice_sizes"]
        at = [
            p + self._place(s, (), n - size)
            for p, s, n, size in zip(index, starts, value.shape, sizes, strict=True)
        ]
        return self._at(value, tuple(at))

    def _place(self, value: Value, index: Index, last: int) -> Place:
        """The integer at `index` as a place between 0 and `last`."""
        if last <= 0:
            return Place()
        if value.array is not None:
            array = np.clip(value.array, 0, last)
            fixed = not any(p.terms for p in index)
            if fixed:
                return Place(int(array[tuple(p.offset for p in index)]))
            counted = _counting(array)
            if counted is not None and array.ndim == len(index):
                place = Place(counted[0])
                for p, factor in zip(index, counted[1:], strict=True):
                    place = place + p * factor
                return place
            text = self._constant(Value(array.shape, array.dtype, array, True), index)
            text = f"(int32_t){text}"
        else:
            text = f"fg_at({self._at(value, index)}, {last})"
            self.helpers.add("fg_at")
        level = len(self.scopes) - 1
        key = (id(value), (*index, Place(last)))
        for scope in self.scopes:
            if key in scope.names:
                return Place.variable(scope.names[key])
        name = self._name("k")
        self._line(f"const int32_t {name} = {text};")
        self.depth[name] = level
        self.scopes[-1].names[key] = name
        return Place.variable(name)

    def _gathered(self, each: Operation, index: Index) -> str:
        value, starts = each.inputs
        numbers = each.params["dimension_numbers"]
        sizes = each.params["slice_sizes"]
        batch = [p for d, p in enumerate(index) if d not in numbers.offset_dims]
        window = [index[d] for d in numbers.offset_dims]
        fill = "FILL" in str(each.params["mode"])
        axes = _Axes.of(
            numbers.start_index_map,
            numbers.collapsed_slice_dims,
            numbers.operand_batching_dims,
            numbers.start_indices_batching_dims,
        )
        at, inside = self._window(value, starts, batch, window, sizes, fill, axes)
        text = self._at(value, at)
        if inside:
            kind = self._kind(value)
            empty = "NAN" if kind in FLOATS else "0"
            text = f"({' && '.join(inside)} ? {text} : {empty})"
        return text

    def _window(
        self,
        value: Value,
        starts: Value,
        batch: Sequence[Place],
        window: Sequence[Place],
        sizes: Sequence[int],
        checked: bool,
        axes: "_Axes",
    ) -> tuple[Index, list[str]]:
        """(where in `value` an element of a window lies, what must hold for it to be inside)."""
        inner, at, inside = iter(window), [], []
        for d, length in enumerate(value.shape):
            place = Place()
            if d in axes.mapped:
                j = axes.mapped.index(d)
                last = length - int(sizes[d])
                which = (*batch, Place(j))
                place = self._place(starts, which, last)
                if checked and not _within(starts, j, last):
                    text = self._at(starts, which)
                    inside += [f"{text} >= 0", f"{text} <= {last}"]
            if d in axes.batched:
                place = place + batch[axes.theirs[axes.batched.index(d)]]
            elif d not in axes.dropped:
                place = place + next(inner)
            at.append(place)
        return tuple(at), inside

    def _select(self, each: Operation, index: Index) -> str:
        which, *cases = each.inputs
        choice = self._at(which, index if which.shape else ())
        texts = [self._at(v, index if v.shape else ()) for v in cases]
        self._done("select")
        if len(cases) == 2:
            test = choice if self._kind(which) == "bool" else f"{choice} != 0"
            return f"({test} ? {texts[1]} : {texts[0]})"
        found = texts[-1]
        for k in range(len(texts) - 2, -1, -1):
            found = f"({choice} <= {k} ? {texts[k]} : {found})"
        return found

    def _clamp(self, each: Operation, index: Index) -> str:
        low, value, high = (self._at(v, index if v.shape else ()) for v in each.inputs)
        kind = self._kind(each.outputs[0])
        inner = self._function("max", [value, low], kind)
        return self._function("min", [inner, high], kind)

    def _converted(self, each: Operation, index: Index) -> str:
        before, after = self._kind(each.inputs[0]), self._kind(each.outputs[0])
        text = self._at(each.inputs[0], index)
        if after == "bool":
            return text if before == "bool" else f"({text} != 0)"
        if before == after or {before, after} == {*FLOATS}:
            return text
        if before == "bool":
            return f"({text} ? {literal(1, after, self.single)} : {literal(0, after, self.single)})"
        if before in FLOATS:
            name = f"fg_int_{LETTERS[after]}"
            self.helpers.add(name)
            return f"{name}((real){text})" if before == "wide" else f"{name}({text})"
        return f"(({after}){text})"

    def _powered(self, each: Operation, index: Index) -> str:
        y, kind = each.params["y"], self._kind(each.inputs[0])
        text = self._at(each.inputs[0], index)
        if not _simple(text):
            name = self._name("x")
            self._line(f"const {self._declared(kind)} {name} = {_bare(text)};")
            text = name
        self._done("mul", max(abs(y) - 1, 1))
        # by squares, as XLA does it
        power, found = text, ""
        n = abs(y)
        while n:
            if n & 1:
                found = f"{found} * {power}" if found else power
            n >>= 1
            if n:
                name = self._name("x")
                self._line(f"const {self._declared(kind)} {name} = {power} * {power};")
                power = name
        found = f"({found})" if y != 0 else literal(1, kind, self.single)
        if y >= 0:
            return found
        self._done("div")
        return f"({literal(1, kind, self.single)} / {found})"

    def _rounded(self, each: Operation, index: Index) -> str:
        even = "EVEN" in str(each.params["rounding_method"])
        name = "rint" if even else "round"
        self._done("round")
        return f"{name}{self.suffix}({self._at(each.inputs[0], index)})"

    def _inverse(self, each: Operation, index: Index) -> str:
        self._done("erf_inv", 4)
        self.helpers.add("fg_erf_inv")
        return f"fg_erf_inv({self._at(each.inputs[0], index)})"

    # -- what reads many elements

    def _reduced(self, each: Operation, index: Index) -> str:
        value, kind = each.inputs[0], self._kind(each.outputs[0])
        axes = [int(a) for a in each.params["axes"]]
        start, update = REDUCED[each.name]
        name = self._name("s")
        if kind not in (*FLOATS, "bool") and np.isinf(start):
            bits = 63 if kind == "int64_t" else 31
            start = 2**bits - 1 if start > 0 else -(2**bits) + 1
        self._line(f"{self._declared(kind)} {name} = {literal(start, kind, self.single)};")
        with self._loops([value.shape[a] for a in axes]) as inner:
            outer, more = iter(index), dict(zip(axes, inner, strict=True))
            at = tuple(more[k] if k in more else next(outer) for k in range(len(value.shape)))
            text = update.format(name, self._at(value, at), LETTERS[kind])
            self._done("add")
            self._need(text[text.find("=") + 2 :])
            self._line(text)
        return name

    def _dot(self, each: Operation, index: Index) -> str:
        (lhs_sum, rhs_sum), (lhs_batch, rhs_batch) = each.params["dimension_numbers"]
        lhs, rhs = each.inputs
        if self._kind(each.outputs[0]) == "bool":
            raise refused(each)
        lhs_free = [k for k in range(len(lhs.shape)) if k not in (*lhs_sum, *lhs_batch)]
        rhs_free = [k for k in range(len(rhs.shape)) if k not in (*rhs_sum, *rhs_batch)]
        batch = index[: len(lhs_batch)]
        left = index[len(batch) : len(batch) + len(lhs_free)]
        right = index[len(batch) + len(lhs_free) :]
        name, kind = self._name("s"), self._kind(each.outputs[0])
        lengths = [lhs.shape[k] for k in lhs_sum]

        def product(inner: Index) -> str:
            a, b = {}, {}
            for where, groups in (
                (a, ((lhs_batch, batch), (lhs_free, left), (lhs_sum, inner))),
                (b, ((rhs_batch, batch), (rhs_free, right), (rhs_sum, inner))),
            ):
                for axes, places in groups:
                    where |= dict(zip(map(int, axes), places, strict=True))
            one = self._at(lhs, tuple(a[k] for k in range(len(lhs.shape))))
            other = self._at(rhs, tuple(b[k] for k in range(len(rhs.shape))))
            return self._function("mul", [one, other], kind)

        if prod(lengths) == 1:
            return product((Place(),) * len(lengths))
        self._line(f"{self._declared(kind)} {name} = {literal(0, kind, self.single)};")
        with self._loops(lengths) as inner:
            self._done("add")
            self._line(f"{name} += {_bare(product(inner))};")
        return name

    def _extreme(self, each: Operation, index: Index) -> str:
        """The first of the largest (smallest) elements, or of those that are no number."""
        value = each.inputs[0]
        (axis,) = (int(a) for a in each.params["axes"])
        sign, kind = (">" if each.name == "argmax" else "<"), self._kind(value)
        into = self._kind(each.outputs[0])
        place, best, real = self._name("s"), self._name("s"), self._declared(kind)
        first = self._at(value, (*index[:axis], Place(), *index[axis:]))
        self._line(f"{into} {place} = 0;")
        self._line(f"{real} {best} = {first};")
        with self._loops([value.shape[axis]]) as (step,):
            now = self._name("x")
            text = self._at(value, (*index[:axis], step, *index[axis:]))
            self._line(f"const {real} {now} = {text};")
            nan = f" || ({now} != {now} && {best} == {best})" if kind in FLOATS else ""
            self._done("max")
            self._line(f"if ({now} {sign} {best}{nan}) {{")
            self._line(f"    {best} = {now};")
            self._line(f"    {place} = {step.text};")
            self._line("}")
        return place

    # -- what is written part by part

    def _whole(self, each: Operation, into: Array) -> None:
        match each.name:
            case "concatenate" | "stack":
                self._joined(each, into)
            case "pad":
                self._padded(each, into)
            case "dynamic_update_slice":
                self._updated(each, into)
            case _ if each.name in UPDATES:
                self._scattered(each, into)
            case _ if each.name in RUNNING:
                self._running(each, into)
            case _:
                raise refused(each)

    def _joined(self, each: Operation, into: Array) -> None:
        out, first = each.outputs[0], True
        stacked = each.name == "stack"
        axis = int(each.params["axis" if stacked else "dimension"]) % len(out.shape)
        at = 0
        for value in each.inputs:
            if value.size == 0:
                continue
            with self._statement() as statement:
                with self._loops(value.shape) as index:
                    if stacked:
                        to = (*index[:axis], Place(at), *index[axis:])
                    else:
                        to = (*index[:axis], index[axis] + at, *index[axis + 1 :])
                    text = self._at(value, index)
                    self._line(f"{self._in(into, linear(to, out.shape))} = {text};")
                statement.writes, statement.part = {into}, not first
                self._note(statement, None)
            first, at = False, at + (1 if stacked else value.shape[axis])

    def _padded(self, each: Operation, into: Array) -> None:
        value, fill = each.inputs
        out, config = each.outputs[0], each.params["padding_config"]
        if any(low < 0 or high < 0 for low, high, _ in config):
            raise refused(each)
        with self._statement() as statement:
            with self._loops(out.shape) as index:
                text = self._at(fill, ())
                self._line(f"{self._in(into, linear(index, out.shape))} = {text};")
            statement.writes = {into}
            self._note(statement, None)
        with self._statement() as statement:
            with self._loops(value.shape) as index:
                to = [
                    p * int(inner + 1) + int(low)
                    for p, (low, _, inner) in zip(index, config, strict=True)
                ]
                text = self._at(value, index)
                self._line(f"{self._in(into, linear(to, out.shape))} = {text};")
            statement.writes, statement.part = {into}, True
            self._note(statement, None)

    def _updated(self, each: Operation, into: Array) -> None:
        value, new, *starts = each.inputs
        self._store(value, into, copy=True)
        with self._statement() as statement:
            at = [
                self._place(s, (), n - m)
                for s, n, m in zip(starts, value.shape, new.shape, strict=True)
            ]
            with self._loops(new.shape) as index:
                to = linear([a + p for a, p in zip(at, index, strict=True)], value.shape)
                text = self._at(new, index)
                self._line(f"{self._in(into, to)} = {text};")
            statement.writes, statement.part = {into}, True
            self._note(statement, None)

    def _scattered(self, each: Operation, into: Array) -> None:
        value, starts, new = each.inputs
        numbers, kind = each.params["dimension_numbers"], self._kind(value)
        self._store(value, into, copy=True)
        dropped = numbers.inserted_window_dims
        batched = numbers.operand_batching_dims
        sizes = [1] * len(value.shape)
        windows = [d for d in range(len(value.shape)) if d not in (*dropped, *batched)]
        for d, k in zip(windows, numbers.update_window_dims, strict=True):
            sizes[d] = new.shape[k]
        checked = "CLIP" not in str(each.params["mode"])
        with self._statement() as statement:
            with self._loops(new.shape) as index:
                batch = [p for d, p in enumerate(index) if d not in numbers.update_window_dims]
                window = [index[d] for d in numbers.update_window_dims]
                axes = _Axes.of(
                    numbers.scatter_dims_to_operand_dims,
                    dropped,
                    batched,
                    numbers.scatter_indices_batching_dims,
                )
                at, inside = self._window(value, starts, batch, window, sizes, checked, axes)
                text = self._at(new, index)
                cell = self._in(into, linear(at, value.shape))
                line = UPDATES[each.name].format(cell, _bare(text), LETTERS[kind])
                self._need(line[line.find("=") + 2 :])
                self._done("add")
                if inside:
                    self._line(f"if ({' && '.join(inside)}) {{")
                    self._line(f"    {line}")
                    self._line("}")
                else:
                    self._line(line)
            statement.writes, statement.part = {into}, True
            self._note(statement, None)

    def _running(self, each: Operation, into: Array) -> None:
        value, kind = each.inputs[0], self._kind(each.inputs[0])
        axis, back = int(each.params["axis"]), each.params["reverse"]
        length = value.shape[axis]
        rest = [1 if k == axis else n for k, n in enumerate(value.shape)]
        with self._statement() as statement:
            with self._loops(rest) as outer:
                name = self._name("s")

                def place(p: Place) -> Index:
                    along = p * -1 + (length - 1) if back else p
                    return tuple(along if k == axis else q for k, q in enumerate(outer))

                first = place(Place())
                self._line(f"{self._declared(kind)} {name} = {self._at(value, first)};")
                self._line(f"{self._in(into, linear(first, value.shape))} = {name};")
                if length > 1:
                    with self._loops([length - 1]) as (step,):
                        at = place(step + 1)
                        text = self._at(value, at)
                        text = RUNNING[each.name].format(name, text, LETTERS[kind])
                        self._need(text)
                        self._done("add")
                        self._line(f"{name} = {text};")
                        self._line(f"{self._in(into, linear(at, value.shape))} = {name};")
            statement.writes = {into}
            self._note(statement, None)

    def _sort(self, each: Operation) -> None:
        """By insertion, row by row: what is equal stays in order, what is no number comes last."""
        if each.params["num_keys"] != 1:
            raise refused(each)
        arrays = []
        for value, out in zip(each.inputs, each.outputs, strict=True):
            array = self._array(out)
            self._store(value, array, copy=True)
            self.held[id(out)] = array
            arrays.append(array)
        shape, axis = each.outputs[0].shape, int(each.params["dimension"])
        kinds = [self._kind(v) for v in each.inputs]
        rest = [1 if k == axis else n for k, n in enumerate(shape)]
        if shape[axis] < 2:
            return
        with self._statement() as statement:
            with self._loops(rest) as outer, self._loops([shape[axis] - 1]) as (step,):

                def cell(array: Array, p: Place) -> str:
                    at = tuple(p if k == axis else q for k, q in enumerate(outer))
                    return self._in(array, linear(at, shape))

                own = [self._name("x") for _ in arrays]
                j = self._name("j")
                for name, array, kind in zip(own, arrays, kinds, strict=True):
                    text = cell(array, step + 1)
                    self._line(f"const {self._declared(kind)} {name} = {text};")
                self._line(f"int32_t {j} = {step.text};")
                now, key = cell(arrays[0], Place.variable(j)), own[0]
                last = f" || ({now} != {now} && {key} == {key})" if kinds[0] in FLOATS else ""
                self._done("max", shape[axis])
                self._line(f"while ({j} >= 0 && ({now} > {key}{last})) {{")
                for array in arrays:
                    here, up = cell(array, Place.variable(j)), cell(array, Place.variable(j) + 1)
                    self._line(f"    {up} = {here};")
                self._line(f"    {j}--;")
                self._line("}")
                for name, array in zip(own, arrays, strict=True):
                    self._line(f"{cell(array, Place.variable(j) + 1)} = {name};")
            statement.writes, statement.part = set(arrays), True

    # -- names

    def _name(self, letter: str) -> str:
        self.count += 1
        return f"{letter}{self.count}"

    def _kind(self, value: Value) -> Kind:
        return "wide" if id(value) in self.wide else kind_of(value.dtype)

    def _declared(self, kind: Kind) -> str:
        return "_Bool" if kind == "bool" else kind

    def _array(self, value: Value, fixed: str | None = None) -> Array:
        array = Array(value.size, self._kind(value), fixed)
        self.arrays.append(array)
        return array


Maker = Callable[[Printer, Operation, Index], str]
MAKERS: dict[str, Maker] = {
    "broadcast_in_dim": Printer._broadcast,
    "slice": Printer._slice,
    "transpose": Printer._transpose,
    "reshape": Printer._reshape,
    "squeeze": Printer._reshape,
    "expand_dims": Printer._reshape,
    "rev": Printer._reverse,
    "turn_of": Printer._turn,
    "dynamic_slice": Printer._dynamic,
    "gather": Printer._gathered,
    "select_n": Printer._select,
    "clamp": Printer._clamp,
    "convert_element_type": Printer._converted,
    "integer_pow": Printer._powered,
    "round": Printer._rounded,
    "erf_inv": Printer._inverse,
    "dot_general": Printer._dot,
    "argmax": Printer._extreme,
    "argmin": Printer._extreme,
    **dict.fromkeys(REDUCED, Printer._reduced),
}


def refused(each: Operation) -> InputError:
    shapes = ", ".join(str(list(v.shape)) for v in each.inputs)
    return InputError(
        f"the model's step uses {each.name!r} of arrays {shapes}, which the C printer has no form "
        "of; write that part of the plant in other operations (docs/export.md lists them)."
    )


def _divides(value: Value) -> bool:
    """Whether every number may stand under an integer one."""
    if value.dtype.kind == "f":
        return True
    return value.array is not None and bool(np.all(value.array > 0))


def _uses(block: Block) -> Iterator[int]:
    yield from map(id, block.outputs)
    for each in block.operations:
        yield from map(id, each.inputs)
        for inner in each.blocks:
            yield from _uses(inner)


def _simple(text: str) -> bool:
    """A name, a number or an element: nothing to compute."""
    return not any(c in text for c in "(?") and " " not in _without_places(text)


def _without_places(text: str) -> str:
    """`text` without the indices of its elements."""
    return re.sub(r"@[^@]*@|\[[^\]]*\]", "a", text)


def _bare(text: str) -> str:
    """`text` without parentheses around all of it."""
    if not (text.startswith("(") and text.endswith(")")):
        return text
    depth = 0
    for k, c in enumerate(text):
        depth += {"(": 1, ")": -1}.get(c, 0)
        if depth == 0 and k < len(text) - 1:
            return text
    return text[1:-1]


def _equal(array: np.ndarray, first: np.ndarray) -> bool:
    if array.dtype.kind == "f":
        return bool(np.all((array == first) | (np.isnan(array) & np.isnan(first))))
    return bool(np.all(array == first))


def _counting(array: np.ndarray) -> list[int] | None:
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


def _within(starts: Value, j: int, last: int) -> bool:
    """Whether all places that are known lie inside."""
    if starts.array is None:
        return False
    places = starts.array[..., j]
    return bool(np.all((places >= 0) & (places <= last)))
