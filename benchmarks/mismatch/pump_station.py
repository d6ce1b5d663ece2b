"""A waste-water pump station: a sump, a pump on a drive, an air vessel, a valve and a long line.

    A (1 + slope (h - 1.5)) dh = I - Q,    vessel dp = 1.2 (p + 101) (Q - q - L (p/300)^0.5)
    inertia dq = p - b - R (1 + f) q^1.85 - (q/kv)^2,    kv = KV e^(RR (s - 1)) (1 + wave sin 6s)
    H m^2.05 + 0.9 r - 0.06 r^2 = p - 9.81 h,    r = Q / (m (1 + w)),    m = n (1 - slip Q n)
    drive dn = u - n,    ds = +- travel beyond play,    lag_j dz_j = y_j - z_j

The sensors of level, pressure and flow (z) are damped, the speed is that of the motor, which slips
under load. Inflow I and the basin b wander within half an hour, and the constants, the mean inflow
and the basin differ from log to log. The file has a parabola for the pump, friction of the square,
an isothermal vessel, and neither lags nor play; the inflow drifts in it, and the basin is another
one in each run. Every 10 s, for 3.3 h. A PI controller keeps the level; the valve is moved by hand.
The figures are of no particular station.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, scattered, white

__all__ = ["pump_station"]

FILE = """
name = "pump station"
[terms]
head = "H0*n_cmd**2 + 9.81*level - p"
q_pump = "k_pump*sqrt(max(head, 0))"
valve_loss = "q*abs(q)/(kv*exp(rr*(valve - 1)))**2"
[states]
level = { unit = "m", derivative = "(demand - q_pump)/(1000*area)", min = 0, max = 3 }
p = { unit = "kPa", derivative = "(q_pump - q - leak*sqrt(max(p, 0)/300))/C" }
q = { unit = "L/s", derivative = "(p - p_static - R*q*abs(q) - valve_loss)/inertia" }
[inputs]
n_cmd = { unit = "1", min = 0, max = 1 }
valve = { unit = "1", min = 0, max = 1 }
[outputs]
level = { unit = "m", value = "level" }
speed = { unit = "rpm", value = "rated*n_cmd" }
pressure = { unit = "kPa", value = "p" }
flow = { unit = "L/s", value = "q" }
[parameters]
demand = { value = 35, unit = "L/s", min = 0, max = 90, vary = "slow" }
area = { value = 12, unit = "m**2", min = 9, max = 16 }
H0 = { value = 600, unit = "kPa", min = 450, max = 750 }
k_pump = { value = 3.8, unit = "L/s/kPa**0.5", min = 1, max = 10 }
rated = { value = 1480, unit = "rpm", min = 1300, max = 1600 }
C = { value = 8, unit = "L/kPa", min = 1, max = 40 }
p_static = { value = 120, unit = "kPa", min = 60, max = 180, vary = "run" }
R = { value = 0.05, unit = "kPa*s**2/L**2", min = 0.005, max = 0.3 }
kv = { value = 16, unit = "L/s/kPa**0.5", min = 4, max = 60 }
rr = { value = 3, unit = "1", min = 1, max = 5 }
inertia = { value = 110, unit = "kPa*s**2/L", min = 20, max = 400 }
leak = { value = 0, unit = "L/s", fixed = true }
[faults]
level_bias = { enters = "output", target = "level", unit = "m", min = -0.6, max = 0.6 }
pressure_bias = { enters = "output", target = "pressure", unit = "kPa", min = -100, max = 100 }
flow_gain = { enters = "output_gain", target = "flow", min = -0.4, max = 0.4 }
valve_bias = { enters = "input", target = "valve", unit = "1", min = -0.3, max = 0.3 }
drive_slip = { enters = "gain", target = "n_cmd", min = -0.1, max = 0.4 }
pump_loss = { enters = "parameter", target = "k_pump", relative = true, min = -0.6, max = 0.2 }
leak = { enters = "parameter", target = "leak", unit = "L/s", min = 0, max = 20 }
fouling = { enters = "parameter", target = "R", relative = true, min = -0.3, max = 2 }
"""
STEP, SAMPLES = 10.0, 1200  # s
SUBSTEPS = 20  # the fastest is the motor of the valve, within a second
AREA, SLOPE = 12.0, 0.07  # m^2, 1/m
HEAD, VESSEL = 600.0, 4000.0  # kPa, L of air at 300 kPa
FRICTION, VALVE, TRIM, WAVE = 0.086, 17.0, 2.6, 0.05  # kPa s^1.85/L^1.85, L/s/kPa^0.5, 1, 1
INERTIA, BASIN, BASIN_SPREAD = 112.0, 120.0, 4.0  # kPa s^2/L, kPa twice
RATED, SLIP = 1492.0, 4.2e-4  # rpm, s/L
DRIVE, TRAVEL, PLAY = 6.0, 0.012, 0.012  # s, 1/s, 1
LAGS = (25.0, 15.0, 19.0)  # s, of level, pressure and flow
SPREAD = 0.02  # of the constants, from log to log
INFLOW, WANDER, WANDER_TIME = (31.0, 41.0), 2.0, 900.0  # L/s twice, s
BASIN_WANDER, BASIN_TIME = 1.5, 1500.0  # kPa, s
NOISE, QUANTUM = (0.002, 0.8, 0.7, 0.25), (0.005, 1.0, 0.5, 0.1)  # m, rpm, kPa, L/s
LEVELS, LEVEL_HOLD = (1.1, 1.95), (1300.0, 2800.0)  # m, s
OPENINGS, OPENING_HOLD = (0.42, 0.92), (700.0, 1900.0)  # 1, s
GAIN, INTEGRAL, SLOWEST, BEGUN = 0.42, 1500.0, 0.55, 0.8  # 1/m, s, 1, 1
AIR = 101.3  # kPa


def pump_station() -> Case:
    sizes = {
        "level_bias": Sizes(0.1, 0.2, 0.5),
        "pressure_bias": Sizes(10, 30, 90),
        "flow_gain": Sizes(0.06, 0.12, 0.35),
        "valve_bias": Sizes(0.08, 0.15, 0.3),
        "drive_slip": Sizes(0.04, 0.08, 0.2, (1.0,)),
        "pump_loss": Sizes(0.12, 0.2, 0.5, (-1.0,)),
        "leak": Sizes(3, 6, 15, (1.0,)),
        "fouling": Sizes(0.2, 0.4, 1.5, (1.0,)),
    }
    through = {"pump_loss": 2, "leak": 3, "fouling": 4}
    return Case("pump_station", FILE, truth, sizes, through=through)


def truth(rng: np.random.Generator) -> Truth:
    own = AREA, HEAD, VESSEL, FRICTION, VALVE, DRIVE, *LAGS
    area, head, vessel, friction, valve, drive, *lags = scattered(rng, own, SPREAD)

    def pumped(h: float, n: float, p: float, w: float) -> float:
        """Flow of the pump [L/s], 0 behind its check valve; its slip by what it last pumped,
        about."""
        m, flow = n, 0.0
        for _ in range(2):
            left = 0.81 + 0.24 * (head - (p - 9.81 * h) / m**2.05)
            flow = m * (1 + w) * (0.9 + left**0.5) / 0.12 if left > 0.81 else 0.0
            m = n * (1 - SLIP * flow * n)
        return flow

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States h, n, s, p, q, and what is shown of h, p, q; d: inflow, basin [kPa], share of the
        pump's flow, leak [L/s], share of friction."""
        h, n, s, p, q = x[:5]
        flow, off = pumped(h, n, p, d[2]), u[1] - s
        held = min(max(abs(off) - PLAY / 2, 0.0), TRAVEL)  # within a second, where it is near
        air = vessel * ((300 + AIR) / (p + AIR)) ** (1 / 1.2)
        kv = valve * math.exp(TRIM * (s - 1)) * (1 + WAVE * math.sin(6 * s))
        lost = friction * (1 + d[4]) * abs(q) ** 1.85 + (q / kv) ** 2
        return (
            (d[0] - flow) / (1000 * area * (1 + SLOPE * (h - 1.5))),
            (u[0] - n) / drive,
            held if off > 0 else -held,
            1.2 * (p + AIR) / air * (flow - q - d[3] * (max(p, 0.0) / 300) ** 0.5),
            (p - d[1] - (lost if q > 0 else -lost)) / INERTIA,
            (h - x[5]) / lags[0],
            (p - x[6]) / lags[1],
            (q - x[7]) / lags[2],
        )

    def turns(x: Vector, d: Vector) -> float:
        return RATED * x[1] * (1 - SLIP * pumped(x[0], x[1], x[3], d[2]) * x[1])

    wanted = levels(rng, SAMPLES, STEP, LEVELS, LEVEL_HOLD)
    opened = levels(rng, SAMPLES, STEP, OPENINGS, OPENING_HOLD)
    mean = rng.uniform(*INFLOW)
    inflow = mean + coloured(rng, SAMPLES, STEP, (WANDER,), WANDER_TIME)
    basin = BASIN + BASIN_SPREAD * rng.standard_normal()
    basin = basin + coloured(rng, SAMPLES, STEP, (BASIN_WANDER,), BASIN_TIME)
    level, still = float(wanted[0]), np.zeros((SAMPLES, 3))
    return Truth(
        rates=rates,
        states=("h", "n", "s", "p", "q", "shown_h", "shown_p", "shown_q"),
        start=(level, BEGUN, float(opened[0]), 260.0, mean, level, 260.0, mean),
        sensors=(5, turns, 6, 7),
        command=level_loop(wanted, opened),
        limits=((0.0, 1.0), (0.0, 1.0)),
        disturbances=np.column_stack([inflow, basin, still]),
        noise=white(rng, SAMPLES, NOISE),
        quantum=QUANTUM,
        step=STEP,
        substeps=SUBSTEPS,
    )


def level_loop(
    wanted: Float[np.ndarray, "samples"], opened: Float[np.ndarray, "samples"]
) -> Callable[[int, Sequence[Vector]], Vector]:
    """The commands of the pump, by a PI controller of the level, and of the valve, by hand."""
    summed = BEGUN

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed
        off = y[k][0] - wanted[k]
        u = summed + GAIN * off
        if SLOWEST < u < 1.0:
            summed += GAIN * off * STEP / INTEGRAL
        return min(max(u, SLOWEST), 1.0), float(opened[k])

    return command
