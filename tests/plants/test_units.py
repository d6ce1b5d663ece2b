"""Units of a plant file: what they mean, and what is said when they do not fit together."""

import math
from fractions import Fraction

import pytest

from faultgauge.plants.dimensions import conversion, describe, parse_unit
from faultgauge.plants.plant_file import parse_plant

BASE = ("kg", "m", "s", "A", "K", "mol", "cd")


def dimension(**powers):
    return tuple(Fraction(powers.get(base, 0)) for base in BASE)


@pytest.mark.parametrize(
    ("unit", "powers"),
    [
        ("1", {}),
        ("%", {}),
        ("percent", {}),
        ("m3/h", {"m": 3, "s": -1}),
        ("s⁻¹", {"s": -1}),
        ("1e3*m", {"m": 1}),
        ("degF", {"K": 1}),
        ("rad", {}),
        ("mrad", {}),
        ("deg", {}),
        ("rpm", {"s": -1}),
        ("1/min", {"s": -1}),
        ("count/s", {"s": -1}),
        ("g", {"kg": 1}),
        ("kg", {"kg": 1}),
        ("t", {"kg": 1}),
        ("min", {"s": 1}),  # a minute, not a milli-inch
        ("h", {"s": 1}),
        ("cd", {"cd": 1}),  # a candela, not a centi-day
        ("mol", {"mol": 1}),
        ("mmol/L", {"mol": 1, "m": -3}),
        ("km/h", {"m": 1, "s": -1}),
        ("N*m", {"kg": 1, "m": 2, "s": -2}),
        ("mN·m", {"kg": 1, "m": 2, "s": -2}),
        ("N*m*s", {"kg": 1, "m": 2, "s": -1}),
        ("J", {"kg": 1, "m": 2, "s": -2}),
        ("kWh", {"kg": 1, "m": 2, "s": -2}),
        ("W", {"kg": 1, "m": 2, "s": -3}),
        ("kPa", {"kg": 1, "m": -1, "s": -2}),
        ("mbar", {"kg": 1, "m": -1, "s": -2}),
        ("V", {"kg": 1, "m": 2, "s": -3, "A": -1}),
        ("ohm", {"kg": 1, "m": 2, "s": -3, "A": -2}),
        ("kOhm", {"kg": 1, "m": 2, "s": -3, "A": -2}),
        ("Ω", {"kg": 1, "m": 2, "s": -3, "A": -2}),
        ("M\u2126", {"kg": 1, "m": 2, "s": -3, "A": -2}),
        ("µF", {"kg": -1, "m": -2, "s": 4, "A": 2}),
        ("mH", {"kg": 1, "m": 2, "s": -2, "A": -2}),
        ("T", {"kg": 1, "s": -2, "A": -1}),
        ("Wb", {"kg": 1, "m": 2, "s": -2, "A": -1}),
        ("mA*h", {"A": 1, "s": 1}),
        ("C", {"A": 1, "s": 1}),
        ("°C", {"K": 1}),
        ("W/(m*K)", {"kg": 1, "m": 1, "s": -3, "K": -1}),
        ("W/m/K", {"kg": 1, "m": 1, "s": -3, "K": -1}),
        ("m / s ** 2", {"m": 1, "s": -2}),
        ("m*s^-2", {"m": 1, "s": -2}),
        ("m**0.5/s", {"m": Fraction(1, 2), "s": -1}),
        ("m^(1/2)", {"m": Fraction(1, 2)}),
        ("m**(-2/3)", {"m": Fraction(-2, 3)}),
        ("(m/s)**2", {"m": 2, "s": -2}),
        ("m**1/s**2", {"m": 1, "s": -2}),
    ],
)
def test_a_unit_means_powers_of_the_base_units(unit, powers):
    assert parse_unit(unit) == dimension(**powers)


