"""The plant file: TOML in, a checked `PlantSpec` out. Every mistake is answered by its key."""

import keyword
import math
import re
import reprlib
import unicodedata
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter
from importlib import resources
from pathlib import Path
from typing import Any

from faultgauge.errors import InputError
from faultgauge.plants import units
from faultgauge.plants.expression import (
    FUNCTIONS,
    Expression,
    Name,
    Node,
    Number,
    Scope,
    derivatives_used,
    names_used,
    networks_used,
    parse,
    unknown,
)
from faultgauge.plants.schema import FaultTable, FileTable, NetworkTable, StateTable
from faultgauge.plants.signals import (
    INNER,
    Detection,
    Fault,
    Input,
    Observation,
    Output,
    Signals,
    State,
)
from faultgauge.plants.spec import NetworkSpec, Parameter, PlantSpec
from faultgauge.plants.toml_file import parse_toml, read_text, typed

__all__ = [
    "is_reserved",
    "parse_plant",
    "presets",
    "read_plant_text",
]

DEFAULT_HIDDEN = 10  # units, until a fit has chosen
MOST_NAMES = 2000  # in one table
NAMED = ("states", "inputs", "parameters", "networks", "terms", "outputs", "faults")
WORD = re.compile(r"\w+")
# names that mean something else, in expressions and in logs
TAKEN = {"d": "a derivative, d(STATE)", "t": "a log's time", "run": "the run of a log's row"}


def is_reserved(name: str) -> bool:
    """Whether `name` means something else in expressions or logs."""
    return name in FUNCTIONS or name in TAKEN


def _meaning(name: str) -> str:
    """What a reserved `name` stands for."""
    return TAKEN.get(name, f"the function {name}()")


def presets() -> dict[str, str]:
    """Names and texts of the plant files that ship with faultgauge."""
    folder = resources.files("faultgauge.plants") / "presets"
    return {
        entry.name.removesuffix(".toml"): entry.read_text("utf-8")
        for entry in sorted(folder.iterdir(), key=lambda entry: entry.name)
        if entry.name.endswith(".toml")
    }


def read_plant_text(source: str | Path) -> str:
    """Text of a plant file, or of a preset when `source` is the name of one."""
    path = Path(source)
    if str(source) in presets() and not path.exists():
        return presets()[str(source)]
    advice = f"give a plant file or one of the presets {_join(presets())}"
    return read_text(path, "plant file", advice)


def parse_plant(text: str, source: str = "plant file") -> PlantSpec:
    """Check the text of a plant file. Raises `InputError` naming key and column."""
    file = typed(FileTable, parse_toml(text, source), source)
    return _Checker(file, text, source).spec()


def _join(names: Any) -> str:
    return ", ".join(names)


def _bounds(table: Any) -> tuple[float, float]:
    low = -math.inf if table.min is None else float(table.min)
    return low, math.inf if table.max is None else float(table.max)


def _trusted(table: Any) -> tuple[float, float] | None:
    return None if table.trusted is None else (float(table.trusted[0]), float(table.trusted[1]))


def _initial(table: StateTable) -> float:
    """Where the state starts if nobody says: at zero, or as near to it as its limits allow."""
    if table.initial is not None:
        return float(table.initial)
    low, high = _bounds(table)
    return min(max(0.0, low), high)


