"""Units: "N*m/s" to powers of the SI base units and a scale, and the powers back to a text."""

import math
import re
import unicodedata
from fractions import Fraction
from typing import NamedTuple

__all__ = [
    "BASE",
    "DIMENSIONLESS",
    "Dimension",
    "PhysicalUnit",
    "change_of",
    "conversion",
    "describe",
    "parse_unit",
    "power",
    "product",
    "read_unit",
    "zero_of",
]

# Powers of BASE, in that order.
Dimension = tuple[Fraction, ...]

BASE = ("kg", "m", "s", "A", "K", "mol", "cd")
DIMENSIONLESS: Dimension = (Fraction(0),) * len(BASE)
MAX_CHARACTERS = 100  # bounds the depth of the recursion as well

PREFIXES = {
    **dict(zip("YZEPTGMk", (1e24, 1e21, 1e18, 1e15, 1e12, 1e9, 1e6, 1e3), strict=True)),
    **dict(zip("hdcmµμunpfazy", (
        1e2, 1e-1, 1e-2, 1e-3, 1e-6, 1e-6, 1e-6, 1e-9, 1e-12, 1e-15, 1e-18, 1e-21, 1e-24
    ), strict=True)),
    "da": 1e1,
}  # fmt: skip
NO_SCALE = math.nan  # of what has a dimension, but no fixed size
TURN = 2 * math.pi
DERIVED = {  # unit: what it is, times; later ones may use earlier ones; all take a prefix
    "N": ("kg*m/s**2", 1.0),
    "Nm": ("N*m", 1.0),
    "J": ("N*m", 1.0),
    "W": ("J/s", 1.0),
    "Pa": ("N/m**2", 1.0),
    "bar": ("Pa", 1e5),
    "C": ("A*s", 1.0),
    "V": ("W/A", 1.0),
    "ohm": ("V/A", 1.0),
    "Ohm": ("V/A", 1.0),
    "Ω": ("V/A", 1.0),  # Greek capital omega
    "\u2126": ("V/A", 1.0),  # ohm sign
    "S": ("1/ohm", 1.0),
    "F": ("C/V", 1.0),
    "Wb": ("V*s", 1.0),
    "T": ("Wb/m**2", 1.0),
    "H": ("Wb/A", 1.0),
    "Hz": ("1/s", 1.0),
    "L": ("m**3", 1e-3),
    "l": ("m**3", 1e-3),
    "Wh": ("J", 3600.0),
    "Ah": ("C", 3600.0),
    "eV": ("J", 1.602176634e-19),
}
BARE = {  # units that take no prefix
    **dict.fromkeys(("°", "deg"), ("rad", TURN / 360)),
    **dict.fromkeys(("rev", "turn", "cycle", "U"), ("rad", TURN)),  # U/min on German plates
    **dict.fromkeys(("count", "counts", "sample", "samples", "step", "steps"), ("1", NO_SCALE)),
    **dict.fromkeys(("%", "percent", "pct"), ("1", 1e-2)),
    "ppm": ("1", 1e-6),
    "dB": ("1", NO_SCALE),
    "min": ("s", 60.0),
    "h": ("s", 3600.0),
    **dict.fromkeys(("d", "day"), ("s", 86400.0)),
    **dict.fromkeys(("degC", "°C"), ("K", 1.0)),
    **dict.fromkeys(("degF", "°F"), ("K", 5 / 9)),
    "rpm": ("rad/s", TURN / 60),
    "t": ("kg", 1e3),
    "atm": ("Pa", 101325.0),
    "psi": ("Pa", 6894.757293168361),
}
# Units in which a dimension is written for the reader where that is shorter than base units.
READABLE = ("N", "V", "W", "Pa", "ohm")

# K at the 0 of units that do not begin at absolute zero: of a reading, never of a difference.
ZEROS = {
    **dict.fromkeys(("degC", "°C"), 273.15),
    **dict.fromkeys(("degF", "°F"), 459.67 * 5 / 9),
}

TOKEN = re.compile(r"\s*(\*\*|[*·/^()+-]|\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+|%|°[CF]?|[^\W\d_]+)")
BEHIND = re.compile(r"(?<![\w.])([^\W\d_]+)(-?[1-9])(?![\d.])")  # m3, s-1: an exponent
DECIMAL = re.compile(r"\d+\.?\d*|\.\d+")


