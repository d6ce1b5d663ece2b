"""A small tank whose truth is known in closed form, in memory, and what was learned of it."""

from types import SimpleNamespace

import numpy as np
import pytest

import faultgauge as fg

STEP, COUNT = 0.1, 600
A, B, LEAK = 0.8, 2.5, 0.6
PLANT = {
    "name": "tank",
    "states": {"x": {"unit": "m", "derivative": "b*u - a*x"}},
    "inputs": {"u": {"unit": "V"}},
    "outputs": {"x": {"unit": "m", "value": "x"}},
    "parameters": {"a": {"value": 1.0, "min": 0}, "b": {"value": 1.0}},
    "faults": {"leak": {"enters": "state", "target": "x", "unit": "m/s"}},
}


def log(seed, leak=0.0):
    """x' = b u - a x + f over each held input, exactly, with sensor noise; f from the middle."""
    random = np.random.default_rng(seed)
    u = np.repeat(random.choice([-1.0, 1.0], COUNT // 10), 10)
    f = np.where(np.arange(COUNT) >= COUNT // 2, leak, 0.0)
    x, decay = np.zeros(COUNT), np.exp(-A * STEP)
    for k in range(COUNT - 1):
        x[k + 1] = decay * x[k] + (1 - decay) / A * (B * u[k] + f[k])
    return {"t": STEP * np.arange(COUNT), "u": u, "x": x + 0.002 * random.standard_normal(COUNT)}


@pytest.fixture(scope="session")
def tank():
    """`log(seed, leak)`, and what is true of it."""
    return SimpleNamespace(log=log, plant=PLANT, a=A, b=B, leak=LEAK, step=STEP, count=COUNT)


@pytest.fixture(scope="session")
def learned():
    return fg.fit(PLANT, log(1))


@pytest.fixture(scope="session")
def calibrated(learned):
    return fg.calibrate(learned.model, log(2))


@pytest.fixture(scope="session")
def judged(calibrated):
    return fg.estimate(calibrated.model, log(3, LEAK))
