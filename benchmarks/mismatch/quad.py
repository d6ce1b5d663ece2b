"""A quadrotor's height and pitch: rotors that lag, a battery that sags, and the ground below.

    dh = v,   dv = (T1 + T2) cos(p) / (1 - (R/4h)^2) - g - D v|v| + gust,
    dp = q,   dq = K (T1 - T2)/A - c q + twist + swing s
    lag dT = A E^2 (a u + (1 - a) u^2) - T,   ds = W r,   dr = -W s

T1 and T2 are the thrusts in front and behind per mass, E is the battery's voltage as a share of a
full one's. Near the ground a rotor lifts more: Cheeseman and Bennett, "The Effect of the Ground on
a Helicopter Rotor in Forward Flight" (1955). The file's thrust follows a straight line at once; it
has no battery, ground or gusts, and its drag is linear. A load that swings at W below (s) pulls at
the frame where `swing` is not 0, which the file does not declare. Cascaded controllers fly it.
"""

from collections.abc import Sequence
from math import cos

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, white

__all__ = ["quad"]

FILE = """
name = "quadrotor"
[states]
h = { unit = "m", derivative = "v", exact = true }
v = { unit = "m/s", derivative = "lift*(front + rear - 2*idle)*cos(p) - 9.81 - drag*v" }
p = { unit = "rad", derivative = "q", exact = true }
q = { unit = "rad/s", derivative = "turn*(front - rear) - damping*q + trim" }
[inputs]
front = { min = 0, max = 1, hold = "zero" }
rear = { min = 0, max = 1, hold = "zero" }
[outputs]
height = { unit = "m", value = "h" }
pitch = { unit = "rad", value = "p" }
gyro = { unit = "rad/s", value = "q" }
[parameters]
lift = { unit = "m/s**2", value = 12, min = 0 }
idle = { value = 0.1, min = 0, max = 0.4 }
drag = { unit = "1/s", value = 0.1, min = 0 }
turn = { unit = "rad/s**2", value = 80, min = 0 }
damping = { unit = "1/s", value = 0.5, min = 0 }
trim = { unit = "rad/s**2", value = 0 }
[faults]
front_loss = { enters = "gain", target = "front" }
rear_loss = { enters = "gain", target = "rear" }
payload = { enters = "state", target = "v", unit = "m/s**2" }
height_bias = { enters = "output", target = "height", unit = "m" }
pitch_bias = { enters = "output", target = "pitch", unit = "rad" }
gyro_bias = { enters = "output", target = "gyro", unit = "rad/s" }
"""
STEP, SAMPLES = 0.02, 2000  # s; 40 s
THRUST, STRAIGHT, LAG = 15.0, 0.3, 0.05  # m/s^2 of one rotor pair, its share linear in u, s
TURN, DAMPING = 100.0, 1.0  # rad/s^2 for all of one rotor pair's thrust, 1/s
GRAVITY, DRAG, RADIUS = 9.81, 0.15, 0.4  # m/s^2, 1/m, m
FULL, SAG = (0.985, 1.0), (0.01, 0.03)  # the voltage's share at the start, what a log takes of it
GUST, GUST_TIME = (0.3, 1.0), 0.8  # m/s^2 and rad/s^2, s
SWING = (4.0, 6.0)  # rad/s
OFF_CENTRE = 1.0  # rad/s^2: standard deviation of the trim from log to log
NOISE, QUANTUM = (0.03, 0.004, 0.02), (0.01, 0.0, 0.001)  # m, rad, rad/s
HOVER = 0.5
CLIMB, CLIMB_DAMPING, CLIMB_TIME = 2.0, 2.2, 3.0  # 1/s^2, 1/s, s
PITCH, PITCH_DAMPING, PITCH_TIME = 36.0, 9.0, 1.0  # 1/s^2, 1/s, s
FILTER = 0.2  # s, of the climb rate


