"""Two tanks, one above the other, whose three constants are never twice the same.

dh1 = k u - c1 sqrt(h1),   dh2 = c1 sqrt(h1) - c2 sqrt(h2) + leak
"""

from functools import partial

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels

__all__ = ["tanks"]

FILE = """
name = "two tanks"
[states]
h1 = { unit = "cm", derivative = "k*u - c1*sqrt(max(h1, 0))" }
h2 = { unit = "cm", derivative = "c1*sqrt(max(h1, 0)) - c2*sqrt(max(h2, 0))" }
[inputs]
u = { unit = "V", min = 0, max = 10, hold = "zero" }
[outputs]
level1 = { unit = "cm", value = "h1" }
level2 = { unit = "cm", value = "h2" }
[parameters]
k = { value = 0.08, min = 0 }
c1 = { value = 0.07, min = 0 }
c2 = { value = 0.07, min = 0 }
[faults]
leak = { enters = "state", target = "h2", unit = "cm/s" }
pump_bias = { enters = "input", target = "u", unit = "V" }
level_bias = { enters = "output", target = "level2", unit = "cm" }
pump_loss = { enters = "gain", target = "u" }
"""
CONSTANTS = (0.1, 0.09, 0.085)  # k [cm/s/V], c1, c2 [cm^0.5/s]
STEP, SAMPLES = 2.0, 750  # s; 25 min
NOISE, NOISE_TIME, QUANTUM = 0.05, 10.0, 0.02  # cm, s, cm


def tanks(name: str, scatter: float) -> Case:
    """`scatter`: standard deviation of each constant's logarithm from run to run."""
    return Case(
        name,
        FILE,
        partial(truth, scatter=scatter),
        {
            "leak": Sizes(0.03, 0.06, 0.2, (-1.0,)),
            "pump_bias": Sizes(0.4, 0.8, 2.0),
            "level_bias": Sizes(1.5, 3.0, 6.0),
            "pump_loss": Sizes(0.1, 0.2, 0.8, (1.0,)),
        },
    )


def truth(rng: np.random.Generator, scatter: float) -> Truth:
    k, c1, c2 = (each * float(np.exp(scatter * rng.standard_normal())) for each in CONSTANTS)
    drive = levels(rng, SAMPLES, STEP, (2.0, 4.0), (60.0, 240.0))

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        above, below = (max(each, 0.0) ** 0.5 for each in x)
        return k * u[0] - c1 * above, c1 * above - c2 * below

    return Truth(
        rates=rates,
        states=("h1", "h2"),
        start=((k * drive[0] / c1) ** 2, (k * drive[0] / c2) ** 2),
        sensors=(0, 1),
        command=lambda k, y: (drive[k],),
        limits=((0.0, 10.0),),
        disturbances=np.zeros((SAMPLES, 1)),
        noise=coloured(rng, SAMPLES, STEP, (NOISE, NOISE), NOISE_TIME),
        quantum=(QUANTUM, QUANTUM),
        step=STEP,
        substeps=2,
    )
