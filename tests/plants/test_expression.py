"""The expression language: values, precedence, and every refusal."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from faultgauge.errors import InputError
from faultgauge.plants.expression import (
    Scope,
    derivatives_used,
    evaluate,
    names_used,
    networks_used,
    parse,
)

SCOPE = Scope(names=["x", "y", "speed"], states=["x", "speed"], networks=["NN", "friction"])


def refusal(text):
    with pytest.raises(InputError) as caught:
        parse(text, "plant.toml, [states.x] derivative", SCOPE)
    message = str(caught.value)
    assert message.startswith("plant.toml, [states.x] derivative: column ")
    return message


def column(message):
    return int(message.partition("column ")[2].partition(" ")[0])


# Each value worked out by hand at x = [1, 4], y = [-2, 3].
VALUES = [
    ("2", [2, 2]),
    ("x + 2*y", [-3, 10]),
    ("x - y - 1", [2, 0]),
    ("12/x/2", [6, 1.5]),
    ("-x**2", [-1, -16]),
    ("(-x)**2", [1, 16]),
    ("2**x**0.5", [2, 4]),
    ("x**-1", [1, 0.25]),
    ("+x - -y", [-1, 7]),
    ("2*(x + y)*3", [-6, 42]),
    ("abs(y)", [2, 3]),
    ("sign(y)", [-1, 1]),
    ("sqrt(x)", [1, 2]),
    ("exp(0*x)", [1, 1]),
    ("log(exp(y))", [-2, 3]),
    ("sin(0*x)", [0, 0]),
    ("cos(0*x)", [1, 1]),
    ("tanh(log(x)/2)", [0, 0.6]),  # tanh(log(2)) = (4 - 1)/(4 + 1)
    ("min(x, y)", [-2, 3]),
    ("max(x, y, 2)", [2, 4]),
    ("clip(y, -1, x)", [-1, 3]),
    ("clip(x, 2, 3)", [2, 3]),
    ("overflow(x, 3)", [0, 1]),
    ("overflow(3, x)", [2, 0]),
    ("deadzone(y, 0.5)", [-1.5, 2.5]),
    ("deadzone(y, 2.5)", [0, 0.5]),
    (" x ", [1, 4]),
    ("(x +\n y)", [-1, 7]),
    ("1e-3*x + .5 + 1_000*0", [0.501, 0.504]),
]


@pytest.mark.parametrize("xp", [np, jnp], ids=["numpy", "jax"])
@pytest.mark.parametrize(("text", "expected"), VALUES)
def test_values_are_those_worked_out_by_hand(text, expected, xp):
    values = {"x": xp.asarray([1.0, 4.0]), "y": xp.asarray([-2.0, 3.0])}
    found = evaluate(parse(text, "here", SCOPE).tree, values, xp)
    # A few roundings of a float64.
    np.testing.assert_allclose(np.broadcast_to(found, 2), expected, rtol=1e-14, atol=1e-15)


def test_a_root_has_a_slope_wherever_it_has_a_value():
    """1/(2 sqrt(x)); 0 at 0, as for a tank that begins empty: sqrt(max(x, 0)) has one on both
    sides."""
    tree = parse("sqrt(max(x, 0))", "here", SCOPE).tree
    x = jnp.asarray([-1.0, 0.0, 0.25, 4.0])
    slope = jax.vmap(jax.grad(lambda x: evaluate(tree, {"x": x}, jnp)))(x)
    np.testing.assert_allclose(slope, [0, 0, 1, 0.25], rtol=1e-14)
    assert np.isnan(evaluate(parse("sqrt(x)", "here", SCOPE).tree, {"x": x}, jnp)[0])


def test_derivatives_and_networks_are_looked_up():
    tree = parse("d(x)*2 + NN(x, 1) - friction(d(speed))", "here", SCOPE).tree
    found = evaluate(
        tree,
        {"x": 3.0},
        np,
        derivatives={"x": 5.0, "speed": 7.0},
        networks={"NN": lambda a, b: 10 * a + b, "friction": lambda a: a**2},
    )
    assert found == 2 * 5 + (30 + 1) - 49


def test_what_an_expression_uses():
    expression = parse("-d(x)*y + NN(speed, d(speed)) + NN(y, y)**2", "here", SCOPE)
    assert names_used(expression) == {"y", "speed"}
    assert derivatives_used(expression) == {"x", "speed"}
    assert {name: len(calls) for name, calls in networks_used(expression).items()} == {"NN": 2}
    assert expression.text == "-d(x)*y + NN(speed, d(speed)) + NN(y, y)**2"


# Text joined without parentheses of its own: precedence is left to the two parsers.
OPERANDS = st.sampled_from(["x", "y", "2.0", "0.5", "3.25", "1e2", "7."])
SUMS = st.recursive(
    OPERANDS,
    lambda part: st.one_of(
        st.builds("{}{}{}".format, part, st.sampled_from(["+", " - ", "*", "/", "**"]), part),
        st.builds("({})".format, part),
        st.builds("-{}".format, part),
    ),
    max_leaves=10,
)


@given(SUMS, st.floats(0.1, 10), st.floats(-10, 10))
@settings(deadline=None, max_examples=200, database=None)
def test_arithmetic_agrees_with_python(text, x, y):
    values = {"x": x, "y": y}
    try:
        # The text consists of the pieces above and of nothing else.
        expected = eval(text, {"__builtins__": {}}, values)  # noqa: S307
    except (ZeroDivisionError, OverflowError):
        assume(False)
    assume(isinstance(expected, float) and math.isfinite(expected))
    # The very same operations in the same order, hence the very same bits.
    assert evaluate(parse(text, "here", SCOPE).tree, values, np) == expected


@pytest.mark.parametrize(
    ("text", "at"),
    [
        ("x.real", 1),
        ("1 + x.__class__", 5),
        ("x[0]", 1),
        ("lambda: x", 1),
        ("[x for x in y]", 1),
        ("{x}", 1),
        ("(x, y)", 1),
        ("x < y", 1),
        ("x == y", 1),
        ("x and y", 1),
        ("not x", 1),
        ("x if y else 1", 1),
        ("x // y", 1),
        ("x % y", 1),
        ("x @ y", 1),
        ("x & y", 1),
        ("~x", 1),
        ("2*(x := 1)", 4),
        ("min(x, y, key=x)", 1),
        ("min(*x)", 5),
        ("max(x, **y)", 1),
        ("f'{x}'", 1),
        ("NN(x)(y)", 1),
        ("(x.real)(y)", 1),
        ("~" * 1900 + "x", 1),
    ],
)
def test_anything_but_arithmetic_is_refused_with_what_is_legal(text, at):
    message = refusal(text)
    assert "only numbers, names, + - * / **, parentheses and the functions abs, sign" in message
    assert column(message) == at


@pytest.mark.parametrize("text", ["'os'", "True", "None", "...", "b'x'", "1j", "x + 'y'", "'\\d'"])
def test_a_constant_that_is_not_a_real_number_is_refused(text):
    assert "is not a number" in refusal(text)


@pytest.mark.parametrize(
    ("text", "at"),
    [("1/0", 1), ("x + 9**999", 5), ("(-1)**0.5", 1), ("x/(1/(2 - 2))", 4), ("1e308*10", 1)],
)
def test_a_constant_that_is_not_finite_and_real_is_refused(text, at):
    message = refusal(text)
    assert "not a finite real number" in message
    assert column(message) == at


def test_a_number_beyond_floats_is_refused():
    assert "too large" in refusal("1e999")
    assert "too large" in refusal("9" * 400)


@pytest.mark.parametrize(
    ("text", "at", "part"),
    [
        ("2*sped", 3, "unknown name 'sped' (did you mean 'speed'?); legal here: x, y, speed"),
        ("  zz", 3, "unknown name 'zz'; legal here"),
        ("µ + zz", 1, "unknown name 'μ'"),
        ("(x +\n zz)", 7, "unknown name 'zz'"),
        ("__class__", 1, "unknown name '__class__'"),
        ("__import__(x)", 1, "unknown function or network '__import__'"),
        ("eval(x)", 1, "unknown function or network 'eval'"),
        ("x + sinn(y)", 5, "(did you mean 'sin'?)"),
        ("x(y)", 1, "unknown function or network 'x'"),
        ("frictoin(y)", 1, "(did you mean 'friction'?)"),
        ("x + NN", 5, "'NN' must be called with arguments"),
        ("sin", 1, "'sin' must be called"),
        ("d*2", 1, "'d' must be called"),
        ("NN()", 1, "needs at least one argument"),
        ("d(y)", 3, "unknown state in d() 'y'; legal here: x, speed"),
        ("1 + d(spead)", 7, "(did you mean 'speed'?)"),
        ("d()", 1, "name of one state"),
        ("d(x, x)", 1, "name of one state"),
        ("d(x + x)", 1, "name of one state"),
        ("d(d(x))", 1, "name of one state"),
    ],
)
def test_an_unknown_name_is_answered_by_column_and_what_is_legal(text, at, part):
    message = refusal(text)
    assert part in message
    assert column(message) == at


def test_columns_count_characters_where_names_are_not_ascii():
    with pytest.raises(InputError, match=r"column 5 .*unknown name 'zz'"):
        parse("δ + zz", "here", Scope(names=["δ"]))


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("sin()", "sin() takes 1 argument(s), not 0"),
        ("abs(x, y)", "abs() takes 1 argument(s), not 2"),
        ("min(x)", "min() takes 2 to 8 argument(s), not 1"),
        ("max(" + ", ".join("x" * 9) + ")", "max() takes 2 to 8 argument(s), not 9"),
        ("clip(x, y)", "clip() takes 3 argument(s), not 2"),
        ("overflow(x)", "overflow() takes 2 argument(s), not 1"),
        ("deadzone(x)", "deadzone() takes 2 argument(s), not 1"),
    ],
)
def test_a_wrong_number_of_arguments_is_refused(text, wanted):
    assert wanted in refusal(text)


@pytest.mark.parametrize(
    ("text", "at"),
    [
        ("x y", 3),
        ("(x", 1),
        ("x)", 2),
        ("x = y", 3),
        ("x; y", 2),
        ("import os", 1),
        ("x\0y", 1),
        ("x +\n y", 4),
    ],
)
def test_text_that_is_no_formula_is_refused(text, at):
    message = refusal(text)
    assert "not a formula" in message
    assert column(message) == at


@pytest.mark.parametrize("text", ["", "   ", "\n"])
def test_empty_text_is_refused(text):
    assert "is empty" in refusal(text)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("x + " * 600 + "x", "longer than 2000 characters"),
        ("(" * 500 + "x" + ")" * 500, "more than 40 nested parentheses"),
        ("-" * 1900 + "x", "nested deeper than 40"),
        ("x**" * 600 + "x", "nested deeper than 40"),
        ("+".join(["min(" + ",".join(["x"] * 8) + ")"] * 39) + "+" + "+".join("x" * 2), "deeper"),
        ("max(" + ",".join(["min(" + "x+x+x+x," * 7 + "x)"] * 8) + ")", "more than 400 numbers"),
    ],
)
def test_oversized_text_is_refused_in_an_instant(text, part):
    message = refusal(text)
    assert part in message
    assert len(message) < 300


def test_depth_and_length_below_the_limits_are_legal():
    text = "(" * 40 + "x" + ")" * 40 + "+x" * 38
    assert evaluate(parse(text, "here", SCOPE).tree, {"x": 2.0}, np) == 2 * 39
    assert parse("x" + " " * 1999, "here", SCOPE).text.startswith("x ")


def test_without_states_d_is_not_known():
    with pytest.raises(InputError, match="unknown function or network 'd'"):
        parse("d(x)", "--map h", Scope(names=["x"]))


def test_whole_powers_are_products():
    """A call for each number is what a power of real numbers takes."""
    x = np.array([-1.5, 0.25, 3.0])
    for text, found in (("x**3", x**3), ("x**-2", 1 / (x * x)), ("x**0", np.ones(3))):
        node = parse(text, "here", SCOPE).tree

        def of(x, node=node):
            return evaluate(node, {"x": x}, xp=jnp)

        np.testing.assert_allclose(of(jnp.asarray(x)), found, rtol=1e-15)
        names = {each.primitive.name for each in jax.make_jaxpr(of)(x).eqns}
        assert "pow" not in names
