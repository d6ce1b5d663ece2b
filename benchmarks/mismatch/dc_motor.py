"""A DC motor with a gearbox in a speed loop: what warms, cogs and rubs, and a supply that sags.

    L di = (1 + supply) u - drop tanh(i/i0) - R (1 + a (Tw - T0)) i - k w
    J dw = k i - b w - (Fc + (Fs - Fc) exp(-(w/ws)^2)) tanh(w/w0) - cog sin(12 q) - gear sin(q/N)
           - churn,   dq = w,   Cw dTw = R (1 + a (Tw - T0)) i^2 - (Tw - Th)/Rw
    lag dic = i - ic,   lag dwc = w - wc

k is (1 - m (Tw - T0)) of the cold motor's. Current and speed are measured behind filters (ic, wc);
the speed comes of an encoder's counts. The churning of the gearbox' grease wanders and the
constants differ from run to run. The file is that of every textbook, with Coulomb's friction as
tanh: it has none of the temperatures, brushes, teeth, filters and Stribeck's friction.
"""

from collections.abc import Sequence
from math import exp, sin, tanh

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, moves, scattered, white

__all__ = ["dc_motor"]

FILE = """
name = "DC motor"
[states]
i = { unit = "A", derivative = "(u - R*i - k*w)/L" }
w = { unit = "rad/s", derivative = "(k*i - b*w - Fc*tanh(w/w0))/J" }
[inputs]
u = { unit = "V", min = -24, max = 24, hold = "zero" }
[outputs]
current = { unit = "A", value = "i" }
speed = { unit = "rad/s", value = "w" }
[parameters]
R = { value = 1.5, unit = "ohm", min = 0.1 }
L = { value = 0.01, unit = "H", min = 0.001 }
k = { value = 0.1, min = 0.01 }
b = { value = 1e-4, min = 0 }
Fc = { value = 0.02, unit = "N*m", min = 0 }
J = { value = 2e-4, min = 1e-5 }
w0 = { value = 1, unit = "rad/s", fixed = true }
[faults]
load = { enters = "state", target = "w", unit = "rad/s**2" }
supply_loss = { enters = "gain", target = "u" }
encoder_scale = { enters = "output_gain", target = "speed" }
current_bias = { enters = "output", target = "current", unit = "A" }
"""
STEP, SAMPLES = 0.01, 4000  # s; 40 s
RESISTANCE, INDUCTANCE, TORQUE, INERTIA = 1.6, 0.012, 0.12, 2.2e-4  # ohm, H, N m/A, kg m^2
VISCOUS, COULOMB, STATIC = 1.5e-4, 0.03, 0.045  # N m s, N m, N m
STRIBECK, TURNING = 8.0, 0.8  # rad/s; the second rounds off the sign of the speed
DROP, CONDUCTS = 0.6, 0.15  # V, A: of the brushes
COGGING, TEETH, GEAR, RATIO = 0.006, 12, 0.004, 14  # N m, per turn, N m, 1
COPPER, MAGNET, COLD = 0.0039, 0.001, 25.0  # 1/K, 1/K, degC
WINDING, PATH = 8.0, 5.0  # J/K, K/W
HOUSING = (20.0, 40.0)  # degC
FILTER = (0.003, 0.006)  # s: current, speed
SUPPLY, SUPPLY_TIME = 0.01, 3.0  # of the voltage, s
CHURN, CHURN_TIME = 0.003, 0.5  # N m, s
SPREAD = 0.02  # of every constant, from run to run
NOISE, QUANTUM = (0.03, 0.25), (0.01, 2 * np.pi / 4000 / STEP)  # A, rad/s
SPEEDS = (-120.0, 120.0)  # rad/s
PROPORTIONAL, INTEGRAL = 0.12, 0.08  # V s/rad, s


def dc_motor() -> Case:
    sizes = {
        "load": Sizes(150, 300, 700),
        "supply_loss": Sizes(0.1, 0.2, 0.3, (1.0,)),
        "encoder_scale": Sizes(0.1, 0.2, 0.3, (1.0,)),
        "current_bias": Sizes(0.2, 0.4, 1.5),
    }
    return Case("dc_motor", FILE, truth, sizes)


def truth(rng: np.random.Generator) -> Truth:
    resistance, inductance, torque, inertia, viscous, coulomb, static = scattered(
        rng, (RESISTANCE, INDUCTANCE, TORQUE, INERTIA, VISCOUS, COULOMB, STATIC), SPREAD
    )
    housing = float(rng.uniform(*HOUSING))

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States i [A], w [rad/s], q [rad], winding [degC], the filters; d: supply, churn [N m]."""
        i, w, q, winding, seen_i, seen_w = x
        warmer = winding - COLD
        ohms, k = resistance * (1 + COPPER * warmer), torque * (1 - MAGNET * warmer)
        rubs = (coulomb + (static - coulomb) * exp(-((w / STRIBECK) ** 2))) * tanh(w / TURNING)
        teeth = COGGING * sin(TEETH * q) + GEAR * sin(q / RATIO)
        driven = (1 + d[0]) * u[0] - DROP * tanh(i / CONDUCTS)
        return (
            (driven - ohms * i - k * w) / inductance,
            (k * i - viscous * w - rubs - teeth - d[1]) / inertia,
            w,
            (ohms * i * i - (winding - housing) / PATH) / WINDING,
            (i - seen_i) / FILTER[0],
            (w - seen_w) / FILTER[1],
        )

    reference = moves(rng, SAMPLES, STEP, SPEEDS, (0.8, 2.5), rows=40, wave=8.0)
    summed = TORQUE * float(reference[0])

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed
        off = reference[k] - y[k][1]
        u = PROPORTIONAL * off + summed
        if abs(u) < 24.0:
            summed += PROPORTIONAL * off * STEP / INTEGRAL
        return (float(np.clip(u, -24.0, 24.0)),)

    supply = coloured(rng, SAMPLES, STEP, (SUPPLY,), SUPPLY_TIME)
    churn = coloured(rng, SAMPLES, STEP, (CHURN,), CHURN_TIME)
    first = float(reference[0])
    return Truth(
        rates=rates,
        states=("i", "w", "q", "winding", "seen_i", "seen_w"),
        start=(0.3, first, float(rng.uniform(0.0, 2 * np.pi)), housing + 5.0, 0.3, first),
        sensors=(4, 5),
        command=command,
        limits=((-24.0, 24.0),),
        disturbances=np.hstack([supply, churn]),
        noise=white(rng, SAMPLES, NOISE),
        quantum=QUANTUM,
        step=STEP,
        substeps=10,
    )