class _Checker:
    """Turns a well-typed file into a `PlantSpec`, or says what makes no sense in it."""

    def __init__(self, file: FileTable, text: str, source: str) -> None:
        self.file, self.text, self.source = file, text, source

    def fail(self, table: str, message: str) -> InputError:
        return InputError(f"{self.source}: [{table}] {message}.")

    def spec(self) -> PlantSpec:
        file = self.file
        self.check_names()
        self.check_bounds()
        self.check_trusted()
        self.check_instruments()
        terms = self.terms()
        derivatives = self.expressions("states", "derivative", terms)
        values = self.expressions("outputs", "value", terms)
        self.check_shared(values)
        signals = Signals(
            states=tuple(
                State(
                    name,
                    table.unit,
                    *_bounds(table),
                    _initial(table),
                    table.exact,
                    _trusted(table),
                )
                for name, table in file.states.items()
            ),
            inputs=tuple(
                Input(
                    name,
                    table.unit,
                    *_bounds(table),
                    table.hold or "zero",
                    table.delay or 0.0,
                    table.instrument,
                    _trusted(table),
                )
                for name, table in file.inputs.items()
            ),
            outputs=tuple(
                Output(name, table.unit, table.sigma, self.measures(value), _trusted(table))
                for (name, table), value in zip(file.outputs.items(), values, strict=True)
            ),
            faults=self.faults((*derivatives, *values)),
            observation=self.observation(),
            max_simultaneous=file.detection.max_simultaneous,
            detection=self.detection(),
        )
        networks = self.networks((*derivatives, *values))
        spec = PlantSpec(
            name=file.name,
            text=self.text,
            signals=signals,
            derivatives=derivatives,
            values=values,
            parameters=tuple(self.parameter(name) for name in file.parameters),
            networks=networks,
            order=self.order(derivatives),
            open_holds=tuple(name for name, table in file.inputs.items() if table.hold is None),
            open_delays=tuple(name for name, table in file.inputs.items() if table.delay is None),
            open_sizes=tuple(n.name for n in networks if file.networks[n.name].hidden is None),
        )
        warnings = (*self.unused((*derivatives, *values)), *units.check(spec))
        return PlantSpec(**{**vars(spec), "warnings": warnings})

    def check_names(self) -> None:
        file = self.file
        if not file.states or not file.outputs:
            empty = "states" if not file.states else "outputs"
            raise self.fail(empty, "is empty; a plant needs at least one state and one output")
        for table in NAMED:
            if len(getattr(file, table)) > MOST_NAMES:
                raise self.fail(table, f"has more than {MOST_NAMES} tables; split the plant")
        owner: dict[str, str] = {}
        for table in NAMED:
            for name in getattr(file, table):
                normal = unicodedata.normalize("NFKC", name) == name  # as expressions read it
                if not name.isidentifier() or keyword.iskeyword(name) or not normal:
                    raise self.fail(table, f"{name!r} is not a name; use letters, digits and _")
                if is_reserved(name):
                    stands = f"{name!r} stands for {_meaning(name)}; choose another name"
                    raise self.fail(table, stands)
                if name.removeprefix("d_") != name and name.removeprefix("d_") in file.states:
                    raise self.fail(table, f"{name!r} stands for a derivative in a log; rename it")
                if table == "faults" or (table == "outputs" and name in file.states):
                    continue
                if name in owner:
                    raise self.fail(table, f"{name!r} is already declared in [{owner[name]}]")
                owner[name] = table

    def check_bounds(self) -> None:
        for kind in ("states", "inputs", "parameters", "faults"):
            for name, table in getattr(self.file, kind).items():
                low, high = _bounds(table)
                if low >= high:
                    raise self.fail(
                        f"{kind}.{name}", f"min = {low:g} must be less than max = {high:g}"
                    )
                for key in ("value", "initial"):
                    value = getattr(table, key, None)
                    if value is not None and not low <= value <= high:
                        raise self.fail(
                            f"{kind}.{name}", f"{key} = {value:g} lies outside [{low:g}, {high:g}]"
                        )
        for name, table in self.file.parameters.items():
            if table.fixed and table.value is None:
                raise self.fail(f"parameters.{name}", "fixed = true needs a value")
            if table.fixed and table.vary:
                raise self.fail(
                    f"parameters.{name}",
                    f"fixed = true and vary = {table.vary!r} contradict each other; keep one",
                )

    def check_trusted(self) -> None:
        for kind in ("states", "inputs", "outputs"):
            for name, table in getattr(self.file, kind).items():
                given = table.trusted
                if given is not None and not (len(given) == 2 and given[0] < given[1]):
                    raise self.fail(
                        f"{kind}.{name}",
                        f"trusted = {reprlib.repr(given)}: should be two numbers, the lower bound "
                        "and then the upper one, as in trusted = [0, 10]",
                    )

    def check_instruments(self) -> None:
        """An instrument comes from outside the loop; the plant's own signals are inside."""
        file = self.file
        inside = {*file.states, *file.inputs, *file.outputs, *(f"d_{name}" for name in file.states)}
        for name, table in file.inputs.items():
            column = table.instrument
            if column is not None and (column in inside or column.strip() in ("", "t", "run")):
                raise self.fail(
                    f"inputs.{name}",
                    f"instrument = {column!r} is no signal from outside the loop; name the column "
                    "of the reference that the controller follows, or leave the key out",
                )

    def expressions(self, kind: str, key: str, terms: Mapping[str, Node]) -> tuple[Expression, ...]:
        scope = self.scope(terms)
        return tuple(
            parse(getattr(table, key), f"{self.source}: [{kind}.{name}] {key}", scope)
            for name, table in getattr(self.file, kind).items()
        )

    def scope(self, terms: Mapping[str, Node]) -> Scope:
        file = self.file
        names = [*file.states, *file.inputs, *file.parameters]
        return Scope(names, list(file.states), list(file.networks), terms)

    def terms(self) -> dict[str, Node]:
        """What each name in [terms] stands for, whatever the order in the file."""
        texts = self.file.terms
        reads = {name: texts.keys() & {*WORD.findall(text)} for name, text in texts.items()}
        found: dict[str, Node] = dict.fromkeys(texts, Number(0.0))  # until it is its turn
        try:
            order = [*TopologicalSorter(reads).static_order()]
        except CycleError as circle:
            raise self.fail(
                "terms", f"run in a circle, {' -> '.join(circle.args[1])}; write one without"
            ) from None
        for name in order:
            where = f"{self.source}: [terms] {name}"
            others = {each: tree for each, tree in found.items() if each != name}
            found[name] = parse(texts[name], where, self.scope(others)).tree
        return found

    def check_shared(self, values: tuple[Expression, ...]) -> None:
        """One column cannot measure two things."""
        for name, value in zip(self.file.outputs, values, strict=True):
            if name in self.file.states and self.measures(value) != name:
                raise self.fail(
                    f"outputs.{name}",
                    f"has the name of a state but another value, so a log column {name!r} could "
                    "mean either; rename the output",
                )

    def measures(self, value: Expression) -> str | None:
        tree = value.tree
        return tree.name if isinstance(tree, Name) and tree.name in self.file.states else None

    def parameter(self, name: str) -> Parameter:
        table = self.file.parameters[name]
        low, high = _bounds(table)
        value = table.value
        if value is None:  # no guess given: the middle of the range, or 1 inside it
            middle = math.isfinite(low) and math.isfinite(high)
            value = (low + high) / 2 if middle else min(max(1.0, low), high)
        return Parameter(name, float(value), table.unit, low, high, table.fixed, table.vary)

    def networks(self, expressions: tuple[Expression, ...]) -> tuple[NetworkSpec, ...]:
        arity: dict[str, int] = {}
        for expression in expressions:
            for name, calls in networks_used(expression).items():
                for arguments in calls:
                    if arity.setdefault(name, len(arguments)) != len(arguments):
                        raise self.fail(
                            f"networks.{name}",
                            f"is called with {arity[name]} and with {len(arguments)} arguments; "
                            "a network has one arity",
                        )
        return tuple(
            self.network(name, table, arity[name])
            for name, table in self.file.networks.items()
            if name in arity
        )

    def network(self, name: str, table: NetworkTable, arity: int) -> NetworkSpec:
        for key in ("odd", "zero_at_zero"):
            if table.positive and getattr(table, key):
                raise self.fail(
                    f"networks.{name}",
                    f"positive and {key} contradict each other, since {key} makes it 0 at 0; "
                    "keep one",
                )
        return NetworkSpec(
            name,
            table.hidden or DEFAULT_HIDDEN,
            arity,
            table.odd,
            table.zero_at_zero,
            table.positive,
            table.monotone,
        )

    def order(self, derivatives: tuple[Expression, ...]) -> tuple[int, ...]:
        """An order in which the derivatives can be computed when some read d(others)."""
        names = list(self.file.states)
        place = {name: k for k, name in enumerate(names)}
        needs = [{place[n] for n in derivatives_used(e)} for e in derivatives]
        readers: list[list[int]] = [[] for _ in names]
        for k, needed in enumerate(needs):
            for n in needed:
                readers[n].append(k)
        missing = [len(needed) for needed in needs]
        done = [k for k, count in enumerate(missing) if not count]
        for k in done:  # which grows meanwhile
            for reader in readers[k]:
                missing[reader] -= 1
                if not missing[reader]:
                    done.append(reader)
        circle = [names[k] for k, count in enumerate(missing) if count]
        if circle:
            raise self.fail(
                f"states.{circle[0]}",
                f"d() runs in a circle through {_join(circle)}; write one of them without d()",
            )
        return tuple(done)

    def faults(self, expressions: tuple[Expression, ...]) -> tuple[Fault, ...]:
        for name, table in self.file.faults.items():
            self.check_fault(name, table, expressions)
        return tuple(
            Fault(
                name,
                table.enters,
                table.target,
                table.unit,
                *_bounds(table),
                table.rate,
                table.prior_per_hour,
                table.monitor,
                bool(table.relative),
            )
            for name, table in self.file.faults.items()
        )

    def check_fault(
        self, name: str, table: FaultTable, expressions: tuple[Expression, ...]
    ) -> None:
        kind = {"gain": "input", "output_gain": "output"}.get(table.enters, table.enters)
        legal = getattr(self.file, f"{kind}s")
        if table.target not in legal:
            problem = unknown(f"{kind} as target", table.target, legal)
            raise self.fail(f"faults.{name}", problem)
        if table.relative is not None and table.enters not in INNER:
            raise self.fail(
                f"faults.{name}",
                'relative goes with enters = "parameter" or "network" alone, not with '
                f'"{table.enters}"; remove it',
            )
        if kind == "network" and not any(table.target in networks_used(e) for e in expressions):
            raise self.fail(
                f"faults.{name}",
                f"target = {table.target!r}: no expression calls this network, so nothing can go "
                "wrong in it; call it or remove the fault",
            )

    def detection(self) -> Detection:
        table = self.file.detection
        return Detection(table.persistence, table.release, table.latch, table.hold_off)

    def observation(self) -> Observation:
        observer, legal = self.file.observer, self.file.outputs
        if observer.outputs is None:
            return Observation(None, observer.bandwidth)
        for output in observer.outputs:
            if output not in legal:
                raise self.fail("observer", f"outputs: {unknown('output', output, legal)}")
        if not observer.outputs or len(set(observer.outputs)) < len(observer.outputs):
            problem = "names an output twice" if observer.outputs else "is empty"
            raise self.fail("observer", f"outputs {problem}; name each output to use once")
        return Observation(tuple(observer.outputs), observer.bandwidth)

    def unused(self, expressions: tuple[Expression, ...]) -> list[str]:
        """Declared but never read: not an error, but seldom what was meant."""
        used: set[str] = set()
        for expression in expressions:
            used |= names_used(expression) | derivatives_used(expression)
            used |= networks_used(expression).keys()
        texts = [*(e.text for e in expressions), *self.file.terms.values()]
        used |= self.file.terms.keys() & {word for text in texts for word in WORD.findall(text)}
        return [
            f"{self.source}: [{kind}.{name}] is declared but no expression uses it"
            for kind in ("inputs", "parameters", "networks", "terms", "states")
            for name in getattr(self.file, kind)
            if name not in used
        ]
