"""A program as statements of C: loops over static shapes, one for every array that is kept."""

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from faultgauge.errors import InputError
from faultgauge.export.constants import element_of
from faultgauge.export.elementwise import ELEMENTWISE, FLOATS, HELPERS, Kind, kind_of
from faultgauge.export.fusion import FUNCTIONS, kept_values, ordered_values, whole
from faultgauge.export.mathematics import INLINE, NEEDED
from faultgauge.export.memory import Array, Node, Statement
from faultgauge.export.nests import Nest, merged
from faultgauge.export.places import ELEMENT, Place, linear
from faultgauge.export.program import OpBlock, Operation, Program, Value
from faultgauge.export.tables import Tables

__all__ = ["Cut", "Forms", "Index", "Printer", "bare", "refused", "simple"]

Index = tuple[Place, ...]
LONG = 60  # characters of an expression that gets a name
NUMBER = re.compile(r"-?[0-9][0-9.e+-]*f?$")
TEST = re.compile(r"\(isfinite\(x[0-9]+\) != 0\)")  # of a constant
UNCHANGED = {"and": "1", "or": "0"}  # what leaves the other truth value as it is
EDGES = {"max": "atleast", "min": "atmost"}  # of which one side is a number: quicker


@dataclass
class OpenScope:
    """A loop that is open, or the statement around it: its lines, and what has a name in it."""

    body: list[str | Nest] = field(default_factory=list)
    names: dict[tuple[int, Index], str] = field(default_factory=dict)
    turns: int = 1


@dataclass
class Span:
    """What a loop variable runs through: of the loop `over`, `length` turns from `first` on."""

    over: tuple[int, int]
    first: int
    length: int


class Cut(Exception):  # noqa: N818 (it is how a loop learns where to be cut)
    """A loop must be two, `at` one of its turns: what it reads there comes from elsewhere."""

    def __init__(self, over: tuple[int, int], at: int) -> None:
        self.over, self.at = over, at


@dataclass(frozen=True)
class Forms:
    """How operations are printed, by name: an element at an index, as an expression; a whole array,
    part by part; or with all that they hold."""

    elements: "dict[str, Callable[[Printer, Operation, Index], str]]"
    whole: "dict[str, Callable[[Printer, Operation, Array], None]]"
    control: "dict[str, Callable[[Printer, Operation], None]]"


