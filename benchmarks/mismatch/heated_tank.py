"""A heated tank in two loops for two hours, with a bent valve, a wall and a sensor that lags.

    A dh = q(va) - c sqrt(h),    q = qmax va (1 + 0.25 (va - 0.5)),    dva = (valve - va) / 2.5 s
    A h dT = q (tin - T) + (P he - UA (T - amb) - radiated - Uw (T - Tw)) / rc,
    dhe = (heat - he) / 15 s,    Cw dTw = Uw (T - Tw),    dTs = (T - Ts) / 10 s

What is measured is h, with waves, and Ts, both coarse. Five constants are never twice the same, and
the feed and the room wander. The file has a straight valve, no lag anywhere, no wall and one
temperature of the feed. Who wrote it had read the README alone; it was then a case to develop on.
"""

from collections.abc import Sequence

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, white

__all__ = ["heated_tank"]

FILE = """
name = "heated tank"
[states]
h = { unit = "m", derivative = "(kv*valve - c*sqrt(h))/A" }
T = { unit = "degC", derivative = "(kv*valve*(tin - T) + (P*heat - ua*(T - amb))/rc)/(A*h)" }
[inputs]
valve = { unit = "1", min = 0, max = 1, hold = "zero" }
heat = { unit = "1", min = 0, max = 1, hold = "zero" }
[outputs]
level = { unit = "m", value = "h" }
probe = { unit = "degC", value = "T" }
[parameters]
A = { value = 0.05, unit = "m**2", fixed = true }
rc = { value = 4.186e6, unit = "J/m**3/K", fixed = true }
amb = { value = 20, unit = "degC", fixed = true }
kv = { value = 1.8e-4, unit = "m**3/s", min = 1e-5 }
c = { value = 1.2e-4, unit = "m**2.5/s", min = 1e-5 }
P = { value = 9000, unit = "W", min = 1000 }
ua = { value = 25, unit = "W/K", min = 0 }
tin = { value = 14, unit = "degC", min = 0, max = 30, vary = "run" }
[faults]
valve_bias = { enters = "input", target = "valve", unit = "1" }
heater_bias = { enters = "input", target = "heat", unit = "1" }
level_bias = { enters = "output", target = "level", unit = "m" }
probe_bias = { enters = "output", target = "probe", unit = "K" }
"""
STEP, SAMPLES = 2.0, 3600  # s; 2 h
AREA, RC = 0.05, 4.186e6  # m^2, J/(m^3 K)
FLOW, OUTLET, POWER, LOSS, FEED = 2.0e-4, 1.3e-4, 10000.0, 20.0, 15.0  # m^3/s ... degC
BENT = 0.25
SPREAD, WIDEST = 0.015, 0.03  # of these five, from run to run
WALL, THROUGH = 6000.0, 120.0  # J/K, W/K
RADIATED = 1.5e-8  # W/K^4
VALVE, HEATER, SENSOR = 2.5, 15.0, 10.0  # s
FEED_WANDER, ROOM, ROOM_WANDER = (0.25, 1500.0), 20.0, (1.5, 2500.0)  # K, s
WAVES = (0.001, 3.9)  # m, s
NOISE, QUANTUM = (0.001, 0.03), (0.002, 0.1)  # m, K
GAINS, INTEGRALS, BACK = (4.0, 0.25), (0.02, 0.0012), (0.05, 0.02)  # of the loops
KELVIN = 273.0


def heated_tank() -> Case:
    sizes = {
        "valve_bias": Sizes(0.1, 0.25, 0.5),
        "heater_bias": Sizes(0.1, 0.25, 0.5),
        "level_bias": Sizes(0.03, 0.09, 0.15),
        "probe_bias": Sizes(0.6, 2.5, 5.0),
    }
    return Case("heated_tank", FILE, truth, sizes)


def truth(rng: np.random.Generator) -> Truth:
    off = np.clip(rng.normal(0.0, SPREAD, 5), -WIDEST, WIDEST)
    flow, outlet, power, loss, feed = (1 + off) * (FLOW, OUTLET, POWER, LOSS, FEED)
    wanted = [
        levels(rng, SAMPLES, STEP, (0.45, 0.9), (500.0, 1100.0)),
        levels(rng, SAMPLES, STEP, (24.0, 33.0), (450.0, 1000.0)),
    ]
    feeds = feed + coloured(rng, SAMPLES, STEP, FEED_WANDER[:1], FEED_WANDER[1])
    rooms = ROOM + coloured(rng, SAMPLES, STEP, ROOM_WANDER[:1], ROOM_WANDER[1])

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States h [m], T, Tw, Ts [degC], va, he; d: the feed's and the room's temperature."""
        h, T, wall, sensed, valve, heat = x
        q = flow * valve * (1 + BENT * (valve - 0.5))
        lost = loss * (T - d[1]) + RADIATED * ((T + KELVIN) ** 4 - (d[1] + KELVIN) ** 4)
        given = power * heat - lost - THROUGH * (T - wall)
        h = max(h, 0.01)
        return (
            (q - outlet * h**0.5) / AREA,
            (q * (d[0] - T) + given / RC) / (AREA * h),
            THROUGH * (T - wall) / WALL,
            (T - sensed) / SENSOR,
            (u[0] - valve) / VALVE,
            (u[1] - heat) / HEATER,
        )

    start = float(wanted[0][0] + rng.uniform(-0.05, 0.05)), float(wanted[1][0] - rng.uniform(0, 4))
    open_ = outlet * start[0] ** 0.5 / flow
    summed = [open_, 0.5]

    def command(k: int, y: Sequence[Vector]) -> Vector:
        found = []
        for j in range(2):
            off = float(wanted[j][k]) - y[k][j]
            raw = GAINS[j] * off + summed[j]
            u = min(max(raw, 0.0), 1.0)
            summed[j] += STEP * (INTEGRALS[j] * off + BACK[j] * (u - raw))
            found.append(u)
        return tuple(found)

    waves = coloured(rng, SAMPLES, STEP, WAVES[:1], WAVES[1])
    return Truth(
        rates=rates,
        states=("h", "T", "Tw", "Ts", "va", "he"),
        start=(*start, start[1] - 1, start[1], open_, 0.5),
        sensors=(0, 3),
        command=command,
        limits=((0.0, 1.0), (0.0, 1.0)),
        disturbances=np.hstack([feeds, rooms]),
        noise=white(rng, SAMPLES, NOISE) + np.hstack([waves, 0 * waves]),
        quantum=QUANTUM,
        step=STEP,
        substeps=4,
    )
