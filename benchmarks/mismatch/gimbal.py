"""A gimbal's axis in a position loop over a rate loop, whose bearing sticks (LuGre's model).

    dq = w,   J dw = Kt i - F - b w - cable(q) - teeth(q) + side,   di = (u - i) / lag,
    F = s0 z + s1 exp(-(w/w1)^2) dz,   dz = w - s0 |w| z / g(w),
    g = Fc + (Fs - Fc) exp(-(w/ws)^2)

Canudas de Wit et al., IEEE TAC 40 (1995): at rest the bearing is a spring of bristles, and breaks
loose from more than it slides by. The file has Coulomb's friction as a tanh, viscous friction, and
a torque constant from a data sheet that is 3 % off; no cable, no teeth, no lag of the current.
"""

from collections.abc import Sequence
from math import exp, pi, sin

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, moves, scattered, white

__all__ = ["gimbal"]

FILE = """
name = "gimbal"
[states]
q = { unit = "rad", derivative = "w", exact = true }
w = { unit = "rad/s", derivative = "(Kt*current - b*w - Fc*tanh(w/ws))/J" }
[inputs]
current = { unit = "A", min = -3, max = 3, hold = "zero" }
[outputs]
angle = { unit = "rad", value = "q" }
gyro = { unit = "rad/s", value = "w" }
[parameters]
Kt = { value = 0.085, unit = "N*m/A", fixed = true }
J = { value = 0.01, unit = "kg*m**2", min = 0.002, max = 0.05 }
b = { value = 0.01, unit = "N*m*s/rad", min = 0, max = 0.2 }
Fc = { value = 0.02, unit = "N*m", min = 0, max = 0.15 }
ws = { value = 0.03, unit = "rad/s", min = 0.003, max = 0.3 }
[faults]
motor_gain = { enters = "gain", target = "current", min = -0.3, max = 0.7 }
side_torque = { enters = "state", target = "w", unit = "rad/s**2", min = -8, max = 8 }
gyro_bias = { enters = "output", target = "gyro", unit = "rad/s", min = -0.2, max = 0.2 }
bearing_friction = { enters = "parameter", target = "Fc", relative = true, min = -0.6, max = 3 }
"""
STEP, SAMPLES = 0.01, 3000
INERTIA, TORQUE, VISCOUS = 0.0131, 0.0825, 0.014  # kg m^2, N m/A, N m s/rad
COULOMB, STATIC, STRIBECK = 0.030, 0.041, 0.06  # N m, N m, rad/s
SPRING, DAMPER, SLIDES = 15.0, 0.08, 0.1  # N m/rad, N m s/rad, rad/s
LAG = 0.003  # s
CABLE, TEETH, COUNT = 0.006, 0.0008, 14  # N m/rad, N m, per turn
AIR, AIR_TIME = 0.0012, 0.5  # N m, s
SPREAD = 0.02  # of friction, from run to run
NOISE, QUANTUM = (0.0, 0.0025), (2 * pi / 16384, 2e-4)  # rad, rad/s
POSITION, RATE, INTEGRAL = 9.0, 5.5, 6.0  # 1/s, A s/rad, 1/s


def gimbal() -> Case:
    sizes = {
        "motor_gain": Sizes(0.1, 0.2, 0.6, (1.0,)),
        "side_torque": Sizes(1.0, 2.0, 6.0),
        "gyro_bias": Sizes(0.01, 0.03, 0.15),
        "bearing_friction": Sizes(0.4, 0.8, 2.0, (1.0,)),
    }
    return Case("gimbal", FILE, truth, sizes, through={"bearing_friction": 1})


def truth(rng: np.random.Generator) -> Truth:
    coulomb, static, viscous = scattered(rng, (COULOMB, STATIC, VISCOUS), SPREAD)

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States q, w, the bristles z [rad] and the current [A]; d: air [N m], more friction."""
        q, w, z, i = x
        slides = (coulomb + (static - coulomb) * exp(-((w / STRIBECK) ** 2))) * (1 + d[1])
        dz = w - SPRING * abs(w) * z / slides
        rubs = SPRING * z + DAMPER * dz * exp(-((w / SLIDES) ** 2)) + viscous * w
        held = CABLE * (q - 0.15) + 0.5 * CABLE * sin(3 * q + 0.4) + TEETH * sin(COUNT * q)
        return w, (TORQUE * i - rubs - held + d[0]) / INERTIA, dz, (u[0] - i) / LAG

    reference = moves(rng, SAMPLES, STEP, (-1.0, 1.0), (0.6, 2.0), rows=80, wave=0.15)  # rad
    speed, summed = np.gradient(reference, STEP), 0.0

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed
        off = speed[k] + POSITION * (reference[k] - y[k][0]) - y[k][1]
        u = RATE * off + summed
        if abs(u) < 3.0:
            summed += RATE * INTEGRAL * STEP * off
        return (float(np.clip(u, -3.0, 3.0)),)

    air = coloured(rng, SAMPLES, STEP, (AIR,), AIR_TIME)
    return Truth(
        rates=rates,
        states=("q", "w", "z", "i"),
        start=(float(reference[0]), 0.0, 0.0, 0.0),
        sensors=(0, 1),
        command=command,
        limits=((-3.0, 3.0),),
        disturbances=np.hstack([air, np.zeros((SAMPLES, 1))]),
        noise=white(rng, SAMPLES, NOISE),
        quantum=QUANTUM,
        step=STEP,
        substeps=10,
    )
