"""A reaction wheel that keeps a momentum for half an hour, in oil that the orbit warms.

    J dw = g (1 - m (T - T0)) (1 + ripple) t - b exp((T0 - T)/Tv) w - Fc tanh(w/w0) - cage
    lag dt = u - t,   C dT = friction w - (T - Tb)/Rb

The oil gets thinner as the bearing (T) warms; the mount Tb follows the orbit. The cage makes the
drag wander and the electronics' lag (t) their torque late. Friction differs by 5 % from run to run,
the rest by 1 %. A tachometer counts pulses. The file has a wheel with viscous and Coulomb's
friction that are the same always, and no electronics. A momentum loop slews the wheel, which
turns one way only, so that a friction is a torque of one sign.
"""

from collections.abc import Sequence
from math import exp, tanh

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, moves, scattered, white

__all__ = ["reaction_wheel"]

FILE = """
name = "momentum wheel"
[states]
w = { unit = "rad/s", derivative = "(gain*u - b*w - Fc*tanh(w/w0))/J" }
[inputs]
u = { unit = "N*m", min = -0.05, max = 0.05, hold = "zero" }
[outputs]
tachometer = { unit = "rad/s", value = "w" }
[parameters]
J = { value = 1.9e-3, unit = "kg*m**2", fixed = true }
gain = { value = 1, min = 0.2 }
b = { value = 5e-6, unit = "N*m*s", min = 0 }
Fc = { value = 1e-3, unit = "N*m", min = 0 }
w0 = { value = 2, unit = "rad/s", fixed = true }
[faults]
friction = { enters = "state", target = "w", unit = "rad/s**2", max = 0 }
motor_loss = { enters = "gain", target = "u" }
tachometer_bias = { enters = "output", target = "tachometer", unit = "rad/s" }
"""
STEP, SAMPLES = 0.25, 7200  # s; 30 min
INERTIA, GAIN, SPREAD = 1.9e-3, 0.97, 0.01  # kg m^2, 1; of both, from run to run
VISCOUS, COULOMB, FRICTION_SPREAD = 6e-6, 1.5e-3, 0.05  # N m s, N m; of both
TURNING = 2.0  # rad/s
OIL, MAGNET, NOMINAL = 30.0, 0.001, 20.0  # K, 1/K, degC
HEAT, PATH = 250.0, 8.0  # J/K, K/W
MOUNT, ORBIT, SWING = (16.0, 24.0), 5700.0, 4.0  # degC, s, K
LAG = 0.12  # s
RIPPLE, RIPPLE_TIME = 0.004, 20.0  # of the torque, s
CAGE, CAGE_TIME = 6e-5, 40.0  # N m, s
NOISE, PULSES = 0.15, 48  # rad/s, per turn
QUANTUM = 2 * np.pi / PULSES / STEP
SPEEDS, PUSHED, PERIOD = (100.0, 420.0), 12.0, (250.0, 500.0)  # rad/s, rad/s, s
PROPORTIONAL, INTEGRAL = 0.4, 10.0  # 1/s, s
LIMIT = 0.05  # N m


def reaction_wheel() -> Case:
    sizes = {
        "friction": Sizes(1.0, 2.0, 6.0, (-1.0,)),
        "motor_loss": Sizes(0.1, 0.2, 0.6, (1.0,)),
        "tachometer_bias": Sizes(30, 60, 60),
    }
    return Case("reaction_wheel", FILE, truth, sizes)


def truth(rng: np.random.Generator) -> Truth:
    inertia, gain = scattered(rng, (INERTIA, GAIN), SPREAD)
    viscous, coulomb = scattered(rng, (VISCOUS, COULOMB), FRICTION_SPREAD)

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States w [rad/s], t [N m], T [degC]; d: ripple, cage [N m], mount [degC]."""
        w, torque, bearing = x
        drag = viscous * exp((NOMINAL - bearing) / OIL) * w + coulomb * tanh(w / TURNING) + d[1]
        driven = gain * (1 - MAGNET * (bearing - NOMINAL)) * (1 + d[0]) * torque
        return (
            (driven - drag) / inertia,
            (u[0] - torque) / LAG,
            (drag * w - (bearing - d[2]) / PATH) / HEAT,
        )

    reference = moves(rng, SAMPLES, STEP, SPEEDS, (60.0, 240.0), rows=160, wave=0.2)
    t = STEP * np.arange(SAMPLES)
    slow = rng.uniform(*PERIOD)
    reference += PUSHED * np.sin(2 * np.pi * t / slow)
    turning = np.gradient(reference, STEP)
    summed = 0.0

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed
        off = PROPORTIONAL * (reference[k] - y[k][0])
        u = INERTIA * (turning[k] + off + summed)
        if abs(u) < LIMIT:
            summed += off * STEP / INTEGRAL
        return (float(np.clip(u, -LIMIT, LIMIT)),)

    phase, middle = rng.uniform(0.0, 2 * np.pi), rng.uniform(*MOUNT)
    mount = middle + SWING * np.sin(2 * np.pi * t / ORBIT + phase)
    ripple = coloured(rng, SAMPLES, STEP, (RIPPLE,), RIPPLE_TIME)
    cage = coloured(rng, SAMPLES, STEP, (CAGE,), CAGE_TIME)
    return Truth(
        rates=rates,
        states=("w", "t", "T"),
        start=(float(reference[0]), 0.0, float(mount[0] + rng.uniform(0.0, 6.0))),
        sensors=(0,),
        command=command,
        limits=((-LIMIT, LIMIT),),
        disturbances=np.column_stack([ripple, cage, mount]),
        noise=white(rng, SAMPLES, (NOISE,)),
        quantum=(QUANTUM,),
        step=STEP,
        substeps=2,
    )