@pytest.mark.parametrize(
    ("unit", "problem"),
    [
        ("furlong", "unknown unit 'furlong'"),
        ("kmin", "unknown unit 'kmin'"),
        ("N m", "operator is missing"),
        ("N*", "ends too early"),
        ("(N*m", "')' is missing"),
        ("m**x", "exponent 'x'"),
        ("m**1e9", "exponent '1e9'"),
        ("m**(1/0)", "divides by zero"),
        ("m$", "'$' does not belong"),
        ("(" * 2000, "longer than 100"),
        ("__import__('os')", "does not belong"),
    ],
)
def test_text_that_is_no_unit_says_why(unit, problem):
    with pytest.raises(ValueError) as caught:  # noqa: PT011  the text is checked below
        parse_unit(unit)
    assert problem in str(caught.value)


@pytest.mark.parametrize(
    ("unit", "text"),
    [
        ("1", "1"),
        ("J", "N*m"),
        ("J*s", "N*m*s"),
        ("kg*m**2", "kg*m**2"),
        ("1/s", "1/s"),
        ("W/A", "V"),
        ("s**-2*m", "m/s**2"),
        ("m**0.5/s", "m**(1/2)/s"),
        ("V/A", "ohm"),
    ],
)
def test_a_dimension_is_told_in_usual_units(unit, text):
    assert describe(parse_unit(unit)) == text
    assert parse_unit(text) == parse_unit(unit)


def plant(derivative="-k*x", value="x", *, x="m", y="m", k="1/s", more=""):
    """State x, input v (speed), parameters k, e (no unit), n (dimensionless)."""
    return f"""
name = "p"
[states.x]
unit = "{x}"
derivative = "{derivative}"
[inputs.v]
unit = "m/s"
[outputs.y]
unit = "{y}"
value = "{value}"
[networks.NN]
[parameters]
k = {{ unit = "{k}" }}
e = {{ value = 1 }}
n = {{ unit = "1" }}
{more}
"""


def warnings(text):
    """Warnings about units: those about unused names are not the matter here."""
    return [each for each in parse_plant(text).warnings if "no expression uses" not in each]


@pytest.mark.parametrize(
    "derivative",
    [
        "v - k*x",
        "k*(x - 3)",  # a number fits any sum
        "2*v",
        "-v + 0.5*v",
        "0",
        "1/2 + 3",
        "NN(x, v)",
        "v*exp(-NN(x)) + e",
        "e*x",  # no unit: fits
        "v*sin(n)*tanh(k*x/v)",
        "sqrt(v*v)",
        "sqrt(v)**2",
        "(v**(1/3))**3",
        "v**e*v",  # a variable exponent: nothing can be said
        "v*n**2.5*2**n",
        "abs(v)*sign(x)",
        "max(v, 0) + min(k*x, v, 1) + clip(v, -1, 1)",
        "overflow(v, 2) + deadzone(v, k*x)",
        "exp(2)*v*sqrt(2)",
        "v*log(x/(k*x)*k)",
    ],
)
def test_terms_that_fit_are_passed_in_silence(derivative):
    assert warnings(plant(derivative)) == []


@pytest.mark.parametrize(
    ("derivative", "parts"),
    [
        ("k*x*x", ["'k*x*x' has the dimension of m**2/s, but the place needs m/s"]),
        ("x", ["'x' has the dimension of m, but the place needs m/s"]),
        ("v + x", ["'v + x' puts m/s together with m"]),
        ("k*(v - x)", ["'v - x' puts m/s together with m"]),
        ("NN(v + x)", ["'v + x' puts m/s together with m"]),
        ("max(v, x, 0)", ["'max(v, x, 0)' puts m/s together with m"]),
        ("clip(v, x, 0)", ["'clip(v, x, 0)' puts m/s together with m"]),
        ("deadzone(v, x)", ["'deadzone(v, x)' puts m/s together with m"]),
        ("v*exp(x)", ["'x' has the dimension of m, but exp() needs 1"]),
        ("v*log(-(x + 2)/2)", ["'-(x + 2)/2' has the dimension of m, but log() needs 1"]),
        ("v*n**x", ["'x' has the dimension of m, but an exponent needs 1"]),
        ("sqrt(v)", ["'sqrt(v)' has the dimension of m**(1/2)/s**(1/2)"]),
        ("v**1.5", ["'v**1.5' has the dimension of m**(3/2)/s**(3/2)"]),
        ("sign(v)", ["'sign(v)' has the dimension of 1"]),
        ("-x + NN(v)", ["'-x + NN(v)' has the dimension of m, but the place needs m/s"]),
        ("v*sin(v) + v*cos(x)", ["sin() needs 1", "cos() needs 1"]),
    ],
)
def test_terms_that_do_not_fit_are_named(derivative, parts):
    found = warnings(plant(derivative))
    assert len(found) == len(parts)
    for warning, part in zip(found, parts, strict=True):
        assert warning.startswith("[states.x] derivative: ")
        assert part in warning
        assert warning.endswith("; check the units of its terms")


