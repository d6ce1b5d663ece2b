"""A pneumatic control valve in a flow loop, with a positioner, a stem that sticks, and a line.

    dp = clip(g (1 + a) dead(u - s), -out, in (1 + a)) / (1 + slow),   ds = dead(p - s, stick) / rub
    f = R^(s/100 - 1) (1 + clog),   dF = (Q sqrt((1 + w) / (1 + line f^2)) f - F) / damped

The positioner lets air in and out of the diaphragm, whose pressure p [% of the spring's range] the
stem follows where it does not stick; the air supply a and the pressure over the line w wander. An
equal-percentage trim (IEC 60534) shares that pressure with the line, and the transmitter damps.
The file has a stem that follows the command with one lag, and the trim without the line. The logged
position is not what the positioner feeds back. A PI controller keeps the flow. What is not
declared is a throttled air tube: the positioner takes 1 + slow times as long.
"""

from collections.abc import Sequence

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, white

__all__ = ["valve"]

FILE = """
name = "control valve"
[states]
s = { unit = "%", derivative = "(u - s)/lag", min = 0, max = 100 }
[inputs]
u = { unit = "%", min = 0, max = 100, hold = "zero" }
[outputs]
position = { unit = "%", value = "s" }
flow = { unit = "m**3/h", value = "Q*exp(a*(s/100 - 1))" }
[parameters]
lag = { value = 2, unit = "s", min = 0.1 }
Q = { value = 30, unit = "m**3/h", min = 0 }
a = { value = 3.5, min = 0 }
[faults]
positioner_bias = { enters = "input", target = "u", unit = "%" }
span_loss = { enters = "gain", target = "u" }
position_bias = { enters = "output", target = "position", unit = "%" }
flow_bias = { enters = "output", target = "flow", unit = "m**3/h" }
clogging = { enters = "parameter", target = "Q", relative = true, min = -0.9, max = 0 }
"""
STEP, SAMPLES = 0.2, 2500  # s; 500 s
POSITIONER, DEAD = 1.2, 0.2  # 1/s, %
FILL, VENT = 15.0, 20.0  # %/s
STICK, RUB = 1.5, 0.3  # %, s
TRIM, RANGEABILITY, LINE = 40.0, 30.0, 1.0  # m^3/h, 1, 1
DAMPED = 0.5  # s
PRESSURE, PRESSURE_TIME = 0.03, 40.0  # of the pressure, s
AIR, AIR_TIME = 0.1, 60.0  # of the supply, s
NOISE, QUANTUM = (0.15, 0.06), (0.1, 0.02)  # %, m^3/h
GAIN, INTEGRAL = 1.5, 4.0  # % h/m^3, s


def valve() -> Case:
    sizes = {
        "positioner_bias": Sizes(5, 10, 25),
        "span_loss": Sizes(0.1, 0.2, 0.25, (1.0,)),
        "position_bias": Sizes(5, 10, 25),
        "flow_bias": Sizes(1, 2, 3.5),
        "clogging": Sizes(0.1, 0.2, 0.4, (-1.0,)),
        "slow_actuator": Sizes(2, 4, 8, (1.0,)),
    }
    return Case(
        "valve",
        FILE,
        truth,
        sizes,
        through={"clogging": 2, "slow_actuator": 3},
        told_as={"slow_actuator": ("unknown", 1.0)},
    )


def rates(x: Vector, u: Vector, d: Vector) -> Vector:
    """States p, s [%] and the flow as transmitted [m^3/h]; d: w, a, clog, slow."""
    p, s, flow = x
    pressure, air, clog, slow = d
    let_in = POSITIONER * (1 + air) * _outside(u[0] - s, DEAD)
    opened = RANGEABILITY ** (s / 100 - 1) * (1 + clog)
    passed = TRIM * opened * ((1 + pressure) / (1 + LINE * opened**2)) ** 0.5
    return (
        min(max(let_in, -VENT), FILL * (1 + air)) / (1 + slow),
        _outside(p - s, STICK) / RUB,
        (passed - flow) / DAMPED,
    )


def truth(rng: np.random.Generator) -> Truth:
    wanted = levels(rng, SAMPLES, STEP, (5.0, 14.0), (12.0, 40.0))
    start = 60.0  # %
    summed = start

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed
        off = wanted[k] - y[k][1]
        u = GAIN * off + summed
        if 0.0 < u < 100.0:
            summed += GAIN * off * STEP / INTEGRAL
        return (min(max(u, 0.0), 100.0),)

    pressure = coloured(rng, SAMPLES, STEP, (PRESSURE,), PRESSURE_TIME)
    air = coloured(rng, SAMPLES, STEP, (AIR,), AIR_TIME)
    return Truth(
        rates=rates,
        states=("p", "s", "F"),
        start=(start, start, 9.9),
        sensors=(1, 2),
        command=command,
        limits=((0.0, 100.0),),
        disturbances=np.hstack([pressure, air, np.zeros((SAMPLES, 2))]),
        noise=white(rng, SAMPLES, NOISE),
        quantum=QUANTUM,
        step=STEP,
        substeps=8,
    )


def _outside(x: float, width: float) -> float:
    """By how much x lies outside +-width."""
    return max(x - width, 0.0) + min(x + width, 0.0)
