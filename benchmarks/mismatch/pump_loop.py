"""A centrifugal pump that fills a vessel through a valve, and a level controller on the pump.

    lag dn = u/100 - n,   Q^2 (1 + clog) R = H n^2 + s - z - h  (0 where that is below 0)
    A dh = Q - c (1 + w) sqrt(h),   damped dF = Q - F

Q is the flow where the pump's quadratic curve meets the valve's and the lift z; a check valve keeps
it from running back. The suction pressure s and what is drawn below (w) wander, the water sloshes,
and the flowmeter (F) damps and shows 0 where what it reads, error included, is below its cut-off.
The constants differ from run to run. The file knows the curve, the lift and the vessel, not what
wanders; it has one lag for pump and meter. What is not declared is a valve that clogs.
"""

from collections.abc import Sequence

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, ramps, scattered, white

__all__ = ["pump_loop"]

FILE = """
name = "pump and vessel"
[states]
h = { unit = "m", derivative = "(q - c*sqrt(max(h, 0)))/area" }
q = { unit = "L/s", derivative = "(k*sqrt(max(head*(u/100)**2 - lift - h, 0)) - q)/lag" }
[inputs]
u = { unit = "%", min = 0, max = 100, hold = "zero" }
[outputs]
level = { unit = "m", value = "h" }
flow = { unit = "L/s", value = "q" }
[parameters]
area = { value = 400, fixed = true }
lift = { value = 4, unit = "m", fixed = true }
head = { value = 16, unit = "m", min = 5 }
k = { value = 0.5, min = 0.01 }
c = { value = 1, min = 0 }
lag = { value = 3, unit = "s", min = 0.5 }
[faults]
leak = { enters = "state", target = "h", unit = "m/s", max = 0 }
pump_loss = { enters = "gain", target = "u" }
level_bias = { enters = "output", target = "level", unit = "m" }
flow_bias = { enters = "output", target = "flow", unit = "L/s" }
"""
STEP, SAMPLES = 1.0, 3000  # s; 50 min
AREA, DRAWN = 400.0, 0.9  # L/m, L/s/m^0.5
HEAD, LIFT, VALVE = 18.0, 4.0, 2.5  # m, m, m s^2/L^2
LAG, DAMPED, CUT_OFF = 2.5, 2.0, 0.06  # s, s, L/s
SPREAD = 0.015  # of every constant, from run to run
SUCTION, SUCTION_TIME = 0.2, 200.0  # m, s
DEMAND, DEMAND_TIME = 0.03, 120.0  # of what is drawn, s
NOISE, SLOSH, SLOSH_TIME = (0.003, 0.015), (0.004, 0.015), 4.0  # (m, L/s) twice, s
QUANTUM = (0.002, 0.01)  # m, L/s
LEVELS, HOLD, RAMP = (0.6, 1.6), (200.0, 600.0), 1.8e-3  # m, s, m/s
GAIN, INTEGRAL = 150.0, 300.0  # %/m, s


def pump_loop() -> Case:
    sizes = {
        "leak": Sizes(3e-4, 6e-4, 1.2e-3, (-1.0,)),
        "pump_loss": Sizes(0.1, 0.2, 0.25, (1.0,)),
        "level_bias": Sizes(0.1, 0.2, 0.4),
        "flow_bias": Sizes(0.15, 0.3, 0.8),
        "clogging": Sizes(0.8, 1.6, 3.0, (1.0,)),
    }
    return Case(
        "pump_loop",
        FILE,
        truth,
        sizes,
        through={"clogging": 2, "flow_bias": 3},
        told_as={"clogging": ("unknown", 1.0)},
    )


def seen(x: Vector, d: Vector) -> float:
    """What the meter shows [L/s]."""
    shown = x[2] + d[3]
    return shown if shown > CUT_OFF else 0.0


def truth(rng: np.random.Generator) -> Truth:
    head, valve, drawn, lag, damped = scattered(rng, (HEAD, VALVE, DRAWN, LAG, DAMPED), SPREAD)

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States h [m], n, F [L/s]; d: suction [m], demand, clog, the meter's error."""
        h, n, shown = x
        over = head * n * n + d[0] - LIFT - h
        flow = (max(over, 0.0) / (valve * (1 + d[2]))) ** 0.5
        out = drawn * (1 + d[1]) * max(h, 0.0) ** 0.5
        return (flow - out) / AREA, (u[0] / 100 - n) / lag, (flow - shown) / damped

    wanted = ramps(levels(rng, SAMPLES, STEP, LEVELS, HOLD), RAMP * STEP)
    summed = 65.0  # %

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed
        off = GAIN * (wanted[k] - y[k][0])
        u = off + summed
        if 0.0 < u < 100.0:
            summed += off * STEP / INTEGRAL
        return (min(max(u, 0.0), 100.0),)

    suction = coloured(rng, SAMPLES, STEP, (SUCTION,), SUCTION_TIME)
    demand = coloured(rng, SAMPLES, STEP, (DEMAND,), DEMAND_TIME)
    errors = white(rng, SAMPLES, NOISE) + coloured(rng, SAMPLES, STEP, SLOSH, SLOSH_TIME)
    still = np.zeros(SAMPLES)
    return Truth(
        rates=rates,
        states=("h", "n", "F"),
        start=(float(wanted[0]), summed / 100, 1.0),
        sensors=(0, seen),
        command=command,
        limits=((0.0, 100.0),),
        disturbances=np.column_stack([suction, demand, still, errors[:, 1]]),
        noise=np.column_stack([errors[:, 0], still]),
        quantum=QUANTUM,
        step=STEP,
        substeps=4,
    )
