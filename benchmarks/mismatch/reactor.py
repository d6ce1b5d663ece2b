"""A stirred tank with a cooling jacket, for fourteen hours: Arrhenius, a wall that stores, fouling.

    V dc = q (cf - c) - V k(T) c,   k = k0 exp(E (1/T0 - 1/T))
    M dT = q r (Tf - T) + V heat k(T) c - U (T - W) - loss (T - Ta)
    Mw dW = U (T - W) + Uj (W - J),   Mj dJ = flow (Tc - J) - Uj (J - W) - loss (J - Ta)
    lag dflow = fmax (R^(v-1) - 1/R) / (1 - 1/R) - flow,   lag dS = T - S
    lag (1 + late) dA = c - A

S and A are the thermometer and the analyser. Uj fouls slowly and wanders, feed and cooling water
wander, constants differ from run to run. The file has a rate that is exponential in temperature,
feed and cooling water that stay, a jacket without wall or losses, and a valve without lag. The
feed's flow is logged and moves. What is not declared is an analyser that gets `late` times slower.
"""

from collections.abc import Sequence
from math import exp

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, ramps, scattered, white

__all__ = ["reactor"]

FILE = """
name = "stirred-tank reactor"
[states]
c = { unit = "mol/l", derivative = "feed*(c_in - c)/volume - k*exp(s*(T - 340))*c" }
T = { unit = "K", derivative = "feed*(T_in - T)/volume + hot*k*exp(s*(T - 340))*c - ua*(T - J)" }
J = { unit = "K", derivative = "uj*(T - J) - cool*exp(0.032*valve)*(J - T_cool)" }
[inputs]
valve = { unit = "%", min = 0, max = 100, hold = "zero" }
feed = { unit = "l/min", min = 0, max = 20, hold = "zero" }
[outputs]
analyser = { unit = "mol/l", value = "c" }
reactor = { unit = "K", value = "T" }
jacket = { unit = "K", value = "J" }
[parameters]
volume = { value = 6000, unit = "l*s/min", fixed = true }
c_in = { value = 2, unit = "mol/l", fixed = true }
T_in = { value = 298, unit = "K", fixed = true }
T_cool = { value = 288, unit = "K", fixed = true }
k = { value = 0.004, min = 0 }
s = { value = 0.05, min = 0 }
hot = { value = 40, min = 0 }
ua = { value = 0.001, min = 0 }
uj = { value = 0.003, min = 0 }
cool = { value = 3e-4, min = 0 }
[faults]
heat_loss = { enters = "state", target = "T", unit = "K/s", max = 0 }
cooling_loss = { enters = "gain", target = "valve" }
catalyst = { enters = "parameter", target = "k", relative = true, max = 0 }
thermometer_bias = { enters = "output", target = "reactor", unit = "K" }
analyser_bias = { enters = "output", target = "analyser", unit = "mol/l" }
"""
STEP, SAMPLES = 10.0, 5000  # s; 14 h
VOLUME = 100.0  # l
RATE, ACTIVATION, MIDDLE = 0.004, 5000.0, 340.0  # 1/s, K, K
HEAT, STORED, CARRIED = 250.0, 420.0, 4.1  # kJ/mol, kJ/K, kJ/(l K)
WALL, JACKET = 60.0, 300.0  # kJ/K
INNER, OUTER, LOSS = 2.5, 2.5, 0.02  # kW/K
FLOW, RANGE, STEM = 2.0, 25.0, 15.0  # kW/K of cooling when open, 1, s: equal percentage
THERMOMETER, ANALYSER = 20.0, 60.0  # s
FOULS, FOULS_TIME = 0.03, 7200.0  # of the jacket's conductance, s
FEED, COOLING = (2.0, 298.0), 288.0  # mol/l, K; K
STRAY, STRAY_TIME = (0.02, 1.0, 1.0), 3600.0  # mol/l, K, K, s
ROOM = (288.0, 302.0)  # K
SPREAD = 0.02  # of every constant, from run to run
HUM, HUM_TIME = (0.004, 0.05, 0.05), 120.0  # mol/l, K, K, s
NOISE, QUANTUM = (0.006, 0.06, 0.06), (0.002, 0.05, 0.05)  # mol/l, K, K
TARGETS, HOLD, RAMP = (333.0, 345.0), (3600.0, 9000.0), 0.008  # K, s, K/s
FEEDS, FEED_HOLD = (4.0, 8.0), (2400.0, 7200.0)  # l/min, s
GAIN, INTEGRAL = 5.0, 700.0  # %/K, s


