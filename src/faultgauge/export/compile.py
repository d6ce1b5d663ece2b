"""A pure step `step(state, sample) -> (state, info)` as C99 text."""

import re
import unicodedata
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import numpy as np

from faultgauge.export.elementwise import HELPERS, LETTERS, Kind, kind_of, truth
from faultgauge.export.forms import FORMS
from faultgauge.export.functions import Functions
from faultgauge.export.memory import Node, place
from faultgauge.export.places import ELEMENT, Place
from faultgauge.export.printing import Printer
from faultgauge.export.program import Program, trace
from faultgauge.export.ranges import narrowed
from faultgauge.export.tables import Tables
from faultgauge.export.widths import wide_values

__all__ = ["ExportedStep", "Member", "Printed", "identifier", "print_step"]

WORDS = """auto break case char const continue default do double else enum extern float for goto if
inline int long register restrict return short signed sizeof static struct switch typedef union
unsigned void volatile while real wide bool class new this and or not xor template"""
TAKEN = frozenset(re.findall(r"\w+", WORDS))
BYTES = {"wide": 8, "bool": 1, "int32_t": 4, "int64_t": 8}


@dataclass(frozen=True)
class ExportedStep:
    """What is exported: a pure `step(state, sample) -> (state, info)` of pytrees of arrays, all of
    fixed shapes, the `state` that it begins with, and the form of a `sample`, by name. `comments`
    say by name what a member of sample or info is, and in which unit; `examples` makes as many
    samples as one wants, on which a test can run, where there is to be one; `codes` are names of
    numbers, by what they begin with; `times` are the names of inputs and members of the state that
    count seconds from the beginning; `units` are by name again."""

    step: Callable[[Any, Any], tuple[Any, Any]]
    state: Any
    sample: Any
    comments: dict[str, str]
    examples: Callable[[int, np.random.Generator], dict[str, np.ndarray]] | None = None
    codes: dict[str, tuple[str, ...]] = field(default_factory=dict)
    times: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Member:
    """Of a struct: an array of C, or a scalar where the shape is ()."""

    name: str
    kind: Kind
    shape: tuple[int, ...]
    comment: str = ""
    unit: str = ""

    @property
    def size(self) -> int:
        return int(np.prod(self.shape, dtype=int))

    @property
    def line(self) -> str:
        long = f"[{self.size}]" if self.shape else ""
        words = [str(list(self.shape))] if len(self.shape) > 1 else []
        words += [self.comment] if self.comment else []
        comment = f" /* {': '.join(words)} */" if words else ""
        return f"{self.kind} {self.name}{long};{comment}"


