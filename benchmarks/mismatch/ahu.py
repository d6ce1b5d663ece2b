"""An air handling unit: a damper mixes, a coil heats, and the room has walls.

    mixed = Tr + s(damper) (To - Tr),   s(x) = leak + (1 - leak) x^1.2
    Cc dTc = W g(z) (Tw - Tc) - F e (Tc - mixed),   stem dz = valve - z
    duct dTs = mixed + e (Tc - mixed) - Ts
    Cr dTr = F (Ts - Tr) + U (To - Tr) + B (Tb - Tr) + people + window (To - Tr)
    Cb dTb = B (Tr - Tb) + U' (To - Tb)

F is the air's heat capacity flow. The valve is of equal percentage in a circuit that takes most of
the pressure when it is open (its authority N is low): flow g = 1/sqrt(1 - N + N/f^2), f = 30^(z-1).
The file has a straight valve without a stem, a straight damper, no walls (Tb), water of a fixed
temperature, and a constant gain for the sun and the people, who come and go. The thermometer
outside has an error that wanders with the sun. An open window is not declared. One PI controller
keeps the supply by the valve, another the room by the supply's set point.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, white

__all__ = ["ahu"]

FILE = """
name = "air handling unit"
[states.coil]
unit = "degC"
derivative = "heat*valve*(water - coil) - give*e*(coil - room - share*damper*(outdoor - room))"
[states.supply]
unit = "degC"
derivative = "((1 - e)*(room + share*damper*(outdoor - room)) + e*coil - supply)/lag"
[states.room]
unit = "degC"
derivative = "air*(supply - room) + loss*(outdoor - room) + gains"
[inputs]
valve = { min = 0, max = 1, hold = "zero" }
damper = { min = 0, max = 1, hold = "zero" }
outdoor = { unit = "degC", hold = "linear" }
[outputs]
return_water = { unit = "degC", value = "coil" }
supply_air = { unit = "degC", value = "supply" }
room_air = { unit = "degC", value = "room" }
[parameters]
heat = { unit = "1/s", value = 0.02, min = 0 }
give = { unit = "1/s", value = 0.02, min = 0 }
e = { value = 0.6, min = 0.05, max = 1 }
water = { unit = "degC", value = 55, fixed = true }
share = { value = 1, min = 0.3, max = 1.5 }
lag = { unit = "s", value = 60, min = 5 }
air = { unit = "1/s", value = 5e-4, min = 0 }
loss = { unit = "1/s", value = 1e-4, min = 0 }
gains = { unit = "K/s", value = 0 }
[faults]
valve_bias = { enters = "input", target = "valve" }
valve_loss = { enters = "gain", target = "valve" }
damper_bias = { enters = "input", target = "damper" }
fouling = { enters = "parameter", target = "e", relative = true, min = -0.9, max = 0 }
supply_bias = { enters = "output", target = "supply_air", unit = "K" }
room_bias = { enters = "output", target = "room_air", unit = "K" }
"""
STEP, SAMPLES = 60.0, 1800  # s; 30 h
AIR, WATER, EFFECT = 1000.0, 1500.0, 0.7  # W/K: 1 kg/s of air; W/K at an open valve; of the coil
COIL, ROOM, WALL = 1e5, 3e6, 4e7  # J/K
WINDOWS, INSIDE, OUTSIDE = 80.0, 400.0, 100.0  # W/K: of the room to outside, to walls, beyond them
STEM, DUCT = 40.0, 45.0  # s
AUTHORITY, RANGEABILITY, LEAK, CURVE = 0.3, 30.0, 0.02, 1.2
BOILER, BOILER_WANDER, BOILER_TIME = 55.0, 1.0, 1800.0  # degC, K, s
MEAN, SWING, WEATHER, WEATHER_TIME = (-4.0, 1.0), 3.0, 1.0, 7200.0  # degC, K, K, s
SUN, SUN_TIME = 0.3, 3600.0  # K: error of the thermometer outside, s
PEOPLE, COME, COME_TIME = 1000.0, 250.0, 5400.0  # W, W, s
VARIES = 0.02  # standard deviation of the air's flow from log to log, as a share
NOISE, QUANTUM = (0.1, 0.1, 0.05), (0.1, 0.1, 0.05)  # K
SUPPLY, SUPPLY_TIME = 0.015, 240.0  # 1/K, s
WARM, WARM_TIME = 3.0, 3600.0  # K/K, s


def ahu() -> Case:
    sizes = {
        "valve_bias": Sizes(0.08, 0.15, 0.2),
        "valve_loss": Sizes(0.12, 0.25, 0.5, (1.0,)),
        "damper_bias": Sizes(0.08, 0.15, 0.2),
        "fouling": Sizes(0.15, 0.3, 0.45, (-1.0,)),
        "supply_bias": Sizes(1.0, 2.0, 5.0),
        "room_bias": Sizes(0.6, 1.2, 3.0),
        "window": Sizes(50.0, 100.0, 200.0, (1.0,)),
    }
    through, told_as = {"fouling": 3, "window": 4}, {"window": ("unknown", 1.0)}
    return Case("ahu", FILE, truth, sizes, through=through, told_as=told_as)


def rates(x: Vector, u: Vector, d: Vector) -> Vector:
    """States coil, supply, room, wall [degC] and the stem; u: valve, damper.

    d: outdoor and water [degC], people [W], change of e as a share, window [W/K], change of the
    air's flow as a share.
    """
    coil, supply, room, wall, stem = x
    effect, air = EFFECT * (1 + d[3]), AIR * (1 + d[5])
    mixed = room + (LEAK + (1 - LEAK) * u[1] ** CURVE) * (d[0] - room)
    given = air * effect * (coil - mixed)
    walls = INSIDE * (wall - room)
    return (
        (WATER * flow(stem) * (d[1] - coil) - given) / COIL,
        (mixed + effect * (coil - mixed) - supply) / DUCT,
        (air * (supply - room) + (WINDOWS + d[4]) * (d[0] - room) + walls + d[2]) / ROOM,
        (OUTSIDE * (d[0] - wall) - walls) / WALL,
        (u[0] - stem) / STEM,
    )


def flow(stem: float) -> float:
    return 1 / sqrt(1 - AUTHORITY + AUTHORITY * RANGEABILITY ** (2 - 2 * stem))


def truth(rng: np.random.Generator) -> Truth:
    t = STEP * np.arange(SAMPLES)
    wanted = levels(rng, SAMPLES, STEP, (19.5, 22.5), (7200.0, 18000.0))
    damper = levels(rng, SAMPLES, STEP, (0.2, 0.6), (3600.0, 9000.0))
    day = SWING * np.sin(2 * np.pi * (t / 86400.0 + rng.uniform()))
    outdoor = rng.uniform(*MEAN) + day + coloured(rng, SAMPLES, STEP, (WEATHER,), WEATHER_TIME).T[0]
    seen = outdoor + coloured(rng, SAMPLES, STEP, (SUN,), SUN_TIME).T[0]
    seen = np.round(seen, 1).tolist()
    water = BOILER + coloured(rng, SAMPLES, STEP, (BOILER_WANDER,), BOILER_TIME).T[0]
    people = PEOPLE + coloured(rng, SAMPLES, STEP, (COME,), COME_TIME).T[0]
    still = np.zeros(SAMPLES)
    varied = still + VARIES * rng.standard_normal()
    warmed, summed = 22.0, 0.45  # degC, and of the valve's stroke

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal warmed, summed
        _, supply, room = y[k]
        cold = WARM * (wanted[k] - room)
        point = min(max(cold + warmed, 14.0), 35.0)
        off = SUPPLY * (point - supply)
        valve = off + summed
        if 14.0 < cold + warmed < 35.0:
            warmed += cold * STEP / WARM_TIME
        if 0.0 < valve < 1.0 or off * (valve - 0.5) < 0:
            summed += off * STEP / SUPPLY_TIME
        return min(max(valve, 0.0), 1.0), damper[k], seen[k]

    return Truth(
        rates=rates,
        states=("coil", "supply", "room", "wall", "stem"),
        start=(25.0, 22.0, wanted[0], wanted[0] - 3.0, 0.45),
        sensors=(0, 1, 2),
        command=command,
        limits=((0.0, 1.0), (0.0, 1.0), (-50.0, 60.0)),
        disturbances=np.column_stack((outdoor, water, people, still, still, varied)),
        noise=white(rng, SAMPLES, NOISE),
        quantum=QUANTUM,
        step=STEP,
        substeps=4,
    )
