"""Do the units of a plant file fit together? Warnings only: by dimension, a fault also by scale."""

import enum
import math
import reprlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction

from faultgauge.plants.dimensions import (
    DIMENSIONLESS,
    Dimension,
    change_of,
    describe,
    parse_unit,
    power,
    product,
)
from faultgauge.plants.expression import (
    Binary,
    Call,
    Expression,
    Name,
    Negative,
    Node,
    Number,
    Opaque,
)
from faultgauge.plants.spec import PlantSpec

__all__ = ["check", "text"]

PER_SECOND = parse_unit("1/s")
PURE = ("exp", "log", "sin", "cos", "tanh")  # dimensionless argument and result
# Arguments of one dimension, which is the result's.
ALIKE = ("min", "max", "clip", "overflow", "deadzone")
READ = ("states", "inputs", "parameters")  # the tables whose names expressions may read
MAX_EXPONENT = 100  # beyond it no unit is meant
# Factors that formulas have by themselves. Any other number may be a constant of the plant, in a
# unit that an expression cannot say: 603*(Ts - Tr) may well be in W.
PURE_FACTORS = (0.0, 0.5, 1.0, 1.5, 2.0, math.pi, 2 * math.pi)


class _Open(enum.Enum):
    """What has no dimension to check: both fit anything in a sum."""

    UNKNOWN = enum.auto()  # in a product: unknown again
    NUMBER = enum.auto()  # a literal of `PURE_FACTORS`; in a product: dimensionless


Quantity = Dimension | _Open
Units = dict[tuple[str, str], Quantity]  # by table and name
UNKNOWN, NUMBER = _Open.UNKNOWN, _Open.NUMBER


def check(spec: PlantSpec) -> list[str]:
    """Warnings about the units of `spec`; an absent or unreadable unit is compatible with all.

    Each derivative must have its state's unit per second, each output and each fault the unit of
    the place it stands for, and the terms inside each expression must go together.
    """
    unit, warnings = _units(spec)
    signals = spec.signals
    known = {name: found for (table, name), found in unit.items() if table in READ}
    for state, expression in zip(signals.states, spec.derivatives, strict=True):
        place = _times(unit["states", state.name], PER_SECOND)
        walker = _Walker(f"[states.{state.name}] derivative", known)
        warnings += walker.compare(expression, place)
    for output, expression in zip(signals.outputs, spec.values, strict=True):
        walker = _Walker(f"[outputs.{output.name}] value", known)
        warnings += walker.compare(expression, unit["outputs", output.name])
    return warnings + list(_faults(spec, unit))


def _units(spec: PlantSpec) -> tuple[Units, list[str]]:
    """The unit of every entry of the file, and a warning for each that cannot be read."""
    signals = spec.signals
    tables = {
        "states": signals.states,
        "inputs": signals.inputs,
        "outputs": signals.outputs,
        "parameters": spec.parameters,
        "faults": signals.faults,
    }
    unit: Units = {}
    warnings: list[str] = []
    for table, entries in tables.items():
        for entry in entries:
            unit[table, entry.name] = UNKNOWN
            if not entry.unit.strip():
                continue
            try:
                unit[table, entry.name] = parse_unit(entry.unit)
            except ValueError as problem:
                warnings.append(
                    f"[{table}.{entry.name}] unit = {reprlib.repr(entry.unit)} cannot be read "
                    f'({problem}) and is not checked; write units as "N*m", "m/s**2" or "1"'
                )
    return unit, warnings


def _faults(spec: PlantSpec, unit: Units) -> Iterator[str]:
    signals = spec.signals
    entries = (*signals.states, *signals.inputs, *signals.outputs, *spec.parameters)
    labels = {each.name: each.unit.strip() for each in entries}
    for fault in signals.faults:
        label = labels.get(fault.target, "")
        match fault.enters:
            case "state":
                place = _times(unit["states", fault.target], PER_SECOND)
                label = label and f"({label})/s"
            case "input":
                place = unit["inputs", fault.target]
            case "output":
                place = unit["outputs", fault.target]
            case "parameter" if not fault.relative:
                place = unit["parameters", fault.target]
            case "network" if not fault.relative:
                place = UNKNOWN  # a network gives whatever is needed
            case _:
                place, label = DIMENSIONLESS, "1"
        found = unit["faults", fault.name]
        if not isinstance(found, tuple) or not isinstance(place, tuple):
            continue
        if found != place:
            yield (
                f"[faults.{fault.name}] unit = {fault.unit!r} has the dimension of "
                f"{describe(found)}, but a fault that enters {fault.enters} {fault.target!r} is "
                f"measured in {describe(place)}; correct the unit"
            )
            continue
        factor, _ = change_of(fault.unit, label) or (1.0, 0.0)
        if factor != 1:  # an offset is no matter: a size is a difference
            yield (
                f"[faults.{fault.name}] unit = {fault.unit!r} is {factor:.6g} {label}, but sizes "
                f"are in the unit of what the fault enters; write unit = {label!r}"
            )


