"""A counterflow heat exchanger, water to water; a PI controller opens the hot valve.

    M/3 dH_j = m (H_j-1 - H_j) - UA/3cp (H_j - C_j)         j = 1 to 3, H_0 the hot inlet
    M/3 dC_j = mc (C_j+1 - C_j) + UA/3cp (H_j - C_j)        C_4 the cold inlet
    dv = (u - v)/lag,  m = (1 + s) Mh v,  1/UA = 1/(Ah (m/m0)^0.8) + 1/Ac

H_3 and C_1 leave and are measured, the hot inlet too. The supply s and both inlets wander, and UA
differs from log to log. The file has one lump a side, driven by the means of inlet and outlet, a
constant UA, no lag, and a constant cold inlet. It does not declare a leak from C_3 to H_3: the
hot water leaves colder and the cold, being less, hotter; of the declared faults none does both.
Exponent: Dittus and Boelter (1930). The other figures are of no particular exchanger.
"""

from collections.abc import Sequence

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, white

__all__ = ["exchanger"]

FILE = """
name = "heat exchanger"
[states.Th]
unit = "degC"
derivative = "(flow*u*(Thi - Th) - UA/4186*((Thi + Th)/2 - (Tci + Tc)/2))/Mh"
[states.Tc]
unit = "degC"
derivative = "(cold*(Tci - Tc) + UA/4186*((Thi + Th)/2 - (Tci + Tc)/2))/Mc"
[inputs]
u = { min = 0, max = 1, hold = "zero" }
Thi = { unit = "degC", hold = "linear" }
[outputs]
hot_out = { unit = "degC", value = "Th" }
cold_out = { unit = "degC", value = "Tc" }
[parameters]
flow = { value = 0.4, unit = "kg/s", min = 0.01 }
cold = { value = 0.3, unit = "kg/s", fixed = true }
Tci = { value = 15, unit = "degC", fixed = true }
UA = { value = 600, unit = "W/K", min = 10 }
Mh = { value = 5, unit = "kg", min = 0.1 }
Mc = { value = 5, unit = "kg", min = 0.1 }
[faults]
fouling = { enters = "parameter", target = "UA", relative = true, min = -0.9, max = 0 }
valve_bias = { enters = "input", target = "u" }
hot_flow_loss = { enters = "gain", target = "u", min = 0, max = 0.9 }
hot_sensor = { enters = "output", target = "hot_out", unit = "degC" }
cold_sensor = { enters = "output", target = "cold_out", unit = "degC" }
cold_inlet = { enters = "parameter", target = "Tci", unit = "degC", min = -15, max = 30 }
"""
STEP, SAMPLES = 1.0, 2000
HELD, CELLS = 6.0, 3  # kg of water a side
HOT_FLOW, COLD_FLOW = 0.7, 0.3  # kg/s, the hot one of an open valve
HEAT = 4186.0  # J/kg/K
HOT_FILM, COLD_FILM, RATED = 1700.0, 1900.0, 0.25  # W/K, W/K, kg/s of the hot film
VALVE = 4.0  # s
HOT_INLET, COLD_INLET = 70.0, 15.0  # degC
SUPPLY, SUPPLY_TIME = 0.01, 100.0  # of the hot flow, s
WANDER, WANDER_TIME = (1.5, 0.2), 400.0  # K of the hot and cold inlet, s
SPREAD = 0.01  # of UA, from log to log
NOISE, QUANTUM = 0.05, 0.1  # K
GAIN, INTEGRAL = 0.02, 40.0  # 1/K, s


def exchanger() -> Case:
    return Case(
        "exchanger",
        FILE,
        truth,
        {
            "fouling": Sizes(0.15, 0.3, 0.4, (-1.0,)),
            "valve_bias": Sizes(0.06, 0.12, 0.25),
            "hot_flow_loss": Sizes(0.1, 0.2, 0.4, (1.0,)),
            "hot_sensor": Sizes(1.5, 3.0, 6.0),
            "cold_sensor": Sizes(1.2, 2.4, 5.0),
            "cold_inlet": Sizes(1.5, 3.0, 6.0),
            "leak": Sizes(0.02, 0.04, 0.08, (1.0,)),  # kg/s
        },
        through={"cold_inlet": 1, "fouling": 3, "leak": 4},
        told_as={"leak": ("unknown", 1.0)},
    )


def rates(x: Vector, u: Vector, d: Vector) -> Vector:
    """States H1 to H3, C1 to C3 [degC] and the valve; d: both inlets, supply, fouling, leak."""
    h1, h2, h3, c1, c2, c3, valve = x
    hot_in, cold_in, supply, fouling, leak = d
    m = max((1 + supply) * HOT_FLOW * valve, 1e-3)
    film = HOT_FILM * (m / RATED) ** 0.8
    k = (1 + fouling) * film * COLD_FILM / (film + COLD_FILM) / CELLS / HEAT
    w = CELLS / HELD
    q1, q2, q3 = k * (h1 - c1), k * (h2 - c2), k * (h3 - c3)
    return (
        w * (m * (hot_in - h1) - q1),
        w * (m * (h1 - h2) - q2),
        w * (m * (h2 - h3) + leak * (c3 - h3) - q3),
        w * ((COLD_FLOW - leak) * (c2 - c1) + q1),
        w * ((COLD_FLOW - leak) * (c3 - c2) + q2),
        w * (COLD_FLOW * (cold_in - c3) + q3),
        (u[0] - valve) / VALVE,
    )


def truth(rng: np.random.Generator) -> Truth:
    wanted = levels(rng, SAMPLES, STEP, (30.0, 40.0), (100.0, 300.0))
    inlets = coloured(rng, SAMPLES, STEP, WANDER, WANDER_TIME)
    inlets += np.array((HOT_INLET, COLD_INLET))
    supply = coloured(rng, SAMPLES, STEP, (SUPPLY,), SUPPLY_TIME)
    fouling, leak = np.full((SAMPLES, 1), SPREAD * rng.standard_normal()), np.zeros((SAMPLES, 1))
    seen = inlets[:, 0] + white(rng, SAMPLES, (NOISE,))[:, 0]
    thermometer = (np.round(seen / QUANTUM) * QUANTUM).tolist()
    summed = 0.4  # of the valve

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed
        off = wanted[k] - y[k][1]
        u = GAIN * off + summed
        if 0.0 < u < 1.0:
            summed += GAIN * off * STEP / INTEGRAL
        return min(max(u, 0.0), 1.0), thermometer[k]

    return Truth(
        rates=rates,
        states=("H1", "H2", "H3", "C1", "C2", "C3", "valve"),
        start=(61.0, 52.0, 44.0, 36.0, 29.0, 22.0, 0.4),
        sensors=(2, 3),
        command=command,
        limits=((0.0, 1.0), (0.0, 100.0)),
        disturbances=np.hstack([inlets, supply, fouling, leak]),
        noise=white(rng, SAMPLES, (NOISE, NOISE)),
        quantum=(QUANTUM, QUANTUM),
        step=STEP,
        substeps=1,
    )
