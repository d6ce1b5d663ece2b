"""`faultgauge fit` from a cold process to a saved model, against a process that uses SciPy.

5,000 samples; ours differentiates the log, trains ten starts, selects one by free run and writes
the model (programs compiled by an earlier call are found on disk). The peer only trains.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from interleave import Times, interleaved

__all__ = ["compete"]

PLANT = """
name = "wheel"
[states.h]
derivative = "friction(h, u)"
[inputs.u]
[outputs.h]
value = "h"
[networks.friction]
hidden = 10
"""
STEP = 0.25  # s


def wheel(count: int) -> np.ndarray:
    """(t, u, h) of a reaction wheel under held torques that sweep its speed; sensor noise on h."""
    rng = np.random.default_rng(0)
    torque, h = np.repeat(0.3 * rng.normal(size=count // 5), 5), 0.0
    rows = np.empty((count, 3))
    for k in range(count):
        sweep = 100 * np.sin(2 * np.pi * k * STEP / 400)
        u = torque[k] + 0.02 * (sweep - h)
        rows[k] = k * STEP, u, h
        for _ in range(5):
            omega = h / 0.84
            stribeck = 0.03 + 0.007 * np.exp(-((omega / 5) ** 2))
            h += STEP / 5 * (u - 2.5e-4 * omega - stribeck * np.tanh(omega))
    rows[:, 2] += 0.02 * rng.normal(size=count)
    return rows


def compete(rounds: int, count: int = 5000) -> tuple[Times, dict[str, str]]:
    """Seconds per process."""
    here = Path(__file__).parent
    with tempfile.TemporaryDirectory() as folder:
        log, plant, model = (Path(folder) / name for name in ("log.csv", "plant.toml", "m.fgm"))
        np.savetxt(log, wheel(count), delimiter=",", header="t,u,h", comments="", fmt="%.9g")
        plant.write_text(PLANT)
        code = "from faultgauge.cli import main; main()"
        fit = [sys.executable, "-c", code, "fit", plant, log, "--out", model]
        peer = [sys.executable, here / "scipy_fit.py", log]

        environment = {**os.environ, "XDG_CACHE_HOME": folder}  # the first round fills it

        def process(*command: object) -> int:
            subprocess.run(
                list(map(str, command)), check=True, capture_output=True, env=environment
            )
            return 1

        return interleaved(
            {
                "faultgauge": lambda: process(*fit),
                "SciPy, 1 start, analytic Jacobian": lambda: process(*peer, "analytic", 1),
                "SciPy, 1 start, 2-point": lambda: process(*peer, "2-point", 1),
                "SciPy, 10 starts, analytic Jacobian": lambda: process(*peer, "analytic", 10),
                "SciPy, 10 starts, 2-point": lambda: process(*peer, "2-point", 10),
            },
            rounds,
        )