@pytest.mark.parametrize(
    "derivative",
    [
        "603*x",
        "v + 603*x",
        "v*tanh(x/3)",
        "v + exp(0.3*x)*v",
        "-9.81 + v",
        "4*pi*x/3".replace("pi", "3.14159"),
    ],
)
def test_a_number_may_be_a_constant_in_a_unit(derivative):
    """603*(Ts - Tr) is a heat flow: what a number multiplies has no unit to check."""
    assert warnings(plant(derivative)) == []


@pytest.mark.parametrize(
    "derivative", ["2*x", "0.5*x", "-x/2", "2*3.1416*x", "1.5*x + v", "3*(v - x)"]
)
def test_a_factor_of_a_formula_has_no_unit(derivative):
    assert len(warnings(plant(derivative))) == 1


def test_an_output_must_have_its_own_unit():
    assert warnings(plant(value="d(x)/k")) == []
    assert warnings(plant(value="d(x)")) == [
        "[outputs.y] value: 'd(x)' has the dimension of m/s, but the place needs m; "
        "check the units of its terms"
    ]


@pytest.mark.parametrize(
    ("enters", "target", "unit", "told"),
    [
        ("output", "y", "mm", "'mm' is 0.001 m, but sizes"),
        ("state", "x", "km/h", "'km/h' is 0.277778 (m)/s, but sizes"),
        ("gain", "v", "%", "'%' is 0.01 1, but sizes"),
    ],
)
def test_a_fault_in_a_unit_of_another_size_is_told(enters, target, unit, told):
    fault = f'[faults.f]\nenters = "{enters}"\ntarget = "{target}"\nunit = "{unit}"'
    (found,) = warnings(plant(more=fault))
    assert told in found


@pytest.mark.parametrize(("unit", "count"), [("K", 0), ("degC", 0), ("degF", 1)])
def test_the_size_of_a_fault_is_a_difference(unit, count):
    """5 degC of bias are 5 K, though a reading of 5 degC is 278.15 K."""
    fault = f'[faults.f]\nenters = "output"\ntarget = "y"\nunit = "{unit}"'
    found = warnings(plant("0*x", value="x", x="degC", y="degC", k="1", more=fault))
    assert len([each for each in found if "faults.f" in each]) == count


def test_an_absent_unit_fits_everywhere():
    assert warnings(plant("k*x*v", x="", k="")) == []
    assert warnings(plant(value="v*v", y="")) == []


def test_a_unit_that_cannot_be_read_is_told_once_and_then_left_alone():
    (warning,) = warnings(plant("k*x + k*k*v", value="k*x", k="per sec"))
    assert warning.startswith("[parameters.k] unit = 'per sec' cannot be read")


@pytest.mark.parametrize(
    ("enters", "target", "unit", "needed"),
    [
        ("state", "x", "m/s", None),
        ("state", "x", "m", "m/s"),
        ("input", "v", "m/s", None),
        ("input", "v", "V", "m/s"),
        ("output", "y", "s", "m"),
        ("gain", "v", "1", None),
        ("gain", "v", "m/s", "1"),
        ("state", "x", "", None),
    ],
)
def test_a_fault_has_the_unit_of_the_place_where_it_enters(enters, target, unit, needed):
    fault = f'[faults.f]\nenters = "{enters}"\ntarget = "{target}"\nunit = "{unit}"'
    found = warnings(plant(more=fault))
    if needed is None:
        assert found == []
    else:
        (warning,) = found
        assert warning.startswith(f"[faults.f] unit = '{unit}'")
        assert f"is measured in {needed};" in warning


