"""Two coupled heaters, as on the Arduino lab kit of Hedengren, and a file without radiation.

    C dT1 = U A (Ta - T1) + U As (T2 - T1) + e s A (Ta^4 - T1^4) + e s As (T2^4 - T1^4) + a1 Q1
    ts dS1 = T1 - S1

T in K there, and the same for the other; what is measured is S, a sensor's own temperature. The
file has neither radiation nor sensor, and one temperature of the room, which wanders.
"""

from functools import partial

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, white

__all__ = ["biased", "equal", "heaters"]

FILE = """
name = "two heaters"
[states]
T1 = { unit = "degC", derivative = "k*(Ta - T1) + c*(T2 - T1) + a1*Q1" }
T2 = { unit = "degC", derivative = "k*(Ta - T2) + c*(T1 - T2) + a2*Q2" }
[inputs]
Q1 = { unit = "%", min = 0, max = 100, hold = "zero" }
Q2 = { unit = "%", min = 0, max = 100, hold = "zero" }
[outputs]
S1 = { unit = "degC", value = "T1" }
S2 = { unit = "degC", value = "T2" }
[parameters]
k = { value = 0.005, min = 0 }
c = { value = 0.001, min = 0 }
a1 = { value = 0.005, min = 0 }
a2 = { value = 0.004, min = 0 }
Ta = { value = 23 }
[faults]
heater1_bias = { enters = "input", target = "Q1", unit = "%" }
heater2_bias = { enters = "input", target = "Q2", unit = "%" }
heater1_loss = { enters = "gain", target = "Q1" }
heater2_loss = { enters = "gain", target = "Q2" }
sensor1_bias = { enters = "output", target = "S1", unit = "K" }
sensor2_bias = { enters = "output", target = "S2", unit = "K" }
"""
SIZES = {
    "heater1_bias": Sizes(10, 20, 50),
    "heater2_bias": Sizes(10, 20, 50),
    "heater1_loss": Sizes(0.1, 0.2, 0.8, (1.0,)),
    "heater2_loss": Sizes(0.1, 0.2, 0.8, (1.0,)),
    "sensor1_bias": Sizes(4, 8, 25),
    "sensor2_bias": Sizes(4, 8, 25),
}
STEP, SAMPLES = 4.0, 750  # s; 50 min
CAPACITY = 2.0  # J/K: 4 g of 500 J/(kg K)
LOSS, BETWEEN = 0.01, 0.002  # W/K: 10 W/(m^2 K) on 10 cm^2, and on 2 cm^2 to the other
RADIATED, EXCHANGED = 0.9 * 5.67e-8 * 1e-3, 0.9 * 5.67e-8 * 2e-4  # W/K^4
POWER = (0.01, 0.0075)  # W/%
SENSOR = (18.0, 12.0)  # s
ROOM, WANDER, WANDER_TIME = 23.0, 1.0, 900.0  # degC, K, s
NOISE, QUANTUM = 0.1, 0.3  # K
KELVIN = 273.15


def heaters() -> Case:
    return Case("heaters", FILE, partial(truth, exact=False), SIZES, pairs=True)


def biased() -> Case:
    """The same, of which a bias of every heater and sensor is declared, and no loss."""
    file = "".join(line for line in FILE.splitlines(keepends=True) if '"gain"' not in line)
    sizes = {name: each for name, each in SIZES.items() if name.endswith("bias")}
    return Case("biased", file, partial(truth, exact=False), sizes, pairs=True)


def equal() -> Case:
    """The same rig without anything that the file lacks."""
    return Case("equal", FILE, partial(truth, exact=True), SIZES, pairs=True)


def rates(x: Vector, u: Vector, d: Vector) -> Vector:
    """States T1, T2, S1, S2 [degC]; d: the room's temperature [degC]."""
    one, two, s1, s2 = x
    a, b, room = (value + KELVIN for value in (one, two, d[0]))
    crossed = BETWEEN * (b - a) + EXCHANGED * (b**4 - a**4)
    lost1 = LOSS * (a - room) + RADIATED * (a**4 - room**4)
    lost2 = LOSS * (b - room) + RADIATED * (b**4 - room**4)
    return (
        (POWER[0] * u[0] - lost1 + crossed) / CAPACITY,
        (POWER[1] * u[1] - lost2 - crossed) / CAPACITY,
        (one - s1) / SENSOR[0],
        (two - s2) / SENSOR[1],
    )


def linear_rates(x: Vector, u: Vector, d: Vector) -> Vector:
    """As the plant file has it: states T1, T2 [degC]."""
    one, two = x
    crossed = BETWEEN * (two - one)
    return (
        (POWER[0] * u[0] - LOSS * (one - d[0]) + crossed) / CAPACITY,
        (POWER[1] * u[1] - LOSS * (two - d[0]) - crossed) / CAPACITY,
    )


def truth(rng: np.random.Generator, exact: bool) -> Truth:
    drive = [levels(rng, SAMPLES, STEP, (0.0, 100.0), (160.0, 480.0)) for _ in POWER]
    wander = coloured(rng, SAMPLES, STEP, [0.0 if exact else WANDER], WANDER_TIME)
    warm = (ROOM + float(rng.uniform(5, 25)), ROOM + float(rng.uniform(5, 25)))
    return Truth(
        rates=linear_rates if exact else rates,
        states=("T1", "T2") if exact else ("T1", "T2", "S1", "S2"),
        start=warm if exact else warm + warm,
        sensors=(0, 1) if exact else (2, 3),
        command=lambda k, y: (drive[0][k], drive[1][k]),
        limits=((0.0, 100.0), (0.0, 100.0)),
        disturbances=ROOM + wander,
        noise=white(rng, SAMPLES, (NOISE, NOISE)),
        quantum=(0.0, 0.0) if exact else (QUANTUM, QUANTUM),
        step=STEP,
        substeps=4,
    )