def quad() -> Case:
    sizes = {
        "front_loss": Sizes(0.08, 0.15, 0.25, (1.0,)),
        "rear_loss": Sizes(0.08, 0.15, 0.25, (1.0,)),
        "payload": Sizes(1.0, 2.0, 3.0),
        "height_bias": Sizes(0.25, 0.5, 0.7),
        "pitch_bias": Sizes(0.05, 0.1, 0.25),
        "gyro_bias": Sizes(0.1, 0.2, 0.5),
        "swing": Sizes(3.0, 6.0, 10.0),
    }
    told_as = {"swing": ("unknown", 1.0)}
    return Case("quad", FILE, truth, sizes, through={"swing": 3}, told_as=told_as)


def rates(x: Vector, u: Vector, d: Vector) -> Vector:
    """States h, v, p, q, T1, T2 [m/s^2], s, r.

    d: voltage (a share), gust [m/s^2], twist [rad/s^2], swing [rad/s^2] and the load's W [rad/s].
    """
    h, v, p, q, front, rear, s, r = x
    near = 1 - (RADIUS / (4 * max(h, 0.2))) ** 2
    return (
        v,
        (front + rear) * cos(p) / near - GRAVITY - DRAG * v * abs(v) + d[1],
        q,
        TURN * (front - rear) / THRUST - DAMPING * q + d[2] + d[3] * s,
        (thrust(u[0], d[0]) - front) / LAG,
        (thrust(u[1], d[0]) - rear) / LAG,
        d[4] * r,
        -d[4] * s,
    )


def thrust(u: float, voltage: float) -> float:
    return THRUST * voltage**2 * (STRAIGHT * u + (1 - STRAIGHT) * u * u)


def truth(rng: np.random.Generator) -> Truth:
    heights = _smooth(levels(rng, SAMPLES, STEP, (1.0, 3.0), (3.0, 7.0)), 75)
    pitches = _smooth(levels(rng, SAMPLES, STEP, (-0.25, 0.25), (1.0, 3.0)), 25)
    climb = summed = turned = 0.0
    followed = float(heights[0])

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal climb, followed, summed, turned
        height, pitch, turning = y[k]
        climb = (height - followed) / FILTER
        followed += STEP * climb
        up, off = CLIMB * (heights[k] - height), PITCH * (pitches[k] - pitch)
        both = HOVER + (up + summed - CLIMB_DAMPING * climb) / (2 * THRUST)
        apart = (off + turned - PITCH_DAMPING * turning) / (2 * TURN)
        u = tuple(float(np.clip(each, 0.0, 1.0)) for each in (both + apart, both - apart))
        if min(u) > 0.0 and max(u) < 1.0:
            summed += up * STEP / CLIMB_TIME
            turned += off * STEP / PITCH_TIME
        return u

    run = np.linspace(0.0, 1.0, SAMPLES)
    voltage = rng.uniform(*FULL) - rng.uniform(*SAG) * run
    gusts = coloured(rng, SAMPLES, STEP, GUST, GUST_TIME)
    twist = gusts[:, 1] + OFF_CENTRE * rng.standard_normal()
    frequency, phase = rng.uniform(*SWING), rng.uniform(0.0, 2 * np.pi)
    still = np.zeros(SAMPLES)
    return Truth(
        rates=rates,
        states=("h", "v", "p", "q", "front", "rear", "s", "r"),
        start=(
            float(heights[0]),
            0.0,
            float(pitches[0]),
            0.0,
            GRAVITY / 2,
            GRAVITY / 2,
            float(np.sin(phase)),
            float(np.cos(phase)),
        ),
        sensors=(0, 2, 3),
        command=command,
        limits=((0.0, 1.0), (0.0, 1.0)),
        disturbances=np.column_stack((voltage, gusts[:, 0], twist, still, still + frequency)),
        noise=white(rng, SAMPLES, NOISE),
        quantum=QUANTUM,
        step=STEP,
        substeps=2,
    )


def _smooth(places: list[float], rows: int) -> np.ndarray:
    """Moves of so many rows each."""
    kernel = np.hanning(rows)
    return np.convolve(np.pad(places, (rows - 1, 0), mode="edge"), kernel / kernel.sum(), "valid")
