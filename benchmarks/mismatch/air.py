"""Compressed air: a compressor, its receiver, a control valve, a header and who draws from it.

    dm1 = comp - valve,   m1 cv dT1 = comp cp (Tc - T1) + (cp - cv) T1 dm1 - H (T1 - Ta)  (2: alike)
    comp = c u1 (1 - leaks p1) Ta0/Ta,   valve and draw: ISO 6358's nozzle, with its choking

p = m R T/V. Filling warms, emptying cools, and walls pull back to a room that wanders. The valve's
opening lags and its curve is bent; the draw strays from the one that is logged; constants differ
from run to run. The file has two isothermal pressures, a compressor whose delivery falls with
pressure, a root and a power for the valve and a choked draw. What is not declared is a valve that
loses the share `worn` of its area. Pressures are absolute.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, scattered, white

__all__ = ["air"]

FILE = """
name = "compressed air"
[states.p1]
unit = "bar"
derivative = "fill*speed*(1 - slip*p1) - k1*max(valve, 1)**n*sqrt(max(p2*(p1 - p2), 0))"
[states.p2]
unit = "bar"
derivative = "k2*max(valve, 1)**n*sqrt(max(p2*(p1 - p2), 0)) - use*draw*p2"
[inputs]
speed = { unit = "%", min = 0, max = 100, hold = "zero" }
valve = { unit = "%", min = 0, max = 100, hold = "zero" }
draw = { unit = "%", min = 0, max = 100, hold = "zero" }
[outputs]
receiver = { unit = "bar", value = "p1" }
header = { unit = "bar", value = "p2" }
[parameters]
fill = { value = 1e-3, min = 0 }
slip = { value = 0.03, min = 0, max = 0.1 }
k1 = { value = 2e-4, min = 0 }
k2 = { value = 5e-4, min = 0 }
n = { value = 1, min = 0.3, max = 3 }
use = { value = 2e-4, min = 0 }
[faults]
compressor_loss = { enters = "gain", target = "speed" }
header_leak = { enters = "state", target = "p2", unit = "bar/s", max = 0 }
receiver_bias = { enters = "output", target = "receiver", unit = "bar" }
header_bias = { enters = "output", target = "header", unit = "bar" }
"""
STEP, SAMPLES = 1.0, 4000  # s
R, CV = 287.0, 718.0  # J/(kg K)
CP = R + CV
RECEIVER, HEADER = 1.0, 0.4  # m^3
DELIVERY, SLIP, HOT = 0.085, 0.035, 25.0  # kg/s, 1/bar, K over the room
VALVE, DRAW, CRITICAL = 0.022, 0.0135, 0.4  # kg/(s bar) when open, pressure ratio
CURVE, LAG = 1.3, 2.5  # 1, s: of the valve
WALLS = (60.0, 30.0)  # W/K
ROOM, WANDER, WANDER_TIME = (285.0, 303.0), 1.0, 900.0  # K, K, s
STRAY, STRAY_TIME = 0.02, 60.0  # of the draw, s
HUM, HUM_TIME = 0.004, 5.0  # bar, s
NOISE, QUANTUM = (0.008, 0.008), (0.01, 0.005)  # bar
SPREAD = 0.02  # of every constant, from run to run
TARGETS, HOLD = ((7.5, 9.0), (4.5, 6.5)), (200.0, 700.0)  # bar, s
DRAWS, BUSY = (20.0, 75.0), (60.0, 300.0)  # %, s
GAINS, INTEGRAL = (40.0, 25.0), (60.0, 25.0)  # %/bar, s
OUTSIDE = 1.013  # bar


def air() -> Case:
    sizes = {
        "compressor_loss": Sizes(0.1, 0.2, 0.4, (1.0,)),
        "header_leak": Sizes(0.008, 0.016, 0.04, (-1.0,)),
        "receiver_bias": Sizes(0.3, 0.6, 1.5),
        "header_bias": Sizes(0.3, 0.6, 1.5),
        "worn_valve": Sizes(0.2, 0.35, 0.5, (1.0,)),
    }
    return Case(
        "air",
        FILE,
        truth,
        sizes,
        through={"worn_valve": 2},
        told_as={"worn_valve": ("unknown", 1.0)},
    )


def nozzle(conductance: float, high: float, low: float, warm: float) -> float:
    """Flow [kg/s] from pressure `high` to `low` [bar], ISO 6358; none backwards."""
    ratio = low / high
    if ratio >= 1.0:
        return 0.0
    choked = conductance * high * sqrt(293.15 / warm)
    if ratio <= CRITICAL:
        return choked
    return choked * sqrt(1 - ((ratio - CRITICAL) / (1 - CRITICAL)) ** 2)


def truth(rng: np.random.Generator) -> Truth:
    delivery, slip, through, drawn, curve = scattered(
        rng, (DELIVERY, SLIP, VALVE, DRAW, CURVE), SPREAD
    )

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States p1, T1, p2, T2 [bar, K], opening; d: room [K], stray, worn."""
        p1, t1, p2, t2, opening = x
        made = delivery * u[0] / 100 * (1 - slip * p1) * 293.15 / d[0]
        passed = nozzle(through * (1 - d[2]) * max(opening, 0.0) ** curve, p1, p2, t1)
        used = nozzle(drawn * u[2] / 100 * (1 + d[1]), p2, OUTSIDE, t2)
        found = list[float]()
        for p, t, volume, walls, into, warm, out in (
            (p1, t1, RECEIVER, WALLS[0], made, d[0] + HOT, passed),
            (p2, t2, HEADER, WALLS[1], passed, t1, used),
        ):
            mass = p * 1e5 * volume / (R * t)
            heated = into * CP * warm - out * CP * t - walls * (t - d[0])
            warms = (heated - (into - out) * CV * t) / (mass * CV)
            found += [p * ((into - out) / mass + warms / t), warms]
        return (*found, (u[1] / 100 - opening) / LAG)

    targets = [np.array(levels(rng, SAMPLES, STEP, each, HOLD)) for each in TARGETS]
    draws = np.array(levels(rng, SAMPLES, STEP, DRAWS, BUSY))
    summed = [45.0, 40.0]  # %

    def command(k: int, y: Sequence[Vector]) -> Vector:
        found = list[float]()
        for each in (0, 1):
            off = GAINS[each] * (targets[each][k] - y[k][each])
            u = off + summed[each]
            if 0.0 < u < 100.0:
                summed[each] += off * STEP / INTEGRAL[each]
            found.append(float(np.clip(u, 0.0, 100.0)))
        return (*found, float(draws[k]))

    room = rng.uniform(*ROOM) + coloured(rng, SAMPLES, STEP, (WANDER,), WANDER_TIME)
    stray = coloured(rng, SAMPLES, STEP, (STRAY,), STRAY_TIME)
    warm = float(room[0, 0])
    return Truth(
        rates=rates,
        states=("p1", "T1", "p2", "T2", "opening"),
        start=(float(targets[0][0]), warm + 5.0, float(targets[1][0]), warm, 0.4),
        sensors=(0, 2),
        command=command,
        limits=((0.0, 100.0),) * 3,
        disturbances=np.hstack([room, stray, np.zeros((SAMPLES, 1))]),
        noise=white(rng, SAMPLES, NOISE) + coloured(rng, SAMPLES, STEP, (HUM, HUM), HUM_TIME),
        quantum=QUANTUM,
        step=STEP,
        substeps=4,
    )
