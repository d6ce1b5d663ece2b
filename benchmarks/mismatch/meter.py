"""A tank whose flow is measured, and by its file follows the pump's command at once.

    dh = q - c sqrt(h),    dq = ((1 + s) k u - q) / lag

The pump needs some seconds to follow, and the supply s wanders for minutes at a time; the file says
flow = k u. So an output's own equation is wrong, in a way that no state of the file can bear. A PI
controller keeps the level.
"""

from collections.abc import Sequence

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, white

__all__ = ["meter"]

FILE = """
name = "metered tank"
[states]
h = { unit = "m", derivative = "k*u - c*sqrt(max(h, 0.01))" }
[inputs]
u = { unit = "V", min = 0, max = 10, hold = "zero" }
[outputs]
level = { unit = "m", value = "h" }
flow = { unit = "m/s", value = "k*u" }
[parameters]
k = { value = 0.005, min = 0 }
c = { value = 0.02, min = 0 }
[faults]
leak = { enters = "state", target = "h", unit = "m/s", max = 0 }
pump_bias = { enters = "input", target = "u", unit = "V" }
level_bias = { enters = "output", target = "level", unit = "m" }
flow_bias = { enters = "output", target = "flow", unit = "m/s" }
"""
STEP, SAMPLES = 2.0, 1500
PUMP, OUTLET, LAG = 0.01, 0.04, 6.0  # m/s/V, sqrt(m)/s, s
SUPPLY, SUPPLY_TIME = 0.015, 150.0  # of the flow, s
NOISE = (0.002, 0.0004)  # m, m/s
GAIN, INTEGRAL = 10.0, 60.0  # V/m, s


def meter() -> Case:
    sizes = {
        "leak": Sizes(0.003, 0.006, 0.02, (-1.0,)),
        "pump_bias": Sizes(0.5, 1.0, 3.0),
        "level_bias": Sizes(0.08, 0.16, 0.4),
        "flow_bias": Sizes(0.005, 0.01, 0.03),
    }
    return Case("meter", FILE, truth, sizes)


def rates(x: Vector, u: Vector, d: Vector) -> Vector:
    h, q = x
    return q - OUTLET * max(h, 0.01) ** 0.5, ((1 + d[0]) * PUMP * u[0] - q) / LAG


def truth(rng: np.random.Generator) -> Truth:
    wanted = levels(rng, SAMPLES, STEP, (0.6, 1.6), (150.0, 400.0))
    summed = OUTLET / PUMP  # V: what holds 1 m

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed
        off = wanted[k] - y[k][0]
        u = GAIN * off + summed
        if 0.0 < u < 10.0:
            summed += GAIN * off * STEP / INTEGRAL
        return (min(max(u, 0.0), 10.0),)

    return Truth(
        rates=rates,
        states=("h", "q"),
        start=(1.0, OUTLET),
        sensors=(0, 1),
        command=command,
        limits=((0.0, 10.0),),
        disturbances=coloured(rng, SAMPLES, STEP, (SUPPLY,), SUPPLY_TIME),
        noise=white(rng, SAMPLES, NOISE),
        quantum=(0.0, 0.0),
        step=STEP,
        substeps=2,
    )
