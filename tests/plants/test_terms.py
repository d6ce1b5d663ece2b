"""Terms: names for formulas, as if they were written out wherever they stand."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant

WITH = """
name = "coil"
[terms]
heat = "G*(hot - T)"               # which reads one that stands below it
G = "flow*(1 - exp(-UA/flow))"
flow = "wmax*u + 0.1"
[states.T]
derivative = "(heat - loss*(T - cold))/C"
[inputs.u]
[inputs.hot]
[inputs.cold]
[outputs.T]
value = "T"
[outputs.power]
value = "heat + C*d(T)"
[parameters]
wmax = { value = 2.0 }
UA = { value = 1.5 }
C = { value = 30.0 }
loss = { value = 0.3 }
"""
HEAT = "(wmax*u + 0.1)*(1 - exp(-UA/(wmax*u + 0.1)))*(hot - T)"


def test_a_term_is_what_it_stands_for():
    head, rest = WITH.split("[terms]")
    written = head + "[states.T]" + rest.split("[states.T]")[1].replace("heat", HEAT)
    with_terms, without = parse_plant(WITH), parse_plant(written)
    assert [e.tree for e in with_terms.derivatives] == [e.tree for e in without.derivatives]
    assert [e.tree for e in with_terms.values] == [e.tree for e in without.values]
    assert with_terms.warnings == without.warnings == ()
    plant = GrayBoxPlant.untrained(with_terms)
    dx = plant.derivative(jnp.array([20.0]), jnp.array([0.5, 60.0, 10.0]))
    flow = 2.0 * 0.5 + 0.1
    heat = flow * (1 - np.exp(-1.5 / flow)) * 40.0
    assert float(dx[0]) == pytest.approx((heat - 3.0) / 30.0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('flow = "wmax', 'flow = "G + wmax', r"\[terms\] run in a circle, (flow -> G|G -> flow)"),
        ('heat = "G*', 'heat = "Gw*', r"\[terms\] heat: column 1 .*'Gw' \(did you mean 'G'\?\)"),
        ('flow = "wmax', 'flow = "flaw + wmax', r"legal here: T, u, hot, cold, .*, heat, G\."),
        ('flow = "wmax*u + 0.1"', "flow = 3", r"\[terms\] flow"),
        ('flow = "', 'UA = "1"\nflow = "', r"'UA' is already declared in \[parameters\]|\[terms\]"),
        ('flow = "', 'exp = "1"\nflow = "', r"\[terms\] 'exp' stands for the function exp\(\)"),
        ("(heat - loss", "(heta - loss", r"derivative: column 2 .*did you mean 'heat'"),
        ("(heat - loss", "(heat(T) - loss", r"unknown function or network 'heat'"),
    ],
)
def test_what_is_wrong_with_a_term_is_said_by_its_name(old, new, words):
    with pytest.raises(InputError, match=words):
        parse_plant(WITH.replace(old, new))


def test_a_term_that_nothing_reads_is_a_warning():
    (text,) = parse_plant(WITH.replace("[terms]", '[terms]\nspare = "UA/C"')).warnings
    assert "[terms.spare] is declared but no expression uses it" in text


def test_terms_that_grow_without_end_are_refused():
    doubled = "\n".join(f't{k + 1} = "t{k} * t{k}"' for k in range(40))
    text = WITH.replace("[terms]", f'[terms]\nt0 = "UA"\n{doubled}').replace("(heat", "(t40 + heat")
    with pytest.raises(InputError, match=r"with every term written out .* more than 4000 numbers"):
        parse_plant(text)
    nested = "\n".join(f't{k + 1} = "sin(t{k})"' for k in range(60))
    with pytest.raises(InputError, match=r"with every term written out .* nested deeper than 40"):
        parse_plant(WITH.replace("[terms]", f'[terms]\nt0 = "UA"\n{nested}'))
