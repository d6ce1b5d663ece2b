"""A lag whose state a fault pushes and whose sensor one biases, exact under the hold."""

import numpy as np

from faultgauge.detection.noise import Noise
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

LAG = """
name = "lag"
[states.x]
derivative = "u - 0.2*x"
[inputs.u]
[outputs.x]
value = "x"
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
    record = {
        "max_step": 1.0,
        "envelope_points": points.tolist(),
        "columns": {"states": [["x", 0]], "outputs": ["x"]},
        "data": {"fit": [], "validate": []},
    }
    text = text.format(more=more, rules=rules)
    return Model(GrayBoxPlant.untrained(parse_plant(text)), record)


def log(seed, push=0.0, error=0.0, bias=0.0, until=COUNT, samples=COUNT):
    """Exact under the hold, with `error` on x' throughout: what the model does not know."""
    rng = np.random.default_rng(seed)
    error = np.broadcast_to(error, samples)
    u = np.repeat(rng.uniform(-1, 1, samples // 20), 20)
    k = np.arange(samples)
    acts = (k >= COUNT // 2) & (k < until)
    fade, x = np.exp(-0.2 * STEP), np.zeros(samples)
    for j in range(samples - 1):
        x[j + 1] = fade * x[j] + (1 - fade) / 0.2 * (u[j] + error[j] + push * acts[j])
    y = x + bias * acts + SIGMA * rng.standard_normal(samples)
    return Run(f"run{seed}", "lag.csv", STEP * k, {"u": u, "x": y})
