"""A lithium-ion cell under the current of a drive, from 85 % of its charge to about 45 %.

    dz = -i/Q,  dv_n = (s R_n a i - v_n)/tau_n (n = 1, 2),  dh = -g |i|/Q (h + sign i)
    Cc dTc = heat - (Tc - Ts)/Rc,  Cs dTs = (Tc - Ts)/Rc - k (Ts - Ta)
    V = ocv(z) + M h - v_1 - v_2 - r R_0 a i,  a = exp(B/Tc - B/T0)

The heat is i (v_1 + v_2 + r R_0 a i). Q and r differ from log to log, the cooling k wanders; faults
raise r and lower k. The file has an ocv of second order, one pair, one temperature, resistances
that do not depend on it, the nominal Q and no hysteresis. It does not declare that the diffusion
gets worse: s, by which a pulse sags more, but not at once as with r.

ocv, time constants and, a third as large for a cell three times as large, resistances: Chen and
Rincon-Mora, "Accurate electrical battery model capable of predicting runtime and I-V performance"
(2006), from memory. Hysteresis: Plett's one-state model (2004). The rest is assumed.
"""

from collections.abc import Sequence
from math import exp

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, white

__all__ = ["battery"]

FILE = """
name = "lithium-ion cell"
[states]
z = { derivative = "-i/Q", initial = 0.85 }
v = { unit = "V", derivative = "(R1*i - v)/tau" }
T = { unit = "degC", derivative = "(i*(R0*i + v) - k*(T - Ta))/C" }
[inputs]
i = { unit = "A", hold = "zero" }
Ta = { unit = "degC", hold = "linear" }
[outputs]
voltage = { unit = "V", value = "e0 + e1*z + e2*z**2 - R0*i - v" }
surface = { unit = "degC", value = "T" }
[parameters]
Q = { value = 9000, unit = "A*s", fixed = true }
e0 = { value = 3.685, unit = "V", fixed = true }
e1 = { value = 0.2, unit = "V" }
e2 = { value = 0.2, unit = "V" }
R0 = { value = 0.02, unit = "ohm", min = 0.001 }
R1 = { value = 0.02, unit = "ohm", min = 0.001 }
tau = { value = 60, unit = "s", min = 1 }
k = { value = 0.15, unit = "W/K", min = 0.01 }
C = { value = 60, unit = "J/K", min = 1 }
[faults]
current_bias = { enters = "input", target = "i", unit = "A" }
voltage_bias = { enters = "output", target = "voltage", unit = "V" }
thermometer_bias = { enters = "output", target = "surface", unit = "degC" }
resistance = { enters = "parameter", target = "R0", relative = true, min = 0, max = 3 }
cooling = { enters = "parameter", target = "k", relative = true, min = -0.9, max = 0 }
"""
STEP, SAMPLES = 1.0, 2400
CAPACITY, SPREAD = 9000.0, 0.01  # A s; of it and of the resistance, from log to log
SERIES, PAIRS = 0.025, ((0.016, 33.0), (0.017, 223.0))  # ohm, (ohm, s)
ACTIVATION, WARM = 2400.0, 298.15  # K, of the resistances; K, where they are as above
HYSTERESIS, MEMORY = 0.008, 40.0  # V, 1
CORE, SURFACE, INNER, COOLING = 62.7, 4.5, 1.94, 0.2  # J/K, J/K, K/W, W/K
KELVIN, AMBIENT = 273.15, 25.0  # degC
WANDER, WANDER_TIME = (0.2, 0.03), 300.0  # (K of the ambient, of the cooling), s
CURRENT, DRAWN, HOLD = (-12.0, 12.0), (1.2, 2.0), (3.0, 20.0)  # A about the mean, A mean, s
NOISE, QUANTUM = (0.001, 0.05), (0.001, 0.1)  # V, K


def battery() -> Case:
    return Case(
        "battery",
        FILE,
        truth,
        {
            "current_bias": Sizes(0.4, 0.8, 1.2),
            "voltage_bias": Sizes(0.04, 0.08, 0.3),
            "thermometer_bias": Sizes(1.0, 2.0, 5.0),
            "resistance": Sizes(0.2, 0.4, 1.5, (1.0,)),
            "cooling": Sizes(0.2, 0.4, 0.8, (-1.0,)),
            "diffusion": Sizes(0.4, 0.8, 2.0, (1.0,)),
        },
        through={"current_bias": 0, "cooling": 2, "resistance": 3, "diffusion": 4},
        told_as={"diffusion": ("unknown", 1.0)},
    )


def ocv(z: float) -> float:
    return -1.031 * exp(-35 * z) + 3.685 + 0.2156 * z - 0.1178 * z**2 + 0.3201 * z**3


def voltage(x: Vector, d: Vector) -> float:
    z, v1, v2, h, core, _ = x
    current, _, _, rise, _ = d
    return ocv(z) + HYSTERESIS * h - v1 - v2 - (1 + rise) * SERIES * warming(core) * current


def warming(core: float) -> float:
    """By how many times the resistances are those at 25 degC."""
    return exp(ACTIVATION / (core + KELVIN) - ACTIVATION / WARM)


def truth(rng: np.random.Generator) -> Truth:
    profile = np.array(levels(rng, SAMPLES, STEP, CURRENT, HOLD))
    profile += rng.uniform(*DRAWN) - profile.mean()
    ambient, cooling = coloured(rng, SAMPLES, STEP, WANDER, WANDER_TIME).T
    capacity, resistance = (1.0, 0.0) + SPREAD * rng.standard_normal(2)
    columns = (profile, AMBIENT + ambient, cooling, np.full(SAMPLES, resistance), np.zeros(SAMPLES))
    seen = AMBIENT + ambient + white(rng, SAMPLES, NOISE[1:])[:, 0]
    recorded = np.column_stack([profile, np.round(seen / QUANTUM[1]) * QUANTUM[1]]).tolist()
    charge, settled = CAPACITY * float(capacity), float(rng.uniform(-1.0, 1.0))

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States z, v1, v2, h, Tc and Ts [degC]; d: current, ambient, cooling, resistance,
        diffusion. The voltage sees d's current, so this is the real one, and u is its record."""
        _, v1, v2, h, core, surface = x
        i, ambient, cooling, rise, slower = d
        a = warming(core)
        heat = i * (v1 + v2 + (1 + rise) * SERIES * a * i)
        inwards = (core - surface) / INNER
        (r1, tau1), (r2, tau2) = PAIRS
        return (
            -i / charge,
            ((1 + slower) * r1 * a * i - v1) / tau1,
            ((1 + slower) * r2 * a * i - v2) / tau2,
            -MEMORY * abs(i) / charge * (h + (1.0 if i > 0 else -1.0)),
            (heat - inwards) / CORE,
            (inwards - (1 + cooling) * COOLING * (surface - ambient)) / SURFACE,
        )

    def command(k: int, y: Sequence[Vector]) -> Vector:
        return tuple(recorded[k])

    return Truth(
        rates=rates,
        states=("z", "v1", "v2", "h", "Tc", "Ts"),
        start=(float(rng.uniform(0.8, 0.9)), 0.0, 0.0, settled, AMBIENT, AMBIENT),
        sensors=(voltage, 5),
        command=command,
        limits=((-100.0, 100.0), (-50.0, 100.0)),
        disturbances=np.column_stack(columns),
        noise=white(rng, SAMPLES, NOISE),
        quantum=QUANTUM,
        step=STEP,
        substeps=1,
    )
