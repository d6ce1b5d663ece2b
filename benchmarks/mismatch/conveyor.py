"""A belt conveyor with slip: a drum drives the belt over creep, and the load on it comes and goes.

    J dw = T - b w - Fc tanh(w/w0) - r P,   lag dT = kt u (1 - fade w^2) - T
    M(load) dv = P - rolling(load) tanh(v/v0) - drag v^2 - pull sin(2 pi x/length),   dx = v
    P = grip N (2/pi) atan(creep (r w - v)),   lag dwf = w - wf,   lag (1 + late) dvf = v - vf

The grip P saturates: what the drum turns faster than the belt is creep, and slip where torque is
large. The load is weighed in front and lies on the belt by its length, so that it strays from the
log, as the grip does with dust; a splice pulls once a turn. The file has two masses over a viscous
slip, a load that is the weighed one, and Coulomb's rolling: no lags, no grip that ends, no splice,
no drag. What is not declared is a belt's wheel whose filter gets `late` times slower.
"""

from collections.abc import Sequence
from math import atan, pi, sin, tanh

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, moves, scattered, white

__all__ = ["conveyor"]

FILE = """
name = "belt conveyor"
[states]
w = { unit = "rad/s", derivative = "(a*u - Fc*tanh(w/w0) - b*w - r*g*(r*w - v))/J" }
v = { unit = "m/s", derivative = "(g*(r*w - v) - (F0 + roll*load)*tanh(v/v0))/(M + load)" }
[inputs]
u = { unit = "%", min = -100, max = 100, hold = "zero" }
load = { unit = "kg", min = 0, max = 2000, hold = "zero" }
[outputs]
drum = { unit = "rad/s", value = "w" }
belt = { unit = "m/s", value = "v" }
[parameters]
a = { value = 10, min = 1 }
b = { value = 1, min = 0 }
Fc = { value = 20, unit = "N*m", min = 0 }
g = { value = 5000, min = 500 }
J = { value = 12, fixed = true }
M = { value = 600, unit = "kg", fixed = true }
F0 = { value = 200, unit = "N", min = 0 }
roll = { value = 0.3, min = 0 }
r = { value = 0.25, unit = "m", fixed = true }
w0 = { value = 0.3, unit = "rad/s", fixed = true }
v0 = { value = 0.05, unit = "m/s", fixed = true }
[faults]
jam = { enters = "state", target = "v", unit = "m/s**2", max = 0 }
drive_loss = { enters = "gain", target = "u" }
drum_scale = { enters = "output_gain", target = "drum" }
belt_bias = { enters = "output", target = "belt", unit = "m/s" }
"""
STEP, SAMPLES = 0.05, 6000  # s; 5 min
TORQUE, FADE, CONVERTER = 9.0, 3e-4, 0.08  # N m/%, s^2, s
INERTIA, VISCOUS, COULOMB, RADIUS = 12.0, 1.5, 25.0, 0.25  # kg m^2, N m s, N m, m
TURNING, STARTS = 0.3, 0.05  # rad/s, m/s: they round off signs
BELT, EMPTY, ROLLING, DRAG = 600.0, 250.0, 0.35, 25.0  # kg, N, N/kg, N s^2/m^2
GRIP, CREEP = 4200.0, 3.0  # N, s/m
SPLICE, LENGTH = 60.0, 40.0  # N, m
FILTER = (0.04, 0.06)  # s: drum, belt
LOADS, LOADED, SPREADS = (50.0, 800.0), (10.0, 40.0), 4.0  # kg, s, s
STRAY, STRAY_TIME = 25.0, 10.0  # kg, s
DUST, DUST_TIME = 0.05, 30.0  # of the grip, s
SPREAD = 0.02  # of every constant, from run to run
NOISE, QUANTUM = (0.02, 0.006), (0.01, 0.005)  # rad/s, m/s
SPEEDS = (0.8, 2.8)  # m/s
PROPORTIONAL, INTEGRAL = 12.0, 2.0  # % s/rad, s


def conveyor() -> Case:
    sizes = {
        "jam": Sizes(0.08, 0.16, 0.4, (-1.0,)),
        "drive_loss": Sizes(0.1, 0.2, 0.4, (1.0,)),
        "drum_scale": Sizes(0.1, 0.2, 0.3, (1.0,)),
        "belt_bias": Sizes(0.2, 0.4, 0.8),
        "slow_belt": Sizes(8, 16, 25, (1.0,)),
    }
    return Case(
        "conveyor",
        FILE,
        truth,
        sizes,
        through={"slow_belt": 2},
        told_as={"slow_belt": ("unknown", 1.0)},
    )


def truth(rng: np.random.Generator) -> Truth:
    torque, inertia, viscous, coulomb, belt, empty, rolling, grip = scattered(
        rng, (TORQUE, INERTIA, VISCOUS, COULOMB, BELT, EMPTY, ROLLING, GRIP), SPREAD
    )

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """w, v, x [m], T [N m], load [kg], seen w and v; d: stray [kg], dust, late."""
        w, v, place, drives, load, seen_w, seen_v = x
        carried = max(load + d[0], 0.0)
        pulls = grip * (1 + d[1]) * (1 + carried / 4000) * 2 / pi
        pulls *= atan(CREEP * (RADIUS * w - v))
        rolls = (empty + rolling * carried) * tanh(v / STARTS) + DRAG * v * abs(v)
        rolls += SPLICE * sin(2 * pi * place / LENGTH)
        rubs = coulomb * tanh(w / TURNING) + viscous * w
        return (
            (drives - rubs - RADIUS * pulls) / inertia,
            (pulls - rolls) / (belt + carried),
            v,
            (torque * u[0] * (1 - FADE * w * w) - drives) / CONVERTER,
            (u[1] - load) / SPREADS,
            (w - seen_w) / FILTER[0],
            (v - seen_v) / (FILTER[1] * (1 + d[2])),
        )

    wanted = moves(rng, SAMPLES, STEP, SPEEDS, (6.0, 20.0), rows=60, wave=0.1) / RADIUS
    loads = np.array(levels(rng, SAMPLES, STEP, LOADS, LOADED))
    summed = 25.0  # %

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed
        off = PROPORTIONAL * (wanted[k] - y[k][0])
        u = off + summed
        if abs(u) < 100.0:
            summed += off * STEP / INTEGRAL
        return (float(np.clip(u, -100.0, 100.0)), float(loads[k]))

    stray = coloured(rng, SAMPLES, STEP, (STRAY,), STRAY_TIME)
    dust = coloured(rng, SAMPLES, STEP, (DUST,), DUST_TIME)
    first, placed = float(wanted[0]), float(rng.uniform(0.0, LENGTH))
    speed = RADIUS * first
    return Truth(
        rates=rates,
        states=("w", "v", "place", "torque", "load", "seen_w", "seen_v"),
        start=(first, speed, placed, 9.0 * summed, float(loads[0]), first, speed),
        sensors=(5, 6),
        command=command,
        limits=((-100.0, 100.0), (0.0, 2000.0)),
        disturbances=np.hstack([stray, dust, np.zeros((SAMPLES, 1))]),
        noise=white(rng, SAMPLES, NOISE),
        quantum=QUANTUM,
        step=STEP,
        substeps=8,
    )
