"""A drive and its load on two ends of a soft coupling that has play, measured on both.

    dq = w,   Jm dw = k (1 + r sin(14 q)) t - c - bm w - rub(w),   lag dt = u - t
    dp = v,   Jl dv = c - bl v - rub(v) - pull,   c = K (1 - worn) dead(q - p, play) + D (w - v)
    rub(w) = (Fc + (Fs - Fc) exp(-(w/ws)^2)) tanh(w/w0)

The coupling bears nothing within its play (and no damping there either); the drive's torque comes
late and ripples, both sides rub as Stribeck says, the load's encoder sits out of centre, what pulls
at the load wanders, and the constants differ from run to run. The file has a spring and a damper
without play, one Coulomb's friction on each side, and nothing else. A PID controller works on the
motor's position. What is not declared is a coupling that gets softer.
"""

from collections.abc import Sequence
from math import exp, sin, tanh

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, moves, scattered, white

__all__ = ["two_mass"]

FILE = """
name = "two-mass drive"
[states]
q = { unit = "rad", derivative = "w", exact = true }
w = { unit = "rad/s", derivative = "(u - K*(q - p) - D*(w - v) - bm*w - Fm*tanh(w/w0))/Jm" }
p = { unit = "rad", derivative = "v", exact = true }
v = { unit = "rad/s", derivative = "(K*(q - p) + D*(w - v) - bl*v - Fl*tanh(v/w0))/Jl" }
[inputs]
u = { unit = "N*m", min = -1, max = 1, hold = "zero" }
[outputs]
motor = { unit = "rad", value = "q" }
load = { unit = "rad", value = "p" }
[parameters]
Jm = { value = 5e-4, unit = "kg*m**2", min = 5e-5 }
Jl = { value = 1e-3, unit = "kg*m**2", min = 1e-4 }
K = { value = 2, unit = "N*m", min = 0.1 }
D = { value = 0.005, min = 0 }
bm = { value = 1e-3, min = 0 }
bl = { value = 1e-3, min = 0 }
Fm = { value = 0.03, unit = "N*m", min = 0 }
Fl = { value = 0.03, unit = "N*m", min = 0 }
w0 = { value = 0.1, unit = "rad/s", fixed = true }
[faults]
load_torque = { enters = "state", target = "v", unit = "rad/s**2" }
motor_loss = { enters = "gain", target = "u" }
load_encoder_bias = { enters = "output", target = "load", unit = "rad" }
"""
STEP, SAMPLES = 0.005, 4000  # s; 20 s
MOTOR, LOAD = 4e-4, 1.2e-3  # kg m^2
STIFFNESS, DAMPING, PLAY = 2.0, 4e-3, 0.006  # N m/rad, N m s/rad, rad to each side
VISCOUS = (1.5e-3, 1e-3)  # N m s: motor, load
COULOMB, STATIC = (0.04, 0.03), (0.055, 0.045)  # N m: motor, load
STRIBECK, TURNING = 0.4, 0.08  # rad/s; the second rounds off the sign of the speed
RIPPLE, TEETH, LAG = 0.02, 14, 0.002  # of the torque, per turn, s
SPREAD = 0.02  # of every constant, from run to run
PULL, PULL_TIME = 0.01, 0.3  # N m, s
CENTRE = 2e-3  # rad: what the load's encoder errs by once a turn
COUNTS = (8192, 4096)  # per turn: motor, load
NOISE = (1e-4, 3e-4)  # rad
LIMIT = 1.0  # N m
PROPORTIONAL, DERIVATIVE, INTEGRAL = 1.2, 0.05, 0.4  # N m/rad, N m s/rad, s
FILTER = 0.5  # of the speed's newest difference


def two_mass() -> Case:
    sizes = {
        "load_torque": Sizes(80, 160, 400),
        "motor_loss": Sizes(0.1, 0.2, 0.6, (1.0,)),
        "load_encoder_bias": Sizes(0.1, 0.2, 0.6),
        "soft_coupling": Sizes(0.3, 0.5, 0.7, (1.0,)),
    }
    return Case(
        "two_mass",
        FILE,
        truth,
        sizes,
        through={"soft_coupling": 1},
        told_as={"soft_coupling": ("unknown", 1.0)},
    )


def rubs(w: float, coulomb: float, static: float) -> float:
    return (coulomb + (static - coulomb) * exp(-((w / STRIBECK) ** 2))) * tanh(w / TURNING)


def coupled(twist: float, turning: float, stiffness: float, damping: float) -> float:
    """The coupling's torque [N m] at a twist [rad] and its rate [rad/s]."""
    taken = max(twist - PLAY, 0.0) + min(twist + PLAY, 0.0)
    return stiffness * taken + damping * turning if taken else 0.0


def truth(rng: np.random.Generator) -> Truth:
    motor, load, stiffness, damping, gain = scattered(
        rng, (MOTOR, LOAD, STIFFNESS, DAMPING, 1.0), SPREAD
    )
    (bm, bl), (fm, fl), (sm, sl) = (
        scattered(rng, each, SPREAD) for each in (VISCOUS, COULOMB, STATIC)
    )
    centre = float(rng.uniform(0.0, 2 * np.pi))

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States q [rad], w [rad/s], p [rad], v [rad/s], t [N m]; d: pull [N m], worn."""
        q, w, p, v, torque = x
        across = coupled(q - p, w - v, stiffness * (1 - d[1]), damping)
        driven = gain * (1 + RIPPLE * sin(TEETH * q)) * torque
        return (
            w,
            (driven - across - bm * w - rubs(w, fm, sm)) / motor,
            v,
            (across - bl * v - rubs(v, fl, sl) - d[0]) / load,
            (u[0] - torque) / LAG,
        )

    reference = moves(rng, SAMPLES, STEP, (-3.0, 3.0), (0.6, 2.0), rows=80, wave=0.3)
    speed, summed, turning = np.gradient(reference, STEP), 0.0, 0.0

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed, turning
        newest = (y[k][0] - y[k - 1][0]) / STEP if k else float(speed[0])
        turning += FILTER * (newest - turning)
        off = reference[k] - y[k][0]
        u = PROPORTIONAL * off + DERIVATIVE * (speed[k] - turning) + summed
        if abs(u) < LIMIT:
            summed += PROPORTIONAL * off * STEP / INTEGRAL
        return (float(np.clip(u, -LIMIT, LIMIT)),)

    first, rate = float(reference[0]), float(speed[0])
    pull = coloured(rng, SAMPLES, STEP, (PULL,), PULL_TIME)
    return Truth(
        rates=rates,
        states=("q", "w", "p", "v", "t"),
        start=(first, rate, first, rate, 0.0),
        sensors=(0, lambda x, d: x[2] + CENTRE * sin(x[2] + centre)),
        command=command,
        limits=((-LIMIT, LIMIT),),
        disturbances=np.hstack([pull, np.zeros((SAMPLES, 1))]),
        noise=white(rng, SAMPLES, NOISE),
        quantum=(2 * np.pi / COUNTS[0], 2 * np.pi / COUNTS[1]),
        step=STEP,
        substeps=20,
    )