@dataclass(frozen=True)
class Printed:
    """The C text of one step, `parts` are functions that it calls; `operations` by kind, at most,
    in one call of the step."""

    name: str
    single: bool
    fast_tanh: bool
    inputs: tuple[Member, ...]
    outputs: tuple[Member, ...]
    state: tuple[Member, ...]
    work: tuple[Member, ...]
    helpers: str
    init: str
    parts: str
    step: str
    externals: tuple[str, ...]
    tables: str
    operations: dict[str, int]

    table_bytes: int
    codes: dict[str, tuple[str, ...]]

    @property
    def real(self) -> str:
        return "float" if self.single else "double"

    def bytes_of(self, members: Sequence[Member], widest: int = 1) -> int:
        """As a struct: each member at a multiple of its own size, the end at one of the `widest`
        too."""
        size = 0
        for each in members:
            one = _bytes(each.kind, self.single)
            size = -(-size // one) * one + one * each.size
            widest = max(widest, one)
        return -(-size // widest) * widest

    @property
    def saved_bytes(self) -> int:
        """Of the state, before its working memory."""
        widest = max((_bytes(m.kind, self.single) for m in self.work), default=1)
        return self.bytes_of(self.state, widest)


def _bytes(kind: Kind, single: bool) -> int:
    return BYTES.get(kind, 4 if single else 8)


def print_step(
    given: ExportedStep,
    name: str,
    *,
    single: bool = False,
    fast_tanh: bool = False,
    inline: bool = False,
) -> Printed:
    """Print `given`; with `inline` exp, log and erf in double are not those of <math.h> but inline
    ones, of which compilers make vectors. Raises `InputError` where C cannot carry a part of it."""
    program = trace(given.step, given.state, given.sample)
    narrowed(program)
    info_shape = jax.eval_shape(given.step, given.state, given.sample)[1]
    state = members(given.state, {}, {})
    inputs = members(given.sample, given.comments, given.units)
    outputs = members(info_shape, given.comments, given.units)
    wide: set[int] = set()
    if single:
        times = [k for k, m in enumerate((*state, *inputs)) if m.name in given.times]
        wide = wide_values(program, times, len(state))
        state, inputs = (
            [
                replace(m, kind="wide") if id(v) in wide else m
                for v, m in zip(values, many, strict=True)
            ]
            for values, many in (
                (program.inputs[: len(state)], state),
                (program.inputs[len(state) :], inputs),
            )
        )
    tables = Tables(name, single)
    printer = Printer(program, FORMS, tables, single, fast_tanh, inline, wide)
    places = [f"state->{m.name}" for m in state] + [f"in->{m.name}" for m in inputs]
    for value, member in zip(program.inputs, places, strict=True):
        printer.given(value, member)
    nodes = printer.run()
    after = places[: len(state)] + [f"out->{m.name}" for m in outputs]
    printer.leave(program.body.outputs, after)
    work, parts, step = _placed(printer, nodes, name, "step")
    first = Program([], trace(lambda: given.state).body)
    beginner = Printer(first, FORMS, tables, single, fast_tanh, inline)
    beginner.leave(first.body.outputs, places[: len(state)])
    _, begun, init = _placed(beginner, beginner.nodes, name, "init")
    helpers = [each for each in HELPERS if each in printer.helpers | beginner.helpers]
    return Printed(
        name, single, fast_tanh, tuple(inputs), tuple(outputs), tuple(state), tuple(work),
        "\n".join(HELPERS[each](single) for each in helpers),
        init, "\n".join(filter(None, (begun, parts))), step,
        tuple(tables.externals), "\n".join(tables.definitions) + "\n",
        dict(sorted(printer.operations.items())),
        sum(_bytes(kind, single) * len(numbers) for _, kind, numbers in tables.declared),
        given.codes,
    )  # fmt: skip


def _placed(
    printer: Printer, nodes: Sequence[Node], name: str, of: str
) -> tuple[list[Member], str, str]:
    """(the members of the workspace, the functions that the statements are in, what calls
    them)."""
    lasting = {each for each in printer.arrays if each.fixed}
    sizes = place(nodes, printer.arrays, lasting)
    kinds = {kind: truth(printer.single) if kind == "bool" else kind for kind in sizes}
    work = [Member(LETTERS[kind], kinds[kind], (size,)) for kind, size in sizes.items()]

    def cell(found: re.Match[str]) -> str:
        at = Place.parsed(found[2])
        if not found[1].isdigit():
            return f"{found[1]}[{at.text}]"
        array = printer.arrays[int(found[1])].home
        if array.scalar:
            assert array.fixed is not None
            return array.fixed
        where = array.fixed or f"work->{LETTERS[array.kind]}"
        return f"{where}[{(at + array.offset).text}]"

    functions = Functions(name, of, lambda line: ELEMENT.sub(cell, line))
    body = functions.body(nodes)
    return work, "\n".join(functions.parts), body


def members(tree: Any, comments: dict[str, str], units: dict[str, str]) -> list[Member]:
    """The leaves of a pytree as members of a struct."""
    found, names = [], set()
    for path, leaf in jax.tree_util.tree_flatten_with_path(tree)[0]:
        raw = "_".join(_key(each) for each in path)
        name = identifier(raw)
        while name in names:
            name += "_"
        names.add(name)
        shape = tuple(int(n) for n in leaf.shape)
        kind = kind_of(np.dtype(leaf.dtype))
        found.append(Member(name, kind, shape, comments.get(raw, ""), units.get(raw, "")))
    return found


def _key(entry: Any) -> str:
    for attribute in ("name", "key", "idx"):
        if hasattr(entry, attribute):
            return str(getattr(entry, attribute))
    return str(entry)


def identifier(name: str) -> str:
    """A name of C that looks like `name`: letters without their accents."""
    letters = unicodedata.normalize("NFKD", name)
    bare = "".join(each for each in letters if not unicodedata.combining(each))
    plain = bare.encode("ascii", "replace").decode()
    found = re.sub(r"[^A-Za-z0-9_]+", "_", plain).strip("_") or "value"
    if found[0].isdigit():
        found = f"n{found}"
    return f"{found}_" if found in TAKEN else found
