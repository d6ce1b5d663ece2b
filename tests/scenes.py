"""A small plant and logs of it in which a bank has once misled, with the bank that judges them.

The tank is exact under the hold, the bank is built from the noise that the logs have, and all logs
have one length, so that one compiled program judges them all.
"""

from functools import cache
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank import FaultBank, build_fault_bank
from faultgauge.detection.noise import Noise
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

Samples: TypeAlias = Float[np.ndarray, "samples"]

TANK = """
name = "tank"
[states.x]
unit = "m"
derivative = "u - 0.2*x"
[inputs.u]
unit = "m/s"
min = 0
max = 2
trusted = [0, 1.8]
[outputs.x]
unit = "m"
value = "x"
[faults.leak]
enters = "state"
target = "x"
unit = "m/s"
[faults.gauge]
enters = "output"
target = "x"
unit = "m"
[faults.weak]
enters = "gain"
target = "u"
"""
STEP, COUNT, SIGMA, PROCESS, RATE = 0.5, 1200, 0.02, 1e-3, 0.2
T = STEP * np.arange(COUNT)
NOISE = Noise(
    *(np.array(each) for each in (
        [SIGMA], [PROCESS], [],
        *([1e-4], [100.0], [1e-3], [5.0]),  # next to no error of the model
        [], [],
    ))
)  # fmt: skip
NOTHING = np.zeros(COUNT)


def moving(seed: int, low: float = 0.5, high: float = 1.5) -> Samples:
    """A command that changes every 10 s."""
    return np.repeat(np.random.default_rng(seed).uniform(low, high, COUNT // 20), 20)


def log(
    seed: int = 1,
    *,
    u: Samples | None = None,
    leak: Samples = NOTHING,
    gauge: Samples = NOTHING,
    weak: Samples = NOTHING,
) -> Run:
    """The tank under `u` with faults as large as they are said to be at every sample."""
    u = moving(seed) if u is None else u
    fade = np.exp(-RATE * STEP)
    x = np.full(COUNT, (u[0] * (1 - weak[0]) + leak[0]) / RATE)
    for k in range(COUNT - 1):
        driven = u[k] * (1 - weak[k]) + leak[k]
        x[k + 1] = fade * x[k] + (1 - fade) / RATE * driven
    y = x + gauge + SIGMA * np.random.default_rng([seed, 1]).standard_normal(COUNT)
    return Run("a", "tank.csv", T.copy(), {"u": u.copy(), "x": y})


def between(start: float, stop: float, size: float = 1.0) -> Samples:
    """`size` from `start` [s] until before `stop` [s], else 0."""
    return size * ((start <= T) & (stop > T))


@cache
def tank_bank(text: str = TANK) -> FaultBank:
    rng = np.random.default_rng(0)
    points = np.stack([rng.uniform(0, 12, 60), rng.uniform(0, 2, 60)], axis=1)
    record = {
        "max_step": 1.0,
        "envelope_points": points.tolist(),
        "columns": {"states": [["x", 0]], "outputs": ["x"]},
        "data": {"fit": [], "validate": []},
    }
    model = Model(GrayBoxPlant.untrained(parse_plant(text)), record)
    return build_fault_bank(model, [log(0)], NOISE)
