"""How large a fault may be, from what it enters, in its own unit."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from faultgauge.detection.bank.priors import ranges
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.network import Network
from faultgauge.plants.plant_file import parse_plant
from models import record_of

TEXT = """name = "p"
[states.x]
derivative = "k*u - b*x - N(x) + z + 0*e"
[inputs.u]
[outputs.y]
value = "N(2*x)"
[parameters]
k = { value = -3 }
b = { value = 2, min = 1.5, max = 2.5 }
z = { value = 0, min = -1, max = 3 }
e = { value = 0 }
[networks.N]
hidden = 1
"""
FAULTS = {  # where it enters, its target, relative: the range
    ("parameter", "k", False): 6.0,  # -3 to 3
    ("parameter", "b", False): 1.0,  # its own limits are narrower than -2 to 2
    ("parameter", "z", False): 4.0,
    ("parameter", "e", False): 0.0,  # nothing is known; the noise then says how large
    ("parameter", "k", True): 2.0,
    ("network", "N", False): 4 * np.tanh(1) - 4 * np.tanh(-0.5),  # at 2 and at -1
    ("network", "N", True): 2.0,
    ("output_gain", "y", False): 2.0,
    ("gain", "u", False): 2.0,
    ("input", "u", False): 3.0,
}


def test_ranges_over_the_envelope():
    text = TEXT
    for k, (enters, target, relative) in enumerate(FAULTS):
        text += f'[faults.f{k}]\nenters = "{enters}"\ntarget = "{target}"\n'
        text += "relative = true\n" if relative else ""
    plant = GrayBoxPlant.untrained(parse_plant(text))
    net = dataclasses.replace(
        Network.zeros(1, 1),
        weights_out=jnp.array([4.0]),
        weights_in=jnp.array([[1.0]]),
        input_scale=jnp.array([2.0]),
    )
    plant = dataclasses.replace(plant, networks={"N": net})
    # x from -0.5 to 1: the arguments x and 2 x reach from -1 to 2
    points = [[-0.5, 1.0], [0.5, 2.0], [1.0, -1.0]]
    found = ranges(Model(plant, record_of(envelope_points=points)), plant)
    np.testing.assert_allclose(found, list(FAULTS.values()), rtol=1e-12)


def test_a_rate_that_is_held_near_0_has_the_range_of_its_terms():
    """dx = u - 2 x with u = 2 x at every point: the rate is 0 all along, and moves by the range of
    u where that moves alone, by twice that of x where x does."""
    text = """name = "held"
[states.x]
derivative = "u - 2*x"
[inputs.u]
[outputs.y]
value = "x"
[faults.force]
enters = "state"
target = "x"
"""
    plant = GrayBoxPlant.untrained(parse_plant(text))
    points = [[-0.5, -1.0], [0.5, 1.0], [1.0, 2.0]]
    found = ranges(Model(plant, record_of(envelope_points=points)), plant)
    np.testing.assert_allclose(found, [3.0], rtol=1e-12)
