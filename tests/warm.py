"""A tank that warms, whose pump may be off or weak: one plant for those who ask what is decided of
a log and what is told of it in hindsight, so that what one has compiled serves the other."""

from functools import cache

import numpy as np

from models import as_stated

TANK = """
name = "tank"
[states.x]
derivative = "u - 0.2*x + warm"
[inputs.u]
hold = "zero"
min = 0
max = 2
[outputs.x]
value = "x"
[parameters]
warm = { value = 0.1, vary = "slow", min = 0, max = 1 }
[faults.pump]
enters = "input"
target = "u"
unit = "l/s"
[faults.weak]
enters = "gain"
target = "u"
"""
STEP, COUNT, SIGMA = 0.5, 800, 0.02


@cache
def model(text=TANK):
    rng = np.random.default_rng(0)
    points = np.stack([rng.uniform(0, 12, 60), rng.uniform(0, 2, 60)], axis=1)
    return as_stated(text, points)