class Printer:
    """Prints one program in the `forms` that operations have. `operations` counts what one run
    does at most; `helpers` are the C functions that it needs."""

    def __init__(
        self,
        program: Program,
        forms: "Forms",
        tables: Tables,
        single: bool,
        fast_tanh: bool,
        inline: bool,
        wide: Collection[int] = (),
    ) -> None:
        self.program, self.forms = program, forms
        self.tables, self.single = tables, single
        self.wide = wide  # ids of values
        self.suffix = "f" if single else ""
        self.fast_tanh, self.inline = fast_tanh, inline
        self.kept, self.in_order = kept_values(program), ordered_values(program)
        self.uses = Counter(_uses(program.body))
        self.arrays: list[Array] = []
        self.numbers: dict[Array, int] = {}  # their places in `arrays`
        self.held: dict[int, Array] = {}  # by the id of the value
        self.helpers: set[str] = set()
        self.operations: Counter[str] = Counter()
        self.nodes: list[Node] = []
        self.scopes: list[OpenScope] = []
        self.depth: dict[str, int] = {}  # of the scope that a variable belongs to
        self.spans: dict[str, Span] = {}  # by variable, of the loops of a statement
        self.cuts: dict[tuple[int, int], set[int]] = {}
        self.reads: list[tuple[Array, bool]] = []  # and whether where it is written, or ahead
        self.to: Place | None = None  # where the element that is printed goes
        self.turns = 1
        self.count = 0

    # -- blocks

    def run(self) -> list[Node]:
        """All statements; what the program leaves is where `leave` says."""
        self.block(self.program.body)
        return self.nodes

    def given(self, value: Value, member: str) -> None:
        """`value` comes in as `member`."""
        self.held[id(value)] = self.array(value, fixed=member)

    def leave(self, values: Sequence[Value], members: Sequence[str]) -> None:
        """Put the program's outputs to where they go: all are read before one is overwritten."""
        here = {each.fixed: each for each in self.arrays if each.fixed}
        taken = {}
        for value, member in zip(values, members, strict=True):
            old = self.held.get(id(value))
            if old is not None and old.fixed is not None and old.fixed != member:
                taken[member] = self.copied(value)
        for value, member in zip(values, members, strict=True):
            into = here.get(member) or self.array(value, fixed=member)
            if member in taken:
                self.move(taken[member], into)
            elif self.held.get(id(value)) is not into:
                self.store(value, into, copy=True)

    def block(self, block: OpBlock) -> None:
        for each in block.operations:
            self._operation(each)

    def _operation(self, each: Operation) -> None:
        if each.name in self.forms.control:
            self.forms.control[each.name](self, each)
        elif id(each.outputs[0]) in self.kept:
            value = each.outputs[0]
            array = self.array(value)
            array.longest_last = id(value) not in self.in_order
            if whole(each):
                if each.name not in self.forms.whole:
                    raise refused(each)
                self.forms.whole[each.name](self, each, array)
            else:
                self.store(value, array)
            self.held[id(value)] = array

    # -- statements

    def statement(
        self, write: Callable[[], None], writes: set[Array], *, part: bool = False
    ) -> Statement:
        """What `write` prints becomes one statement."""
        self.cuts = {}
        while True:
            before = self.count, self.operations.copy(), set(self.helpers)
            self.scopes, self.reads, self.to = [OpenScope()], [], None
            try:
                write()
                break
            except Cut as cut:
                self.cuts.setdefault(cut.over, set()).add(cut.at)
                self.count, self.operations, self.helpers = before
        statement = Statement(merged(self.scopes[0].body), writes, part=part)
        self.scopes, self.to = [], None
        for array in {each for each, _ in self.reads}:
            there = all(ahead for each, ahead in self.reads if each is array)
            (statement.there if there else statement.reads).add(array)
        self.nodes.append(statement)
        return statement

    def store(
        self,
        value: Value,
        into: Array,
        *,
        head: Place | None = None,
        part: bool = False,
        copy: bool = False,
    ) -> None:
        """`value` in memory, element by element; `head` is where its first one goes."""
        if value.size == 0:
            return
        source = self.held.get(id(value))

        def one(index: Index) -> None:
            self.to = self.placed(into, index, value.shape) + (head or Place())
            text = self.at(value, index)
            self.line(f"{self.cell(into, self.to)} = {bare(text)};")

        def write() -> None:
            self.loops(value, value.shape, one, order=self.order(into, value.shape))

        statement = self.statement(write, {into}, part=part)
        alone = source is not None and statement.reads | statement.there == {source}
        statement.copy = copy and alone and not part

    def move(self, source: Array, into: Array) -> None:
        def one(index: Index) -> None:
            (self.to,) = index
            self.line(f"{self.cell(into, self.to)} = {self.load(source, self.to)};")

        self.statement(lambda: self.loops(source, [source.size], one), {into}).copy = True

    def copied(self, value: Value) -> Array:
        into = self.array(value)
        self.store(value, into, copy=True)
        return into

    def loops(
        self,
        owner: object,
        shape: Sequence[int],
        body: Callable[[Index], None],
        pragma: str = "",
        order: Sequence[int] = (),
    ) -> None:
        """Nested loops over `shape` around what `body` prints at an index; `owner` is what they
        run over, by which they are cut; the innermost one has the `pragma`; the `order` is that of
        the axes, from the outermost loop on."""
        order = order or range(len(shape))

        def inner(turn: int, index: dict[int, Place]) -> None:
            if turn == len(shape):
                body(tuple(index[k] for k in range(len(shape))))
                return
            axis = order[turn]
            over = (id(owner), axis)
            for first, end in pairwise([0, *sorted(self.cuts.get(over, ())), shape[axis]]):
                if end - first == 1:
                    inner(turn + 1, {**index, axis: Place(first)})
                    continue
                name = f"i{len(self.scopes) - 1}"
                self.depth[name] = len(self.scopes)
                self.spans[name] = Span(over, first, end - first)
                self.scopes.append(OpenScope(turns=end - first))
                inner(turn + 1, {**index, axis: Place.variable(name) + first})
                scope = self.scopes.pop()
                if scope.body:
                    own = pragma if turn == len(shape) - 1 else ""
                    self.scopes[-1].body.append(Nest(name, end - first, scope.body, own))

        inner(0, {})

    def line(self, text: str) -> None:
        self.scopes[-1].body.append(text)

    # -- elements

    def at(self, value: Value, index: Index) -> str:
        """The element of `value` at `index`, as an expression without side effects."""
        # axes of length 1 are alike to any other, as in NumPy
        index = tuple(p if n > 1 else Place() for p, n in zip(index, value.shape, strict=True))
        if value.array is not None:
            return element_of(value.array, self.kind(value), index, self.tables)
        if id(value) in self.held:
            array = self.held[id(value)]
            return self.load(array, self.placed(array, index, value.shape))
        key = (id(value), index)
        for scope in self.scopes:
            if key in scope.names:
                return scope.names[key]
        level = max((self.depth[n] for each in index for n, _ in each.terms), default=0)
        inner, self.scopes = self.scopes, self.scopes[: level + 1]
        try:
            text = self._computed(value, index)
            source = value.source
            assert source is not None
            # a test of a constant is as short as a name of it, and shows what is guarded
            short = TEST.fullmatch(text) or (self.uses[id(value)] <= 1 and len(text) <= LONG)
            if not simple(text) and not (short and source.name not in FUNCTIONS):
                text = self.named(text, self.kind(value))
            self.scopes[-1].names[key] = text
        finally:
            self.scopes = inner
        return text

    def named(self, text: str, kind: Kind) -> str:
        """`text` as a constant of the innermost scope."""
        name = self.name("x")
        self.line(f"const {self.declared(kind)} {name} = {bare(text)};")
        return name

    def _computed(self, value: Value, index: Index) -> str:
        each = value.source
        assert each is not None, "an input that was not given"
        if each.name in self.forms.elements:
            return self.forms.elements[each.name](self, each, index)
        if each.name in ELEMENTWISE:
            if each.name in ("div", "rem") and not _divides(each.inputs[1]):
                raise refused(each)
            name, given = each.name, list(each.inputs)
            if name == "div" and self.inline and (inverse := _inverse(given[1])):
                name, given[1] = "mul", inverse
            arguments = [self.at(v, index if v.shape else ()) for v in given]
            kinds = [self.kind(v) for v in given]
            kind = "wide" if "wide" in kinds else kinds[0]
            text = self.function(name, arguments, kind)
            narrow = kind == "wide" and self.kind(value) == "real"
            return f"((real){text})" if narrow else text
        raise refused(each)

    def function(self, name: str, arguments: Sequence[str], kind: Kind) -> str:
        infinite = {"max": "-INFINITY", "min": "INFINITY"}.get(name)
        if infinite is not None and infinite in arguments:
            return arguments[1 - list(arguments).index(infinite)]
        if name == "mul" and "1.0" in arguments:
            return arguments[1 - list(arguments).index("1.0")]
        if name in UNCHANGED and kind == "bool" and not {"0", "1"}.isdisjoint(arguments):
            first, other = sorted(arguments, key=lambda a: a not in ("0", "1"))
            return other if first == UNCHANGED[name] else first
        if name in EDGES and any(map(NUMBER.match, arguments)):
            name, arguments = EDGES[name], sorted(arguments, key=lambda a: bool(NUMBER.match(a)))
        self.done(name)
        text = ELEMENTWISE[name](arguments, kind, "" if kind == "wide" else self.suffix)
        if name == "tanh" and self.fast_tanh:
            text = f"fg_tanh({arguments[0]})"
        if name in INLINE and self.inline and kind in FLOATS and not self.single:
            text = f"fg_{name}({arguments[0]})"
            self.helpers.update(f"fg_{each}" for each in NEEDED[name])
        self.need(text)
        return text

    def need(self, text: str) -> None:
        """The helper that an expression calls, if it does."""
        name = text[: text.find("(")]
        if name.startswith("fg_"):
            if name not in HELPERS:
                raise InputError(
                    "the model's step takes an extreme or a sign of truth values, which the C "
                    "printer has no form of; use `and`, `or` or `where`."
                )
            self.helpers.add(name)

    def done(self, name: str, times: int = 1) -> None:
        """Count an operation as often as the open loops do it."""
        for scope in self.scopes:
            times *= scope.turns
        sort = "divisions and roots" if name in ("div", "sqrt", "rsqrt", "rem") else "simple"
        self.operations["functions" if name in FUNCTIONS else sort] += times * self.turns

    def order(self, array: Array, shape: Sequence[int]) -> Sequence[int]:
        """The axes of an array of this `shape`, the one that runs fastest in memory last."""
        axes = range(len(shape))
        if not array.longest_last or not shape:
            return axes
        longest = max(axes, key=lambda k: (shape[k], k))
        return [*(k for k in axes if k != longest), longest]

    def placed(self, array: Array, index: Index, shape: Sequence[int]) -> Place:
        """Where in `array`, of this `shape`, the element at `index` lies."""
        order = self.order(array, shape)
        return linear([index[k] for k in order], [shape[k] for k in order])

    def load(self, array: Array, at: Place) -> str:
        apart = None if self.to is None else at + self.to * -1
        # loops write from the first element to the last: what lies ahead is as it was
        ahead = apart is not None and not apart.terms and apart.offset >= 0
        self.reads.append((array, ahead))
        return self.cell(array, at)

    def cell(self, array: Array, at: Place) -> str:
        """An element, wherever the array will lie: see `places`."""
        return f"@{self.numbers[array]}:{at.coded}@"

    # -- names

    def name(self, letter: str) -> str:
        self.count += 1
        return f"{letter}{self.count}"

    def kind(self, value: Value) -> Kind:
        return "wide" if id(value) in self.wide else kind_of(value.dtype)

    def declared(self, kind: Kind) -> str:
        return "_Bool" if kind == "bool" else kind

    def array(self, value: Value, fixed: str | None = None) -> Array:
        scalar = fixed is not None and value.shape == ()
        array = Array(value.size, self.kind(value), fixed, scalar)
        self.numbers[array] = len(self.arrays)
        self.arrays.append(array)
        return array


