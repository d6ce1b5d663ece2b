"""A lag that is known exactly, calibrated by hand, with faults that only a moving input parts."""

import numpy as np
import pytest

from calibrations import for_bank
from faultgauge.telemetry import Run
from models import as_stated

STEP, SIGMA, SLOW = 0.1, 0.05, 0.5  # s, m, 1/s
PLANT = """
name = "lag"
[states.x]
unit = "m"
derivative = "u - 0.5*x"
[inputs.u]
unit = "V"
min = -4
max = 4
hold = "zero"
[outputs.x]
unit = "m"
value = "x"
"""
FAULTS = """
[faults.push]
enters = "input"
target = "u"
unit = "V"
min = -2
max = 2
[faults.loss]
enters = "gain"
target = "u"
"""


@pytest.fixture(scope="session")
def modelled():
    """A calibrated model of a plant file that begins like `PLANT`."""

    def modelling(faults=FAULTS, calibrated=True):
        points = np.random.default_rng(0).uniform(-8, 8, (40, 2))
        none, one = {}, {"x": 1e-9}
        noise = {
            "sigma": {"x": SIGMA}, "process": one, "drift": none, "size": one,
            "lasting": {"x": 50.0}, "share": {"u": 1e-9}, "settling": {"u": 5.0}, "spread": none,
            "shift": none, "renewed": none,
        }  # fmt: skip
        model = as_stated(PLANT + faults, points)
        if not calibrated:
            return model
        return for_bank(model, noise, level=5.0, healthy_s=1000.0, mtbfa_s=7200.0)

    return modelling


def lagged(u):
    """x under a held input, exactly, from its rest at the first."""
    x, decay = np.full(len(u), u[0] / SLOW), np.exp(-SLOW * STEP)
    for k in range(len(u) - 1):
        x[k + 1] = decay * x[k] + (1 - decay) / SLOW * u[k]
    return x


@pytest.fixture(scope="session")
def log():
    def logging(u, name="r"):
        t = STEP * np.arange(len(u))
        return Run(name, f"{name}.csv", t, {"u": np.array(u, float), "x": lagged(u)})

    return logging
