"""A lag whose state a fault pushes and whose sensor one biases, exact under the hold."""

import numpy as np

from faultgauge.detection.bank.noise import Noise
from faultgauge.telemetry import Run
from models import as_stated

PLANT = """
name = "lag"
[states.x]
derivative = "u - 0.2*x"
[inputs.u]
[outputs.x]
value = "x"
"""
LAG = (
    PLANT
    + """
[faults.push]
enters = "state"
target = "x"
{more}
[faults.bias]
enters = "output"
target = "x"
[detection]
{rules}
"""
)
STEP, SIGMA, COUNT = 0.5, 0.02, 800
NOISE = Noise(
    *(np.array(each) for each in (
        [SIGMA], [1e-3], [],
        *([1e-4], [100.0], [1e-3], [5.0]),  # next to no error of the model
        [], [],
    ))
)  # fmt: skip


def model(more="", rules="", text=LAG):
    """With `more` keys of the fault `push`, and `rules` of detection."""
    points = np.random.default_rng(0).uniform([-6, -1], [6, 1], (60, 2))
    text = text.format(more=more, rules=rules)
    return as_stated(text, points)


def driven(u, x=0.0, steps=0.0):
    """Its state from `x` on, exact while each of `u` is held, with `steps` of x at the samples."""
    steps = np.broadcast_to(steps, len(u))
    fade, x = np.exp(-0.2 * STEP), np.full(len(u), x)
    for k in range(len(u) - 1):
        x[k + 1] = fade * x[k] + (1 - fade) / 0.2 * u[k] + steps[k]
    return x


def log(seed, push=0.0, error=0.0, bias=0.0, until=COUNT, samples=COUNT):
    """Exact under the hold, with `error` on x' throughout: what the model does not know."""
    rng = np.random.default_rng(seed)
    error = np.broadcast_to(error, samples)
    u = np.repeat(rng.uniform(-1, 1, samples // 20), 20)
    k = np.arange(samples)
    acts = (k >= COUNT // 2) & (k < until)
    x = driven(u + error + push * acts)
    y = x + bias * acts + SIGMA * rng.standard_normal(samples)
    return Run(f"run{seed}", "lag.csv", STEP * k, {"u": u, "x": y})
