"""A ball on a beam that a geared motor tilts: an integrator twice over, at rest only in its loop.

    dx = v,   dv = c (g sin(a + tilt + slope(x)) + x w^2) - s r,   dr = v - s |v| r / (roll dirt)
    da = w,   (Jb + M x^2) dw = T - M g x cos a - 2 M x v w - trim - top sin a
    dm = n,   Jm dn = k V - b n - S z - T,   dz = n - S |n| z / g(n)
    T = stiff deadzone(m - a, play) + damp (n - w) in contact,   g = Fc + (Fs - Fc) exp(-(n/ns)^2)
    lag dV = u (1 + supply) (1 - droop |u|) - V,   filter dseen = x - seen

After Hauser, Sastry and Kokotovic, IEEE TAC 37 (1992), in the size of laboratory rigs: gear 70:1,
2.6 ohm, a steel ball of 64 g that is the wiper of a resistive track of 43 cm. Bristles: Canudas de
Wit et al., IEEE TAC 40 (1995), and Dahl. All at the beam's shaft. The file has one stiff inertia,
friction and rolling resistance as a tanh, a tilt, a trim, and M off by 1 %. It lacks play,
stiction, bristles, the amplifier's lag and droop, a supply that wanders, the beam's sag and waves
(slope), the terms in w^2, v w and M x^2, a centre of gravity above the pivot, the track's filter,
curve and coloured noise, draughts, and tilt, trim, friction and k that differ by run.
"""

from collections.abc import Sequence
from math import cos, exp, pi, sin

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, moves, scattered, white

__all__ = ["ball_beam"]

FILE = """
name = "ball and beam"
[states]
x = { unit = "m", derivative = "v", exact = true }
v = { unit = "m/s", derivative = "G*sin(angle + tilt) - roll*tanh(v/vs)" }
angle = { unit = "rad", derivative = "w", exact = true }
w = { unit = "rad/s", derivative = "(k*u - b*w - Fc*tanh(w/ws) - W*x*cos(angle) - trim)/J" }
[inputs]
u = { unit = "V", min = -6, max = 6, hold = "zero" }
[outputs]
track = { unit = "m", value = "x" }
encoder = { unit = "rad", value = "angle" }
[parameters]
G = { value = 7.0, unit = "m/s**2", min = 4.5, max = 8.5 }
roll = { value = 0.03, unit = "m/s**2", min = 0, max = 0.3 }
vs = { value = 0.01, unit = "m/s", fixed = true }
tilt = { value = 0, unit = "rad", min = -0.03, max = 0.03 }
k = { value = 0.14, unit = "N*m/V", min = 0.05, max = 0.3 }
b = { value = 0.07, unit = "N*m*s/rad", min = 0, max = 0.3 }
Fc = { value = 0.02, unit = "N*m", min = 0, max = 0.15 }
ws = { value = 0.05, unit = "rad/s", min = 0.01, max = 0.5 }
W = { value = 0.628, unit = "N", fixed = true }
trim = { value = 0, unit = "N*m", min = -0.1, max = 0.1 }
J = { value = 0.01, unit = "kg*m**2", min = 0.003, max = 0.03 }
[faults]
motor_gain = { enters = "gain", target = "u", min = -0.3, max = 0.7 }
amplifier_offset = { enters = "input", target = "u", unit = "V", min = -3, max = 3 }
track_bias = { enters = "output", target = "track", unit = "m", min = -0.1, max = 0.1 }
track_gain = { enters = "output_gain", target = "track", min = -0.4, max = 0.4 }
encoder_slip = { enters = "output", target = "encoder", unit = "rad", min = -0.15, max = 0.15 }
dirty_track = { enters = "parameter", target = "roll", relative = true, min = -0.8, max = 8 }
"""
STEP, SAMPLES, SLOW, QUICK = 0.01, 4000, 0.06, 0.02  # s; s: filters of the loops' speeds
GRAVITY, ROLLS, BALL = 9.81, 0.652, 0.0634  # m/s^2, c on two rails, kg
ROLL, CREEP = 0.037, 45.0  # m/s^2, 1/s^2
SAG, WAVE, PITCH = 0.006, 0.0005, 0.07  # rad/m, rad, m
TILT, TRIM, TOP = (0.004, 0.0008), (0.010, 0.003), 0.04  # rad, N m, N m/rad
BEAM, MOTOR, TORQUE, VISCOUS = 0.0058, 0.0024, 0.121, 0.081  # kg m^2 (two), N m/V, N m s/rad
COULOMB, STATIC, STRIBECK, BRISTLE = 0.024, 0.030, 0.08, 12.0  # N m, N m, rad/s, N m/rad
STIFF, DAMP, PLAY = 60.0, 0.05, 0.001  # N m/rad, N m s/rad, rad
LAG, DROOP, FILTER = 0.003, 0.008, 0.012  # s, 1/V, s
SUPPLY, SUPPLY_TIME, AIR, AIR_TIME = 0.008, 5.0, 0.006, 0.6  # share, s, m/s^2, s
CURVE, BEND, SPREAD = 0.001, 0.17, 0.02  # m, m: the track is not linear; share, from run to run
NOISE, CONTACT, CONTACT_TIME = (0.0003, 0.0), 0.0004, 0.06  # m and rad, m, s
QUANTUM = (2e-4, 2 * pi / 8192)  # m, rad
PLACE, SPEED, INTEGRAL, TILTS = 0.78, 0.55, 0.15, 0.22  # rad/m, rad s/m, rad/(m s), rad
ANGLE, RATE, RESET, LIFT = 24.0, 0.9, 40.0, 4.8  # V/rad, V s/rad, V/(rad s), V/m