def reactor() -> Case:
    sizes = {
        "heat_loss": Sizes(0.006, 0.012, 0.03, (-1.0,)),
        "cooling_loss": Sizes(0.1, 0.2, 0.4, (1.0,)),
        "catalyst": Sizes(0.1, 0.2, 0.4, (-1.0,)),
        "thermometer_bias": Sizes(1.5, 3, 6),
        "analyser_bias": Sizes(0.04, 0.08, 0.2),
        "slow_analyser": Sizes(6, 12, 20, (1.0,)),
    }
    return Case(
        "reactor",
        FILE,
        truth,
        sizes,
        through={"catalyst": 4, "slow_analyser": 5},
        told_as={"slow_analyser": ("unknown", 1.0)},
    )


def truth(rng: np.random.Generator) -> Truth:
    rate, heat, stored, inner, outer, loss, flow = scattered(
        rng, (RATE, HEAT, STORED, INNER, OUTER, LOSS, FLOW), SPREAD
    )
    room = float(rng.uniform(*ROOM))

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """c, T, W, J, flow [kW/K], S, A; d: feed [mol/l, K], cooling, fouling, active, late."""
        c, hot, wall, jacket, cooling, seen, told = x
        fed = u[1] / 60  # l/s
        made = VOLUME * rate * (1 + d[4]) * exp(ACTIVATION * (1 / MIDDLE - 1 / hot)) * c
        in_, out = inner * (hot - wall), outer * (1 + d[3]) * (wall - jacket)
        opened = flow * (RANGE ** (u[0] / 100 - 1) - 1 / RANGE) / (1 - 1 / RANGE)
        return (
            (fed * (d[0] - c) - made) / VOLUME,
            (fed * CARRIED * (d[1] - hot) + heat * made - in_ - loss * (hot - room)) / stored,
            (in_ - out) / WALL,
            (out - cooling * (jacket - d[2]) - loss * (jacket - room)) / JACKET,
            (opened - cooling) / STEM,
            (hot - seen) / THERMOMETER,
            (c - told) / (ANALYSER * (1 + d[5])),
        )

    wanted = ramps(levels(rng, SAMPLES, STEP, TARGETS, HOLD), RAMP * STEP)
    feeds = np.array(levels(rng, SAMPLES, STEP, FEEDS, FEED_HOLD))
    summed = 65.0  # %

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed
        off = GAIN * (y[k][1] - wanted[k])
        u = off + summed
        if 0.0 < u < 100.0:
            summed += off * STEP / INTEGRAL
        return (min(max(u, 0.0), 100.0), float(feeds[k]))

    supplied = coloured(rng, SAMPLES, STEP, STRAY, STRAY_TIME) + np.array((*FEED, COOLING))
    fouls = coloured(rng, SAMPLES, STEP, (FOULS,), FOULS_TIME)
    first = float(wanted[0])
    return Truth(
        rates=rates,
        states=("c", "T", "W", "J", "flow", "S", "A"),
        start=(0.4, first, first - 9.0, first - 18.0, 0.6, first, 0.4),
        sensors=(6, 5, 3),
        command=command,
        limits=((0.0, 100.0), (0.0, 20.0)),
        disturbances=np.hstack([supplied, fouls, np.zeros((SAMPLES, 2))]),
        noise=white(rng, SAMPLES, NOISE) + coloured(rng, SAMPLES, STEP, HUM, HUM_TIME),
        quantum=QUANTUM,
        step=STEP,
        substeps=4,
    )
