"""A bench helicopter: a beam that pitches and yaws under a main and a tail rotor, in two loops.

    Jp dq = Kf wf|wf| (1 - l q / (v wf)) + mt - M cos(th) - H sin(th) - bp q - cables + gust
    cables = kc (th - th0) + Fc z,   dz = (q - |q| z) / slides,   Jy = J0 + J1 cos(th)^2
    Jy dr = Kt wt|wt| (1 - l r / (v wt)) - mf - by r - Fs tanh(r / rs) + gust
    Jf dwf = mf - cf wf|wf|,   mf = k (V - k wf) / R,   and so for the tail's rotor (wt, mt)
    V = u (1 - Rs P / Vs^2): choppers on a supply that droops by the power P that both draw

In the size of laboratory rigs; rotors' thrust goes with the square of their speed, cables rub by
Dahl's model (1968), and thrust falls as a blade climbs. The file lacks the slip ring's friction,
the cables, this inflow, the droop, the tachometers' filters and the yaw inertia that falls with
pitch, and takes drag for the motors' reaction torque. Its inertias are 4 % off, by a drawing.
"""

from collections.abc import Sequence
from math import cos, pi, sin, sqrt, tanh

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, moves, scattered, white

__all__ = ["helicopter"]

FILE = """
name = "bench helicopter"
[states]
th = { unit = "rad", derivative = "q", exact = true }
q = { unit = "rad/s", derivative = "(Kf*wf*abs(wf)+mt*wt*abs(wt)-M*cos(th)-H*sin(th)-bp*q)/Jp" }
psi = { unit = "rad", derivative = "r", exact = true }
r = { unit = "rad/s", derivative = "(Kt*wt*abs(wt) - mf*wf*abs(wf) - by*r)/Jy" }
wf = { unit = "rad/s", derivative = "(gf*main - wf - cf*wf*abs(wf))/Tf" }
wt = { unit = "rad/s", derivative = "(gt*tail - wt - ct*wt*abs(wt))/Tt" }
[inputs]
main = { unit = "V", min = -24, max = 24, hold = "zero" }
tail = { unit = "V", min = -15, max = 15, hold = "zero" }
[outputs]
pitch = { unit = "rad", value = "th" }
yaw = { unit = "rad", value = "psi" }
main_speed = { unit = "rad/s", value = "wf" }
tail_speed = { unit = "rad/s", value = "wt" }
[parameters]
Jp = { unit = "kg*m**2", value = 0.088, fixed = true }
Jy = { unit = "kg*m**2", value = 0.088, fixed = true }
Kf = { unit = "N*m*s**2/rad**2", value = 4.2e-6, min = 1e-6, max = 2e-5 }
Kt = { unit = "N*m*s**2/rad**2", value = 1.4e-6, min = 2e-7, max = 8e-6 }
mf = { unit = "N*m*s**2/rad**2", value = 3e-7, min = 0, max = 2e-6 }
mt = { unit = "N*m*s**2/rad**2", value = 1e-7, min = 0, max = 1e-6 }
M = { unit = "N*m", value = 0.8, min = 0.2, max = 3 }
H = { unit = "N*m", value = 0.3, min = 0, max = 2 }
bp = { unit = "N*m*s/rad", value = 0.03, min = 0, max = 0.5 }
by = { unit = "N*m*s/rad", value = 0.03, min = 0, max = 0.5 }
gf = { unit = "rad/s/V", value = 35, min = 10, max = 100 }
gt = { unit = "rad/s/V", value = 45, min = 10, max = 120 }
cf = { unit = "s/rad", value = 5e-4, min = 0, max = 5e-3 }
ct = { unit = "s/rad", value = 5e-4, min = 0, max = 5e-3 }
Tf = { unit = "s", value = 0.13, min = 0.02, max = 0.6 }
Tt = { unit = "s", value = 0.13, min = 0.02, max = 0.6 }
[faults]
main_drive = { enters = "gain", target = "main", min = 0, max = 0.6 }
tail_offset = { enters = "input", target = "tail", unit = "V", min = -5, max = 5 }
blade = { enters = "parameter", target = "Kf", relative = true, min = -0.6, max = 0 }
pitch_bias = { enters = "output", target = "pitch", unit = "rad", min = -0.4, max = 0.4 }
main_tacho = { enters = "output_gain", target = "main_speed", min = -0.5, max = 0.5 }
side_push = { enters = "state", target = "r", unit = "rad/s**2", min = -2.5, max = 2.5 }
"""
STEP, SAMPLES = 0.02, 3600  # s
PITCH, BEAM, SHAFT = 0.085, 0.076, 0.016  # kg m^2: Jp, J1, J0
LIFT, PUSH = 5.1e-6, 1.2e-6  # N m s^2: Kf, Kt, on arms of 0.2 m
WEIGHT, BELOW, PITCH_RUBS, YAW_RUBS = 0.9, 0.4, 0.012, 0.015  # N m: M, H; N m s/rad: bp, by
RING, RING_SLIDES = 0.006, 0.01  # N m, rad/s
CABLE, BENT, CABLE_RUBS, CABLE_SLIDES = 0.06, 0.1, 0.01, 0.05  # N m/rad, rad, N m, rad
MOTOR, WINDING, ROTOR, DRAG = (0.025, 0.02), (1.0, 1.5), (1e-4, 4e-5), (3.9e-7, 1.3e-7)
SUPPLY, SOURCE = 24.0, 0.4  # V, ohm; above: V s, ohm, kg m^2, N m s^2
ARM, ADVANCE, TACHO = 0.2, 0.02, 0.03  # m, m/rad, s
GUST, GUST_TIME = (0.006, 0.003), 0.4  # N m, s
SPREAD = 0.015  # of constants, from run to run
NOISE, QUANTUM = (0.0, 0.0, 1.5, 1.5), (2 * pi / 4096, 2 * pi / 8192, 0.5, 0.5)  # rad, rad/s
HOVER, TRIM, FILTER = 13.5, 5.3, 0.06  # V, V, s: of the controller
PITCH_PID, YAW_PID = (7.0, 4.0, 4.0), (11.0, 3.0, 10.0)  # V/rad, V/(rad s), V s/rad
LIMITS = ((-24.0, 24.0), (-15.0, 15.0))  # V