def ball_beam() -> Case:
    sizes = {
        "motor_gain": Sizes(0.12, 0.25, 0.5, (1.0,)),
        "amplifier_offset": Sizes(0.3, 0.6, 2.0),
        "track_bias": Sizes(0.02, 0.04, 0.06),
        "track_gain": Sizes(0.1, 0.2, 0.3),
        "encoder_slip": Sizes(0.02, 0.04, 0.05),
        "dirty_track": Sizes(1.0, 2.0, 5.0, (1.0,)),
    }
    return Case("ball_beam", FILE, truth, sizes, through={"dirty_track": 2})


def truth(rng: np.random.Generator) -> Truth:
    constants = (COULOMB, STATIC, ROLL, TORQUE)
    coulomb, static, roll, torque = scattered(rng, constants, SPREAD)
    tilt, trim = rng.normal(*TILT), rng.normal(*TRIM)

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """d: air [m/s^2], change of the supply and of rolling resistance as shares."""
        place, v, a, w, m, n, z, r, seen, volts = x
        slope = tilt + SAG * place + WAVE * sin(2 * pi * place / PITCH)
        pulls = ROLLS * (GRAVITY * sin(a + slope) + place * w**2) - CREEP * r + d[0]
        twist = m - a - min(max(m - a, -PLAY), PLAY)
        teeth = STIFF * twist + (DAMP * (n - w) if twist else 0.0)
        load = BALL * place * (GRAVITY * cos(a) + 2 * v * w) + trim - TOP * sin(a)
        slides = coulomb + (static - coulomb) * exp(-((n / STRIBECK) ** 2))
        return (
            v,
            pulls,
            w,
            (teeth - load) / (BEAM + BALL * place**2),
            n,
            (torque * volts - VISCOUS * n - BRISTLE * z - teeth) / MOTOR,
            n - BRISTLE * abs(n) * z / slides,
            v - CREEP * abs(v) * r / (roll * (1 + d[2])),
            (place - seen) / FILTER,
            (u[0] * (1 + d[1]) * (1 - DROOP * abs(u[0])) - volts) / LAG,
        )

    wanted = moves(rng, SAMPLES, STEP, (-0.12, 0.12), (1.2, 3.5), rows=40, wave=0.015)  # m
    start, speed, angular, summed, reset = float(wanted[0]), 0.0, 0.0, 0.0, 0.0
    last: Vector = (start, 0.0)

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal speed, angular, summed, reset, last
        speed += STEP / SLOW * ((y[k][0] - last[0]) / STEP - speed)
        angular += STEP / QUICK * ((y[k][1] - last[1]) / STEP - angular)
        last = y[k]
        off = wanted[k] - y[k][0]
        tilts = PLACE * off - SPEED * speed + summed
        if abs(tilts) < TILTS:
            summed += INTEGRAL * STEP * off
        short = min(max(tilts, -TILTS), TILTS) - y[k][1]
        u = ANGLE * short - RATE * angular + LIFT * y[k][0] + reset
        if abs(u) < 6.0:
            reset += RESET * STEP * short
        return (float(np.clip(u, -6.0, 6.0)),)

    air = coloured(rng, SAMPLES, STEP, (AIR,), AIR_TIME)
    supply = coloured(rng, SAMPLES, STEP, (SUPPLY,), SUPPLY_TIME)
    contact = coloured(rng, SAMPLES, STEP, (CONTACT, 0.0), CONTACT_TIME)
    return Truth(
        rates=rates,
        states=("x", "v", "angle", "w", "m", "n", "z", "r", "seen", "volts"),
        start=(start, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, start, LIFT * start),
        sensors=(lambda x, _: x[8] + CURVE * sin(pi * x[8] / BEND), 2),
        command=command,
        limits=((-6.0, 6.0),),
        disturbances=np.hstack([air, supply, np.zeros((SAMPLES, 1))]),
        noise=white(rng, SAMPLES, NOISE) + contact,
        quantum=QUANTUM,
        step=STEP,
        substeps=10,
    )
