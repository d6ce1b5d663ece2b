"""A heated block in a shell: the block measured every second, the shell every ten, rounded.

    da = g P - c (a - b),   db = e (a - b) - k (b - room)

The file has one temperature of the room, which wanders.
"""

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, white

__all__ = ["slow_sensor"]

FILE = """
name = "block and shell"
[states]
a = { unit = "degC", derivative = "g*P - c*(a - b)" }
b = { unit = "degC", derivative = "e*(a - b) - k*(b - room)" }
[inputs]
P = { unit = "W", min = 0, max = 60, hold = "zero" }
[outputs]
block = { unit = "degC", value = "a" }
shell = { unit = "degC", value = "b" }
[parameters]
g = { value = 0.015, min = 0 }
c = { value = 0.02, min = 0 }
e = { value = 0.01, min = 0 }
k = { value = 0.004, min = 0 }
room = { value = 23 }
[faults]
power_bias = { enters = "input", target = "P", unit = "W" }
power_loss = { enters = "gain", target = "P" }
block_bias = { enters = "output", target = "block", unit = "K" }
shell_bias = { enters = "output", target = "shell", unit = "K" }
"""
HEAT, INNER, OUTER, LOSS = 0.02, 1 / 40, 1 / 80, 1 / 200  # K/s/W, 1/s
STEP, SAMPLES = 1.0, 1500
ROOM, WANDER, WANDER_TIME = 23.0, 1.0, 600.0  # degC, K, s
NOISE, QUANTUM, EVERY = (0.05, 0.1), 0.5, 10  # K, K, s


def slow_sensor() -> Case:
    sizes = {
        "power_bias": Sizes(5, 10, 25),
        "power_loss": Sizes(0.1, 0.2, 0.8, (1.0,)),
        "block_bias": Sizes(4, 8, 25),
        "shell_bias": Sizes(4, 8, 25),
    }
    return Case("slow_sensor", FILE, truth, sizes, slow={"shell": EVERY})


def rates(x: Vector, u: Vector, d: Vector) -> Vector:
    a, b = x
    return HEAT * u[0] - INNER * (a - b), OUTER * (a - b) - LOSS * (b - d[0])


def truth(rng: np.random.Generator) -> Truth:
    drive = levels(rng, SAMPLES, STEP, (0.0, 50.0), (60.0, 240.0))
    return Truth(
        rates=rates,
        states=("a", "b"),
        start=(ROOM + float(rng.uniform(40, 60)), ROOM + float(rng.uniform(20, 40))),
        sensors=(0, 1),
        command=lambda k, y: (drive[k],),
        limits=((0.0, 60.0),),
        disturbances=ROOM + coloured(rng, SAMPLES, STEP, (WANDER,), WANDER_TIME),
        noise=white(rng, SAMPLES, NOISE),
        quantum=(0.0, QUANTUM),
        step=STEP,
        substeps=1,
    )