def test_absurd_exponents_end_quickly_and_without_an_error():
    text = "x"
    for _ in range(15):
        text = f"({text})**1e300"
    assert warnings(plant(text)) == []


@pytest.mark.parametrize(
    ("given", "wanted", "value", "result"),
    [
        ("mm", "m", 5, 0.005),
        ("m", "mm", 0.005, 5),
        ("mm**2", "m^2", 3, 3e-6),
        ("g", "kg", 500, 0.5),
        ("t", "kg", 2, 2000),
        ("km/h", "m/s", 36, 10),
        ("rpm", "rad/s", 60, 2 * math.pi),
        ("deg", "rad", 180, math.pi),
        ("rev", "deg", 0.25, 90),
        ("kWh", "J", 1, 3.6e6),
        ("bar", "kPa", 1, 100),
        ("L/min", "m**3/s", 6, 1e-4),
        ("kOhm", "V/A", 2, 2000),
        ("%", "1", 50, 0.5),
        ("ms", "min", 6000, 0.1),
        ("degC", "K", 20, 293.15),
        ("K", "°C", 293.15, 20),
        ("degC", "mK", 20, 293150),
        ("mK", "degC", 293150, 20),
        ("mm/degC", "m/K", 1, 0.001),  # a difference has no zero
        ("degF", "degC", 212, 100),
        ("degC", "degF", -40, -40),
        ("°F", "K", 32, 273.15),
        ("degF/s", "degC/min", 9, 300),  # 5 degC in a second
        ("percent", "1", 50, 0.5),
        ("m3/h", "m^3/s", 3600, 1),
        ("m³/h", "L/min", 6, 100),
        ("L/min", "m3/h", 100, 6),
        ("kg*s-2", "N/m", 7, 7.0),
        ("U/min", "rpm", 3, 3.0),
        ("mA", "A", 20, 0.02),
        ("psi", "bar", 1, 0.4535923700 * 9.80665 / 0.0254**2 / 1e5),  # a pound on a square inch
        ("mNm", "N*m", 2, 2e-3),
    ],
)
def test_what_makes_one_unit_of_another(given, wanted, value, result):
    found = eval(f"{value}{conversion(given, wanted)}")  # noqa: S307
    assert found == pytest.approx(result, rel=1e-9)  # ten digits are written


@pytest.mark.parametrize(
    ("given", "wanted"),
    [
        ("m", "m"),
        ("N*m", "J"),
        ("°C", "degC"),
        ("Ohm", "V/A"),
        ("rpm", "Hz"),  # which may be meant per turn or per radian
        ("rad", "1"),
        ("counts", "1"),
        ("dB", "%"),
        ("", "m"),
        ("m", " "),
        ("-", "m"),
        ("furlong", "m"),
        ("km^999", "m^999"),  # beyond float64
        ("0*m", "m"),
        ("m", "0*m"),
    ],
)
def test_nothing_to_convert_or_nothing_known(given, wanted):
    assert conversion(given, wanted) == ""


@pytest.mark.parametrize(("given", "wanted"), [("V", "m"), ("m", "m/s"), ("1", "N"), ("K", "rpm")])
def test_units_of_different_things(given, wanted):
    assert conversion(given, wanted) is None


def test_a_constant_is_checked_once_it_is_a_parameter_with_a_unit():
    """A flow times 4.18 kJ/(L*K) times a temperature over kJ/K: K/s."""
    text = """
name = "mixer"
[states.T]
unit = "degC"
derivative = "flow/60*HEAT*(20 - T)/C"
[inputs.flow]
unit = "L/min"
[outputs.T]
unit = "degC"
value = "T"
[parameters]
C = { value = 10, unit = "kJ/K" }
"""
    assert warnings(text.replace("HEAT", "4.18")) == []
    text = text.replace("flow/60*HEAT", "c*flow") + 'c = { value = 0.07, unit = "kJ/L/K" }\n'
    assert warnings(text) == []
    (said,) = warnings(text.replace("kJ/L/K", "kJ/L"))
    assert "but the place needs K/s" in said