def product(left: Dimension, right: Dimension, sign: int = 1) -> Dimension:
    """Dimension of left * right, or of left / right with `sign` = -1."""
    return tuple(a + sign * b for a, b in zip(left, right, strict=True))


def power(base: Dimension, exponent: Fraction) -> Dimension:
    """Dimension of base ** exponent."""
    return tuple(a * exponent for a in base)


class PhysicalUnit(NamedTuple):
    """A unit: its dimension, the power of an angle in it, and how many SI units it is.

    An angle has no dimension, but rpm and Hz are no multiples of each other. NaN is no scale.
    """

    dimension: Dimension
    angle: Fraction = Fraction(0)
    scale: float = 1.0

    def times(self, other: "PhysicalUnit", sign: int = 1) -> "PhysicalUnit":
        """self * other, or self / other with `sign` = -1."""
        return PhysicalUnit(
            product(self.dimension, other.dimension, sign),
            self.angle + sign * other.angle,
            self.scale * _raise(other.scale, float(sign)),
        )

    def power(self, exponent: Fraction) -> "PhysicalUnit":
        """self ** exponent."""
        scale = _raise(self.scale, float(exponent))
        return PhysicalUnit(power(self.dimension, exponent), self.angle * exponent, scale)


def _raise(scale: float, exponent: float) -> float:
    try:
        return scale**exponent
    except (OverflowError, ZeroDivisionError):
        return NO_SCALE


def parse_unit(text: str) -> Dimension:
    """Dimension of a unit such as "kg*m**2", "1/min" or "m^0.5/s".

    Raises `ValueError` saying in a few words what cannot be read.
    """
    return read_unit(text).dimension


def read_unit(text: str) -> PhysicalUnit:
    """`text` as a unit. Raises `ValueError` saying in a few words what cannot be read."""
    return _Parser(text).parse()


def conversion(given: str, wanted: str) -> str | None:
    """What makes `wanted` of a number in `given`, to be written behind it: "*0.001", "+273.15".

    "" where they are the same, or where one is absent, unreadable or without a fixed size; None
    where they measure different things.
    """
    change = change_of(given, wanted)
    if change is None:
        return None
    factor, offset = change
    scaled = "" if factor == 1 else f"*{factor:.10g}"
    return scaled + (f"{offset:+.10g}" if offset else "")


def change_of(given: str, wanted: str) -> tuple[float, float] | None:
    """(factor, offset): a reading x in `given` is factor x + offset in `wanted`, and a difference,
    as the size of a fault is, factor times as large.

    (1, 0) and None as `conversion` has "" and None.
    """
    try:
        one, other = read_unit(given), read_unit(wanted)
    except ValueError:  # of an empty text, too
        return 1.0, 0.0
    if one.dimension != other.dimension:
        return None
    factor = one.scale / other.scale if other.scale else NO_SCALE
    if one.angle != other.angle or not math.isfinite(factor) or factor <= 0:
        return 1.0, 0.0
    offset = (zero_of(given) - zero_of(wanted)) / other.scale
    return (
        1.0 if math.isclose(factor, 1, rel_tol=1e-9) else factor,
        offset if abs(offset) > 1e-9 else 0.0,
    )


def zero_of(text: str) -> float:
    """What a reading of 0 in unit `text` is in SI units: 273.15 for degC, 0 for most."""
    return ZEROS.get(unicodedata.normalize("NFKC", text).strip(), 0.0)


