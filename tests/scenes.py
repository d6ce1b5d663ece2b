"""A small plant and logs of it in which a bank has once misled, with the bank that judges them.

The tank is exact under the hold, the bank is built from the noise that the logs have, and all logs
have one length, so that one compiled program judges them all.
"""

from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from functools import cache
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank.bank import FaultBank, build_fault_bank
from faultgauge.detection.bank.noise import Noise
from faultgauge.telemetry import Run
from faultgauge.telemetry.clock import Clock
from models import as_stated

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
NEVER = 1e9  # s: a fault that stays


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


def without(run: Run, column: str, *spans: tuple[float, float]) -> Run:
    """`run` with empty cells of `column` from each start [s] until before its stop [s]."""
    for start, stop in spans:
        run.columns[column][(start <= T) & (stop > T)] = np.nan
    return run


def _resting() -> Samples:
    """A command that is 0 for 60 s, where no gain shows, and stands on one value for 60 s."""
    u = np.where((T > 300) & (T < 360), 0.0, moving(27))
    return np.where((T > 420) & (T < 480), 1.0, u)


def _clocked() -> Run:
    run = log(1, leak=between(300, NEVER, -0.1))
    return replace(run, clock=Clock(datetime(2026, 5, 1, 8, 41)))


SCENES: dict[str, Callable[[], Run]] = {
    "healthy": lambda: log(2),
    "mostly beyond what the plant file trusts": lambda: log(
        10, u=np.where(T < 200, moving(10), 1.9)
    ),
    "a leak while the pump rests": lambda: log(
        11, u=np.where(T < 280, moving(11), 0.0), leak=between(400, NEVER, 0.1)
    ),
    "ten short leaks": lambda: log(13, leak=-0.1 * (T % 60 > 40)),
    "a leak that changes its sign": lambda: log(
        7, leak=between(150, 300, -0.1) + between(300, NEVER, 0.1)
    ),
    "a leak that grows": lambda: log(
        24, leak=between(150, NEVER, -0.1) + between(400, NEVER, -0.2)
    ),
    "a loss from before the log": lambda: log(25, weak=between(0, NEVER, 0.15)),
    "a bias through dropouts": lambda: without(
        log(
            9,
            gauge=between(150, NEVER, 0.1),
            u=np.where((T > 400) & (T < 450), 1.9, moving(9)),
        ),
        "x",
        (200, 203),
        (260, 275),
    ),
    "a loss through rest": lambda: log(27, weak=between(200, NEVER, 0.15), u=_resting()),
    "a leak that ends": lambda: log(31, leak=between(100, 140, -0.1)),
    "a sensor that falls silent": lambda: without(
        log(32, leak=between(250, NEVER, -0.1)), "x", (400, NEVER)
    ),
    "a log with a clock": _clocked,
    "a loss that grows slowly": lambda: log(28, weak=0.15 * np.clip((T - 200) / 100, 0, 1)),
}


@cache
def tank_bank(text: str = TANK) -> FaultBank:
    rng = np.random.default_rng(0)
    points = np.stack([rng.uniform(0, 12, 60), rng.uniform(0, 2, 60)], axis=1)
    model = as_stated(text, points)
    return build_fault_bank(model, [log(0)], NOISE)
