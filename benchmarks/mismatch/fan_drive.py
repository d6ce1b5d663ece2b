"""A fan on a permanent-magnet motor in a speed loop, its speed in coarse steps.

    dv = (u - v) / lag,    L di = v - R (1 + a th) i - k w,    dth = (heat R i^2 - th) / warms
    J dw = k i - sgn(w) (Fc + Fs exp(-(w/ws)^2)) - b w - fan w |w|,    dsw = (w - sw) / filter

and so for the current's filter. The file has the amplifier's lag, friction that is viscous and
Coulomb's, and a current without inductance: no fan, no warming winding, no filters, no steps.
Who wrote it had read the README alone; it was then a case to develop on.
"""

from collections.abc import Sequence

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, white

__all__ = ["fan_drive"]

FILE = """
name = "fan drive"
[states]
w = { unit = "rad/s", derivative = "(k*(v - k*w)/R - b*w - c)/J" }
v = { unit = "V", derivative = "(u - v)/ta" }
[inputs]
u = { unit = "V", min = 0, max = 24, hold = "zero" }
[outputs]
current = { unit = "A", value = "(v - k*w)/R" }
speed = { unit = "rad/s", value = "w" }
[parameters]
ta = { value = 0.03, unit = "s", min = 0.003, max = 0.2 }
k = { value = 0.1, unit = "V*s", min = 0.02, max = 0.5 }
R = { value = 0.8, unit = "ohm", min = 0.1, max = 5 }
b = { value = 0.002, unit = "N*m*s", min = 0 }
c = { value = 0.02, unit = "N*m" }
J = { value = 0.005, unit = "kg*m**2", min = 0.0005, max = 0.1 }
[faults]
load = { enters = "state", target = "w", unit = "rad/s**2", min = -100, max = 100 }
gain_loss = { enters = "gain", target = "u", min = -0.1, max = 0.8 }
tacho = { enters = "output", target = "speed", unit = "rad/s", min = -30, max = 30 }
"""
STEP, SAMPLES = 0.01, 5400  # s; 54 s
RESISTANCE, INDUCTANCE, CONSTANT, INERTIA = 0.8, 0.003, 0.1, 0.005  # ohm, H, V s, kg m^2
FAN, COULOMB, STRIBECK, VISCOUS = 2e-5, 0.03, 0.02, 2e-4
SLOW = 5.0  # rad/s, within which Stribeck's part falls
AMPLIFIER, SPEED_FILTER, CURRENT_FILTER = 0.015, 0.02, 0.005  # s
WARMS, HEAT, COPPER = 40.0, 1.0, 0.0039  # s, K/W, 1/K
SPREAD, WIDEST = 0.015, 0.03  # of the constants, from run to run
NOISE, QUANTUM = (0.05, 0.1), (0.02, 0.5)  # A, rad/s
GAIN, INTEGRAL = 0.2, 0.00875  # V s/rad, and per sample


def fan_drive() -> Case:
    sizes = {
        "load": Sizes(10, 28, 60, (-1.0,)),
        "gain_loss": Sizes(0.05, 0.2, 0.5, (1.0,)),
        "tacho": Sizes(3, 12, 30),
    }
    return Case("fan_drive", FILE, truth, sizes)


def truth(rng: np.random.Generator) -> Truth:
    off = 1 + np.clip(rng.normal(0.0, SPREAD, 8), -WIDEST, WIDEST)
    usual = (RESISTANCE, INDUCTANCE, CONSTANT, INERTIA, FAN, COULOMB, STRIBECK, VISCOUS)
    resistance, inductance, constant, inertia, fan, coulomb, stribeck, viscous = off * usual
    speeds = rng.uniform(50.0, 140.0, int(STEP * SAMPLES / 4) + 2)
    phase = rng.uniform(0.0, 2 * np.pi, 2)

    def wanted(t: float) -> float:
        at = int(t // 4)
        before = speeds[at - 1] if at else speeds[0]
        now = before + (speeds[at] - before) * min((t - 4 * at) / 0.6, 1.0)
        return float(
            now
            + 4 * np.sin(2 * np.pi * 0.45 * t + phase[0])
            + 2 * np.sin(2 * np.pi * 1.3 * t + phase[1])
        )

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States v [V], i [A], w [rad/s], th [K], and w and i as filtered."""
        v, i, w, warm, sw, si = x
        hot = resistance * (1 + COPPER * warm)
        dry = coulomb + stribeck * float(np.exp(-((w / SLOW) ** 2)))
        rubs = float(np.sign(w)) * dry + viscous * w + fan * w * abs(w)
        return (
            (u[0] - v) / AMPLIFIER,
            (v - hot * i - constant * w) / inductance,
            (constant * i - rubs) / inertia,
            (HEAT * hot * i * i - warm) / WARMS,
            (w - sw) / SPEED_FILTER,
            (i - si) / CURRENT_FILTER,
        )

    start = wanted(0.0)
    summed = 0.1 * start + 2.0

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed
        off = wanted(STEP * k) - y[k][1]
        summed = min(max(summed + INTEGRAL * off, -24.0), 24.0)
        return (min(max(summed + GAIN * off, 0.0), 24.0),)

    return Truth(
        rates=rates,
        states=("v", "i", "w", "th", "sw", "si"),
        start=(14.0, 2.0, start, float(rng.uniform(0.0, 10.0)), start, 2.0),
        sensors=(5, 4),
        command=command,
        limits=((0.0, 24.0),),
        disturbances=np.zeros((SAMPLES, 1)),
        noise=white(rng, SAMPLES, NOISE),
        quantum=QUANTUM,
        step=STEP,
        substeps=16,
    )