def refused(each: Operation) -> InputError:
    """What is said of an operation that has no form in C."""
    shapes = ", ".join(str(list(v.shape)) for v in each.inputs)
    return InputError(
        f"the model's step uses {each.name!r} of arrays {shapes}, which the C printer has no form "
        "of; write that part of the plant in other operations (docs/export.md lists them)."
    )


def _divides(value: Value) -> bool:
    """Whether every number may stand under an integer one."""
    if value.dtype.kind == "f":
        return True
    return value.array is not None and bool((value.array > 0).all())


def _inverse(value: Value) -> Value | None:
    """1 / `value` where that is known, and a number."""
    if value.array is None or value.dtype.kind != "f":
        return None
    with np.errstate(all="ignore"):
        array = np.asarray(1 / value.array)
    fine = np.isfinite(array) & (np.abs(array) > np.finfo(array.dtype).tiny)
    return Value(value.shape, value.dtype, array, True) if fine.all() else None


def _uses(block: OpBlock) -> Iterator[int]:
    yield from map(id, block.outputs)
    for each in block.operations:
        yield from map(id, each.inputs)
        for inner in each.blocks:
            yield from _uses(inner)


def simple(text: str) -> bool:
    """A name, a number or an element: nothing to compute."""
    return not any(c in text for c in "(?") and " " not in ELEMENT.sub("a", text)


def bare(text: str) -> str:
    """`text` without parentheses around all of it."""
    if not (text.startswith("(") and text.endswith(")")):
        return text
    depth = 0
    for k, c in enumerate(text):
        depth += {"(": 1, ")": -1}.get(c, 0)
        if depth == 0 and k < len(text) - 1:
            return text
    return text[1:-1]
