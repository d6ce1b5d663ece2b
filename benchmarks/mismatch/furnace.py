"""A chamber furnace with walls that store, for ten hours of soaks and ramps.

    C dT = P - G (T - W) - s A (T^4 - W^4) - leak (T - Ta),   lag dP = (1 + mains)^2 Pmax u/100 - P
    Cw dW = G (T - W) + s A (T^4 - W^4) - Gw (W - Ta),   slow (1 + late) dS = T - S

Radiation in K^4. The thermocouple S lags, the mains and the room wander, charge and lining differ
from run to run, and a thermocouple's error is some K. The file has one heat capacity, and a network
for what it loses at a temperature; so it lacks the walls' memory, the element's lag and the
thermocouple's. A PI controller follows ramps. What is not declared is a thermocouple that gets
`late` times slower.

A loss of heat is injected in K/s of the chamber, C, which is a part of what the file's one lump
stores: the file's own size for the same watts may be smaller.
"""

from collections.abc import Sequence

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, ramps, scattered, white

__all__ = ["furnace"]

FILE = """
name = "chamber furnace"
[states]
T = { unit = "degC", derivative = "heat*u - loss(T)" }
[inputs]
u = { unit = "%", min = 0, max = 100, hold = "zero" }
[outputs]
thermocouple = { unit = "degC", value = "T" }
[parameters]
heat = { value = 0.005, min = 0 }
[networks]
loss = { monotone = "increasing" }
[faults]
heater_loss = { enters = "gain", target = "u" }
heat_loss = { enters = "state", target = "T", unit = "K/s", max = 0 }
thermocouple_bias = { enters = "output", target = "thermocouple", unit = "K" }
"""
STEP, SAMPLES = 5.0, 7200  # s; 10 h
CHAMBER, WALL = 12e3, 30e3  # J/K
CONDUCTED, RADIATED = 4.0, 5.67e-8 * 0.04  # W/K, W/K^4
OUTSIDE, LEAK = 6.0, 1.2  # W/K
POWER, ELEMENT = 6000.0, 40.0  # W, s
THERMOCOUPLE = 25.0  # s
SPREAD = 0.02  # of every constant, from run to run
ERROR = 2.0  # K: of a thermocouple
MAINS, MAINS_TIME = 0.01, 1800.0  # of the voltage, s
ROOM, WANDER, WANDER_TIME = (15.0, 28.0), 2.0, 5400.0  # degC, K, s
NOISE, HUM, HUM_TIME, QUANTUM = 0.3, 0.2, 60.0, 0.1  # K, K, s, K
SOAKS, HOLD, RAMP = (350.0, 850.0), (2700.0, 7200.0), 0.12  # degC, s, K/s
GAIN, INTEGRAL = 0.8, 900.0  # %/K, s
KELVIN = 273.15


def furnace() -> Case:
    sizes = {
        "heater_loss": Sizes(0.1, 0.2, 0.4, (1.0,)),
        "heat_loss": Sizes(0.04, 0.08, 0.15, (-1.0,)),
        "thermocouple_bias": Sizes(25, 50, 120),
        "slow_thermocouple": Sizes(3, 6, 12, (1.0,)),
    }
    return Case(
        "furnace",
        FILE,
        truth,
        sizes,
        through={"slow_thermocouple": 2},
        told_as={"slow_thermocouple": ("unknown", 1.0)},
    )


def truth(rng: np.random.Generator) -> Truth:
    chamber, wall, conducted, radiated, outside, leak, power = scattered(
        rng, (CHAMBER, WALL, CONDUCTED, RADIATED, OUTSIDE, LEAK, POWER), SPREAD
    )
    error = float(ERROR * rng.standard_normal())

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States T, W [degC], P [W], S [degC]; d: mains, room [degC], late."""
        hot, lining, heating, seen = x
        inwards = conducted * (hot - lining)
        inwards += radiated * ((hot + KELVIN) ** 4 - (lining + KELVIN) ** 4)
        return (
            (heating - inwards - leak * (hot - d[1])) / chamber,
            (inwards - outside * (lining - d[1])) / wall,
            (power * (1 + d[0]) ** 2 * u[0] / 100 - heating) / ELEMENT,
            (hot - seen) / (THERMOCOUPLE * (1 + d[2])),
        )

    wanted = ramps(levels(rng, SAMPLES, STEP, SOAKS, HOLD), RAMP * STEP)
    start, lining = wanted[0], 0.6 * wanted[0]
    summed = 35.0  # %

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed
        off = GAIN * (wanted[k] - y[k][0])
        u = off + summed
        if 0.0 < u < 100.0:
            summed += off * STEP / INTEGRAL
        return (min(max(u, 0.0), 100.0),)

    mains = coloured(rng, SAMPLES, STEP, (MAINS,), MAINS_TIME)
    room = rng.uniform(*ROOM) + coloured(rng, SAMPLES, STEP, (WANDER,), WANDER_TIME)
    hum = coloured(rng, SAMPLES, STEP, (HUM,), HUM_TIME)
    return Truth(
        rates=rates,
        states=("T", "W", "P", "S"),
        start=(start, lining, power * summed / 100, start),
        sensors=(lambda x, d: x[3] + error,),
        command=command,
        limits=((0.0, 100.0),),
        disturbances=np.hstack([mains, room, np.zeros((SAMPLES, 1))]),
        noise=white(rng, SAMPLES, (NOISE,)) + hum,
        quantum=(QUANTUM,),
        step=STEP,
        substeps=1,
    )
