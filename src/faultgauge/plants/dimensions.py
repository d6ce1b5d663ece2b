"""Dimensions of units: "N*m/s" to powers of the SI base units, and back. No scales."""

import re
from fractions import Fraction

__all__ = ["DIMENSIONLESS", "Dimension", "describe", "parse_unit", "power", "product"]

# Powers of BASE, in that order.
Dimension = tuple[Fraction, ...]

BASE = ("kg", "m", "s", "A", "K", "mol", "cd")
DIMENSIONLESS: Dimension = (Fraction(0),) * len(BASE)
MAX_CHARACTERS = 100  # bounds the depth of the recursion as well

PREFIXES = (*"YZEPTGMkhdcmµμunpfazy", "da")
DERIVED = {  # later ones may use earlier ones; all take a prefix
    "rad": "1",
    "N": "kg*m/s**2",
    "J": "N*m",
    "W": "J/s",
    "Pa": "N/m**2",
    "bar": "Pa",
    "C": "A*s",
    "V": "W/A",
    "ohm": "V/A",
    "Ohm": "V/A",
    "Ω": "V/A",  # Greek capital omega
    "\u2126": "V/A",  # ohm sign
    "S": "1/ohm",
    "F": "C/V",
    "Wb": "V*s",
    "T": "Wb/m**2",
    "H": "Wb/A",
    "Hz": "1/s",
    "L": "m**3",
    "l": "m**3",
    "Wh": "J",
    "Ah": "C",
    "eV": "J",
}
BARE = {  # units that take no prefix
    **dict.fromkeys(("%", "°", "deg", "rev", "turn", "cycle", "dB", "ppm"), "1"),
    **dict.fromkeys(("count", "counts", "sample", "samples", "step", "steps"), "1"),
    **dict.fromkeys(("min", "h", "d", "day"), "s"),
    **dict.fromkeys(("degC", "°C"), "K"),
    "rpm": "1/s",
    "t": "kg",
    "atm": "Pa",
}
# Units in which a dimension is written for the reader where that is shorter than base units.
READABLE = ("N", "V", "W", "Pa", "ohm")

TOKEN = re.compile(r"\s*(\*\*|[*·/^()+-]|\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+|%|°C?|[^\W\d_]+)")
DECIMAL = re.compile(r"\d+\.?\d*|\.\d+")


def product(left: Dimension, right: Dimension, sign: int = 1) -> Dimension:
    """Dimension of left * right, or of left / right with `sign` = -1."""
    return tuple(a + sign * b for a, b in zip(left, right, strict=True))


def power(base: Dimension, exponent: Fraction) -> Dimension:
    """Dimension of base ** exponent."""
    return tuple(a * exponent for a in base)


def parse_unit(text: str) -> Dimension:
    """Dimension of a unit such as "kg*m**2", "1/min" or "m^0.5/s".

    Raises `ValueError` saying in a few words what cannot be read.
    """
    return _Parser(text).parse()


class _Parser:
    """unit: factor ((* | · | /) factor)*;  factor: atom ((** | ^) exponent)?"""

    def __init__(self, text: str) -> None:
        if len(text) > MAX_CHARACTERS:
            raise ValueError(f"longer than {MAX_CHARACTERS} characters")
        self.tokens: list[str] = []
        position = 0
        while text[position:].strip():
            match = TOKEN.match(text, position)
            if match is None:
                raise ValueError(f"{text[position:].strip()[0]!r} does not belong in a unit")
            self.tokens.append(match[1])
            position = match.end()

    def parse(self) -> Dimension:
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

    def unit(self) -> Dimension:
        unit = self.factor()
        while operator := self.accept("*", "·", "/"):
            unit = product(unit, self.factor(), -1 if operator == "/" else 1)
        return unit

    def factor(self) -> Dimension:
        atom = self.atom()
        return power(atom, self.exponent()) if self.accept("**", "^") else atom

    def atom(self) -> Dimension:
        if self.accept("("):
            unit = self.unit()
            self.close()
            return unit
        token = self.take()
        return DIMENSIONLESS if token[0] in ".0123456789" else _named(token)

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
_BARE: dict[str, Dimension] = {}
_PREFIXED: dict[str, Dimension] = {
    "g" if unit == "kg" else unit: _base(index) for index, unit in enumerate(BASE)
}


def _named(name: str) -> Dimension:
    for table in (_BARE, _PREFIXED):
        if name in table:
            return table[name]
    for prefix in PREFIXES:
        if name.startswith(prefix) and name.removeprefix(prefix) in _PREFIXED:
            return _PREFIXED[name.removeprefix(prefix)]
    raise ValueError(f"unknown unit {name!r}")


for _name, _text in DERIVED.items():
    _PREFIXED[_name] = parse_unit(_text)
for _name, _text in BARE.items():
    _BARE[_name] = parse_unit(_text)


def describe(dimension: Dimension) -> str:
    """`dimension` as a short product of units: "N*m", "m**(1/2)/s", "1"."""
    choices: list[dict[str, Fraction]] = [dict(zip(BASE, dimension, strict=True))]
    mass = dimension[0]
    for unit in READABLE if mass else ():  # every readable unit holds a mass: m/s**2, not N/kg
        sign = 1 if mass > 0 else -1
        rest = product(dimension, _PREFIXED[unit], -sign)
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
