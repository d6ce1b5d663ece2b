"""A lag with another behind it, a seventh as long, that the file does not have.

10 dx = 2 u - x,   1.5 ds = x - s
"""

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, levels, white

__all__ = ["lag"]

FILE = """
name = "lag"
[states]
x = { derivative = "(g*u - x)/tau" }
[inputs]
u = { min = -2, max = 2, hold = "zero" }
[outputs]
y = { value = "x" }
[parameters]
g = { value = 1.5, min = 0 }
tau = { value = 8, unit = "s", min = 1 }
[faults]
input_bias = { enters = "input", target = "u" }
sensor_bias = { enters = "output", target = "y" }
gain_loss = { enters = "gain", target = "u" }
"""
GAIN, LAG, SECOND = 2.0, 10.0, 1.5  # -, s, s
STEP, SAMPLES = 0.5, 800
NOISE = 0.02


def lag() -> Case:
    sizes = {
        "input_bias": Sizes(0.2, 0.4, 1.0),
        "sensor_bias": Sizes(0.4, 0.8, 2.0),
        "gain_loss": Sizes(0.1, 0.2, 0.8, (1.0,)),
    }
    return Case("lag", FILE, truth, sizes)


def rates(x: Vector, u: Vector, d: Vector) -> Vector:
    return (GAIN * u[0] - x[0]) / LAG, (x[0] - x[1]) / SECOND


def truth(rng: np.random.Generator) -> Truth:
    drive = levels(rng, SAMPLES, STEP, (-1.0, 1.0), (5.0, 25.0))
    return Truth(
        rates=rates,
        states=("x", "s"),
        start=(0.0, 0.0),
        sensors=(1,),
        command=lambda k, y: (drive[k],),
        limits=((-2.0, 2.0),),
        disturbances=np.zeros((SAMPLES, 1)),
        noise=white(rng, SAMPLES, (NOISE,)),
        quantum=(0.0,),
        step=STEP,
        substeps=4,
    )
