"""Equivalent starts of a chain of blocks, against SciPy's responses and poles set by hand."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import freqresp

from faultgauge.identification.simulation_error.linear_starts import equivalents
from faultgauge.identification.unknowns import unknown_constants
from faultgauge.plants.gray_box import load_plant

CHAIN = """
name = "two lags and a curve between them"
inputs.u = {}
outputs.y = { value = "g*z" }
networks.curve = { hidden = 3 }
[states]
x = { derivative = "a*(u - x)" }
z = { derivative = "c*(x + curve(x) - z)" }
[parameters]
a = { value = 2, min = 0 }
c = { value = 30, min = 0 }
g = { value = 1.5, min = 0 }
"""
OSCILLATOR = """
name = "one block"
inputs.u = {}
outputs.y = { value = "x" }
[states]
x = { derivative = "v" }
v = { derivative = "u - k*x - b*v" }
[parameters]
k = { value = 4, min = 0 }
b = { value = 0.3, min = 0 }
"""


@pytest.fixture
def plant_file(tmp_path):
    def write(text):
        path = tmp_path / "plant.toml"
        path.write_text(text)
        return load_plant(path)

    return write


def starts(plant):
    unknowns = unknown_constants(plant)
    states = len(plant.signals.states)
    found = equivalents(
        plant,
        unknowns,
        unknowns.vector(plant),
        np.zeros(states),
        np.zeros(1),
        np.random.default_rng(0),
    )
    return [
        {k: float(v) for k, v in unknowns.assemble(plant, jnp.asarray(theta)).parameters.items()}
        for theta in found
    ]


def test_the_poles_of_two_blocks_change_places(plant_file):
    (found,) = starts(plant_file(CHAIN))
    # 0.1 %: the responses and polynomials of an equivalent are asked to agree to that
    assert found["a"] == pytest.approx(30.0, rel=1e-3)
    assert found["c"] == pytest.approx(2.0, rel=1e-3)
    assert found["g"] == pytest.approx(1.5, rel=1e-3)


def test_an_equivalent_responds_as_the_plant_does(plant_file):
    (found,) = starts(plant_file(CHAIN))
    rates = np.logspace(-1, 3, 20)
    given = freqresp(([1.5 * 2 * 30], [1, 32, 60]), rates)[1]
    a, c, g = found["a"], found["c"], found["g"]
    other = freqresp(([g * a * c], [1, a + c, a * c]), rates)[1]
    np.testing.assert_allclose(other, given, rtol=5e-3)  # three constants at 0.1 % each


def test_a_zero_may_stand_in_either_block(plant_file):
    text = CHAIN.replace("c*(x + curve(x) - z)", "c*(x + b*(a*(u - x)) + curve(x) - z)")
    text = text.replace('value = "g*z"', 'value = "g*(z + e*c*(x + b*(a*(u - x)) - z))"')
    text = text.replace("[parameters]", "[parameters]\nb = { value = 0.2 }\ne = { value = 0 }")
    found = starts(plant_file(text))
    assert any(abs(each["e"] - 0.2) < 1e-3 and abs(each["b"]) < 1e-3 for each in found)


def test_one_block_leaves_nothing_open(plant_file):
    assert starts(plant_file(OSCILLATOR)) == []


def test_an_integrator_stays_where_it_is(plant_file):
    assert starts(plant_file(CHAIN.replace("a*(u - x)", "a*u"))) == []