@dataclass
class _Walker:
    """Finds the dimension of one expression and notes what does not go together."""

    where: str
    known: dict[str, Quantity]
    warnings: list[str] = field(default_factory=list)

    def compare(self, expression: Expression, place: Quantity) -> list[str]:
        found = self.quantity(expression.tree)
        if isinstance(found, tuple) and isinstance(place, tuple) and found != place:
            self.warn(f"{expression.text.strip()!r} {_has(found)}, but the place needs", place)
        return self.warnings

    def warn(self, problem: str, needed: Dimension) -> None:
        self.warnings.append(
            f"{self.where}: {problem} {describe(needed)}; check the units of its terms"
        )

    def quantity(self, node: Node) -> Quantity:
        match node:
            case Number():
                pure = any(
                    math.isclose(abs(node.value), each, rel_tol=1e-3) for each in PURE_FACTORS
                )
                return NUMBER if pure else UNKNOWN
            case Name():
                return self.known[node.name]
            case Negative():
                return self.quantity(node.operand)
            case Binary(operator="+" | "-"):
                return self.alike(node, [node.left, node.right])
            case Binary(operator="**"):
                return self.raised(node)
            case Binary():
                sign = -1 if node.operator == "/" else 1
                return _times(self.quantity(node.left), self.quantity(node.right), sign)
            case Call():
                return self.call(node)
            case Opaque():
                return UNKNOWN

    def alike(self, node: Node, terms: list[Node]) -> Quantity:
        found = [self.quantity(term) for term in terms]
        known = list(dict.fromkeys(each for each in found if isinstance(each, tuple)))
        if len(known) > 1:
            self.warn(f"{text(node)!r} puts {describe(known[0])} together with", known[1])
            return UNKNOWN
        return known[0] if known else (NUMBER if UNKNOWN not in found else UNKNOWN)

    def raised(self, node: Binary) -> Quantity:
        base = self.quantity(node.left)
        self.pure(node.right, "an exponent")
        if base == DIMENSIONLESS or base is NUMBER:
            return base
        if isinstance(base, tuple) and isinstance(node.right, Number):
            return _power(base, node.right.value)
        return UNKNOWN  # by a variable exponent: nothing can be said

    def call(self, node: Call) -> Quantity:
        if node.function == "d":
            return _times(self.quantity(node.arguments[0]), PER_SECOND)
        if node.function in ALIKE:
            return self.alike(node, list(node.arguments))
        if node.function in PURE:
            found = self.pure(node.arguments[0], f"{node.function}()")
            return NUMBER if found is NUMBER else DIMENSIONLESS
        found = [self.quantity(argument) for argument in node.arguments]
        match node.function:
            case "abs":
                return found[0]
            case "sign":
                return NUMBER if found[0] is NUMBER else DIMENSIONLESS
            case "sqrt":
                return _power(found[0], 0.5) if isinstance(found[0], tuple) else found[0]
            case _:
                return UNKNOWN  # a network gives whatever is needed

    def pure(self, node: Node, place: str) -> Quantity:
        """Quantity of `node`, which has to be dimensionless."""
        found = self.quantity(node)
        if isinstance(found, tuple) and found != DIMENSIONLESS:
            self.warn(f"{text(node)!r} {_has(found)}, but {place} needs", DIMENSIONLESS)
        return found


def _has(found: Dimension) -> str:
    return f"has the dimension of {describe(found)}"


def _times(left: Quantity, right: Quantity, sign: int = 1) -> Quantity:
    if left is NUMBER and right is NUMBER:
        return NUMBER
    left, right = (DIMENSIONLESS if each is NUMBER else each for each in (left, right))
    if isinstance(left, tuple) and isinstance(right, tuple):
        return product(left, right, sign)
    return UNKNOWN


def _power(base: Dimension, exponent: float) -> Quantity:
    if abs(exponent) > MAX_EXPONENT:
        return UNKNOWN
    return power(base, Fraction(exponent).limit_denominator(1000))  # 1/3 is a float by now


# How tightly each operator binds, for the parentheses of `text`.
BINDING = {"+": 1, "-": 1, "*": 2, "/": 2, "**": 4}


def text(node: Node, outer: int = 0) -> str:
    """`node` as the user could have written it."""
    match node:
        case Number():
            written, binding = f"{node.value:g}", 3 if node.value < 0 else 5
        case Name():
            written, binding = node.name, 5
        case Negative():
            written, binding = f"-{text(node.operand, 3)}", 3
        case Binary():
            binding = BINDING[node.operator]
            right_first = node.operator == "**"
            left = text(node.left, binding + right_first)
            right = text(node.right, binding + (not right_first))
            gap = " " if binding == 1 else ""
            written = f"{left}{gap}{node.operator}{gap}{right}"
        case Call():
            arguments = ", ".join(text(argument) for argument in node.arguments)
            written, binding = f"{node.function}({arguments})", 5
        case Opaque():
            written, binding = f"({', '.join(text(each) for each in node.arguments)})", 5
    return f"({written})" if binding < outer else written