def helicopter() -> Case:
    sizes = {
        "main_drive": Sizes(0.1, 0.2, 0.35, (1.0,)),
        "tail_offset": Sizes(0.8, 1.6, 4.0),
        "blade": Sizes(0.1, 0.2, 0.4, (-1.0,)),
        "pitch_bias": Sizes(0.08, 0.15, 0.3),
        "main_tacho": Sizes(0.08, 0.15, 0.4),
        "side_push": Sizes(0.25, 0.5, 2.0),
    }
    return Case("helicopter", FILE, truth, sizes, through={"blade": 2})


def truth(rng: np.random.Generator) -> Truth:
    lift, push, weight, *windings = scattered(rng, (LIFT, PUSH, WEIGHT, *WINDING), SPREAD)

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """d: gusts in pitch and yaw [N m], change of the main rotor's lift as a share."""
        th, q, _, r, wf, wt, z, main, tail = x
        drives = tuple(zip(MOTOR, windings, u, (wf, wt), strict=True))
        drawn = sum(v * (v - k * w) / winding for k, winding, v, w in drives)
        chop = 1 - SOURCE * drawn / SUPPLY**2
        mf, mt = (k * (v * chop - k * w) / winding for k, winding, v, w in drives)
        up = lift * (1 + d[2]) * (wf * abs(wf) - ARM / ADVANCE * abs(wf) * q)
        held = weight * cos(th) + BELOW * sin(th) + CABLE * (th - BENT) + CABLE_RUBS * z
        dq = (up + mt - held - PITCH_RUBS * q + d[0]) / PITCH
        aside = push * (wt * abs(wt) - ARM / ADVANCE * abs(wt) * r)
        turned = aside - mf - YAW_RUBS * r - RING * tanh(r / RING_SLIDES) + d[1]
        dr = turned / (SHAFT + BEAM * cos(th) ** 2)
        dwf = (mf - DRAG[0] * wf * abs(wf)) / ROTOR[0]
        dwt = (mt - DRAG[1] * wt * abs(wt)) / ROTOR[1]
        dz = (q - abs(q) * z) / CABLE_SLIDES
        return q, dq, r, dr, dwf, dwt, dz, (wf - main) / TACHO, (wt - tail) / TACHO

    pitch = moves(rng, SAMPLES, STEP, (-0.4, 0.4), (3.0, 7.0), rows=75, wave=0.03)  # rad
    yaw = moves(rng, SAMPLES, STEP, (-0.8, 0.8), (4.0, 9.0), rows=150, wave=0.08)  # rad
    wanted = np.column_stack((pitch, yaw))
    speed, summed = np.gradient(wanted, STEP, axis=0), [HOVER, TRIM]
    seen, turning = wanted[0].copy(), np.zeros(2)

    def command(k: int, y: Sequence[Vector]) -> Vector:
        told = list[float]()
        for axis, (kp, ki, kd) in enumerate((PITCH_PID, YAW_PID)):
            turning[axis] = (y[k][axis] - seen[axis]) / FILTER
            seen[axis] += STEP * turning[axis]
            off = float(wanted[k, axis] - y[k][axis])
            v = summed[axis] + kp * off + kd * float(speed[k, axis] - turning[axis])
            told.append(float(np.clip(v, *LIMITS[axis])))
            if told[-1] == v:
                summed[axis] += ki * STEP * off
        return tuple(told)

    hover, trim = sqrt(WEIGHT / LIFT), sqrt(WEIGHT / LIFT * DRAG[0] / PUSH)
    gusts = coloured(rng, SAMPLES, STEP, GUST, GUST_TIME)
    return Truth(
        rates=rates,
        states=("th", "q", "psi", "r", "wf", "wt", "z", "main tacho", "tail tacho"),
        start=(float(pitch[0]), 0.0, float(yaw[0]), 0.0, hover, trim, 0.0, hover, trim),
        sensors=(0, 2, 7, 8),
        command=command,
        limits=LIMITS,
        disturbances=np.hstack([gusts, np.zeros((SAMPLES, 1))]),
        noise=white(rng, SAMPLES, NOISE),
        quantum=QUANTUM,
        step=STEP,
        substeps=4,
    )
