"""One axis of an agile satellite with a wheel: a panel that swings, a gyro that drifts, friction.

    J dw + s ddn = T + f(h) + sun,   ddn + 2 z W dn + W^2 n + s dw = 0,   dq = w
    dh = -T - f(h),   f(h) = viscous h + coulomb tanh(h/h0),   lag dT = u - T
    lag (1 + late) dg = w - g

n is the panel's mode, h the wheel's momentum, which its speed tells, and which begins elsewhere in
every run. The gyro g lags and drifts, the angle's noise is coloured, and constants differ from run
to run. The file has a double integrator, a viscous wheel and a constant torque per run: neither
panel, Coulomb's friction, lags nor drift. What is not declared is a gyro that gets `late` slower.
"""

from collections.abc import Sequence
from math import tanh

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, moves, scattered, white

__all__ = ["satellite"]

FILE = """
name = "satellite axis"
[states]
q = { unit = "rad", derivative = "w", exact = true }
w = { unit = "rad/s", derivative = "a*(u + drag*h) + c" }
h = { unit = "N*m*s", derivative = "-u - drag*h" }
[inputs]
u = { unit = "N*m", min = -0.1, max = 0.1, hold = "zero" }
[outputs]
angle = { unit = "rad", value = "q" }
rate = { unit = "rad/s", value = "w" }
wheel = { unit = "N*m*s", value = "h" }
[parameters]
a = { value = 1, min = 0.1 }
drag = { value = 0.003, min = 0 }
c = { value = 0, vary = "run" }
[faults]
torque = { enters = "state", target = "w", unit = "rad/s**2" }
wheel_loss = { enters = "gain", target = "u" }
gyro_bias = { enters = "output", target = "rate", unit = "rad/s" }
angle_bias = { enters = "output", target = "angle", unit = "rad" }
"""
STEP, SAMPLES = 0.01, 5000  # s; 50 s
INERTIA, COUPLING = 0.9, 0.25  # kg m^2, its root
MODE, DAMPING = 2 * np.pi * 2.3, 0.008  # rad/s
WHEEL, GYRO = 0.03, 0.015  # s: lags
VISCOUS, COULOMB, TURNING = 0.004, 0.0015, 0.01  # 1/s, N m, N m s
MOMENTUM = (0.2, 0.35)  # N m s
SUN, SUN_TIME = 3e-4, 15.0  # N m, s
DRIFT, DRIFT_TIME = 3e-4, 20.0  # rad/s, s
WANDER, WANDER_TIME = 1e-4, 0.3  # rad, s: of the angle's error
NOISE, QUANTUM = (1e-4, 3e-4, 3e-4), (2e-5, 5e-5, 2e-4)  # rad, rad/s, N m s
SPREAD = 0.02  # of every constant, from run to run
ANGLES = (-0.15, 0.15)  # rad
STIFF, DAMPED = 4.0, 3.2  # 1/s^2, 1/s: 2 rad/s, 0.8
LIMIT = 0.1  # N m


def satellite() -> Case:
    sizes = {
        "torque": Sizes(0.01, 0.02, 0.05),
        "wheel_loss": Sizes(0.1, 0.2, 0.4, (1.0,)),
        "gyro_bias": Sizes(0.01, 0.02, 0.05),
        "angle_bias": Sizes(0.02, 0.04, 0.1),
        "slow_gyro": Sizes(6, 12, 16, (1.0,)),
    }
    return Case(
        "satellite",
        FILE,
        truth,
        sizes,
        through={"slow_gyro": 2},
        told_as={"slow_gyro": ("unknown", 1.0)},
    )


def truth(rng: np.random.Generator) -> Truth:
    inertia, coupling, mode, viscous, coulomb = scattered(
        rng, (INERTIA, COUPLING, MODE, VISCOUS, COULOMB), SPREAD
    )

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States q, w, n, dn, T [N m], h [N m s], g [rad/s]; d: sun [N m], drift [rad/s], late."""
        _, w, n, swings, torque, h, gyro = x
        rubs = viscous * h + coulomb * tanh(h / TURNING)
        spring = 2 * DAMPING * mode * swings + mode**2 * n
        turns = (torque + rubs + d[0] + coupling * spring) / (inertia - coupling**2)
        return (
            w,
            turns,
            swings,
            -spring - coupling * turns,
            (u[0] - torque) / WHEEL,
            -torque - rubs,
            (w - gyro) / (GYRO * (1 + d[2])),
        )

    wanted = moves(rng, SAMPLES, STEP, ANGLES, (3.0, 8.0), rows=400, wave=0.01)
    turning = np.gradient(wanted, STEP)

    def command(k: int, y: Sequence[Vector]) -> Vector:
        angle, rate, _ = y[k]
        u = INERTIA * (STIFF * (wanted[k] - angle) + DAMPED * (turning[k] - rate))
        return (float(np.clip(u, -LIMIT, LIMIT)),)

    sun = coloured(rng, SAMPLES, STEP, (SUN,), SUN_TIME)
    drift = coloured(rng, SAMPLES, STEP, (DRIFT,), DRIFT_TIME)
    wander = coloured(rng, SAMPLES, STEP, (WANDER,), WANDER_TIME)
    first, rate = float(wanted[0]), float(turning[0])
    momentum = float(rng.uniform(*MOMENTUM))
    return Truth(
        rates=rates,
        states=("q", "w", "n", "swings", "torque", "h", "gyro"),
        start=(first, rate, 0.0, 0.0, 0.0, momentum, rate),
        sensors=(0, lambda x, d: x[6] + d[1], 5),
        command=command,
        limits=((-LIMIT, LIMIT),),
        disturbances=np.hstack([sun, drift, np.zeros((SAMPLES, 1))]),
        noise=white(rng, SAMPLES, NOISE) + np.hstack([wander, np.zeros((SAMPLES, 2))]),
        quantum=QUANTUM,
        step=STEP,
        substeps=5,
    )