class _Parser:
    """unit: factor ((* | · | /) factor)*;  factor: atom ((** | ^)? exponent)?"""

    def __init__(self, text: str) -> None:
        if len(text) > MAX_CHARACTERS:
            raise ValueError(f"longer than {MAX_CHARACTERS} characters")
        text = unicodedata.normalize("NFKC", text).replace("\u2212", "-")  # m³ is m3, s⁻¹ is s-1
        text = BEHIND.sub(r"\1**\2", text)
        self.tokens: list[str] = []
        position = 0
        while text[position:].strip():
            match = TOKEN.match(text, position)
            if match is None:
                raise ValueError(f"{text[position:].strip()[0]!r} does not belong in a unit")
            self.tokens.append(match[1])
            position = match.end()

    def parse(self) -> PhysicalUnit:
        unit = self.unit()
        if self.tokens:
            raise ValueError(f"an operator is missing before {self.tokens[0]!r}")
        return unit

    def accept(self, *tokens: str) -> str | None:
        return self.tokens.pop(0) if self.tokens and self.tokens[0] in tokens else None

    def take(self) -> str:
        if not self.tokens:
            raise ValueError("it ends too early")
        return self.tokens.pop(0)

    def close(self) -> None:
        if not self.accept(")"):
            raise ValueError("a ')' is missing")

    def unit(self) -> PhysicalUnit:
        unit = self.factor()
        while operator := self.accept("*", "·", "/"):
            unit = unit.times(self.factor(), -1 if operator == "/" else 1)
        return unit

    def factor(self) -> PhysicalUnit:
        atom = self.atom()
        return atom.power(self.exponent()) if self.accept("**", "^") else atom

    def atom(self) -> PhysicalUnit:
        if self.accept("("):
            unit = self.unit()
            self.close()
            return unit
        token = self.take()
        if token[0] in ".0123456789":
            return PhysicalUnit(DIMENSIONLESS, scale=float(token))
        return _named(token)

    def exponent(self) -> Fraction:
        if not self.accept("("):
            return self.decimal()
        value = self.decimal()
        if self.accept("/"):
            below = self.decimal()
            if not below:
                raise ValueError("an exponent divides by zero")
            value /= below
        self.close()
        return value

    def decimal(self) -> Fraction:
        sign = -1 if self.accept("+", "-") == "-" else 1
        token = self.take()
        # No exponents of ten here: Fraction("1e999999999") would never end.
        if not DECIMAL.fullmatch(token):
            raise ValueError(f"the exponent {token!r} is not a number")
        return sign * Fraction(token)


def _base(index: int) -> Dimension:
    return tuple(Fraction(int(index == other)) for other in range(len(BASE)))


# The table of units, filled by the parser itself.
_BARE: dict[str, PhysicalUnit] = {}
_PREFIXED: dict[str, PhysicalUnit] = {
    unit: PhysicalUnit(_base(index)) for index, unit in enumerate(BASE) if unit != "kg"
} | {"g": PhysicalUnit(_base(0), scale=1e-3), "rad": PhysicalUnit(DIMENSIONLESS, Fraction(1))}


def _named(name: str) -> PhysicalUnit:
    for table in (_BARE, _PREFIXED):
        if name in table:
            return table[name]
    for prefix, scale in PREFIXES.items():
        if name.startswith(prefix) and name.removeprefix(prefix) in _PREFIXED:
            unit = _PREFIXED[name.removeprefix(prefix)]
            return unit._replace(scale=scale * unit.scale)
    raise ValueError(f"unknown unit {name!r}")


for _table, _texts in ((_PREFIXED, DERIVED), (_BARE, BARE)):
    for _name, (_text, _times) in _texts.items():
        _table[_name] = read_unit(_text).times(PhysicalUnit(DIMENSIONLESS, scale=_times))


def describe(dimension: Dimension) -> str:
    """`dimension` as a short product of units: "N*m", "m**(1/2)/s", "1"."""
    choices: list[dict[str, Fraction]] = [dict(zip(BASE, dimension, strict=True))]
    mass = dimension[0]
    for unit in READABLE if mass else ():  # every readable unit holds a mass: m/s**2, not N/kg
        sign = 1 if mass > 0 else -1
        rest = product(dimension, _PREFIXED[unit].dimension, -sign)
        choices.append({unit: Fraction(sign), **dict(zip(BASE, rest, strict=True))})
    shortest = min(choices, key=lambda powers: sum(abs(power) for power in powers.values()))
    above, below = "", ""
    for unit, exponent in shortest.items():
        if exponent > 0:
            above += f"*{unit}{_raised(exponent)}"
        elif exponent < 0:
            below += f"/{unit}{_raised(-exponent)}"
    return (above[1:] or "1") + below


def _raised(exponent: Fraction) -> str:
    if exponent == 1:
        return ""
    return f"**{exponent}" if exponent.denominator == 1 else f"**({exponent})"
