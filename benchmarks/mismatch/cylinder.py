"""A hydraulic cylinder that a servo valve positions, with a spring and a wandering load on it.

    dx = v,   dv = (A p - B v - S x - W - w - F(v)) / m + load
    F(v) = (Fc + (Fs - Fc) exp(-(v/vs)^2)) sgn v
    dp = E (K y sqrt((P - p sgn y) / P0) - A v - (1 + leakage) C p),   dy = (u - y) / lag

Merritt, "Hydraulic Control Systems" (1967): p is the pressure across the piston, P = P0 (1 - drop)
the supply's, y the spool's place. The file has a flow in proportion to the command, Coulomb's
friction, and no spool; so it lacks the root, Stribeck's friction, the lag and the load's wander. A
P controller with the reference's speed works on the position. What is not declared is a drop of
the supply.
"""

from collections.abc import Sequence
from math import exp, tanh

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, moves, white

__all__ = ["cylinder"]

FILE = """
name = "cylinder"
[states]
x = { unit = "m", derivative = "v", exact = true }
v = { unit = "m/s", derivative = "push*p - b*v - spring*x - weight - Fc*tanh(v/v0)" }
p = { unit = "bar", derivative = "flow*u - squeeze*v - leak*p" }
[inputs]
u = { unit = "V", min = -10, max = 10, hold = "zero" }
[outputs]
position = { unit = "m", value = "x" }
pressure = { unit = "bar", value = "p" }
[parameters]
push = { value = 0.25, min = 0 }
b = { value = 3, min = 0 }
spring = { value = 30, min = 0 }
weight = { value = 0 }
Fc = { value = 1, min = 0 }
v0 = { value = 0.01, unit = "m/s", fixed = true }
flow = { value = 800, min = 0 }
squeeze = { value = 15000, min = 0 }
leak = { value = 10, min = 0 }
[faults]
load = { enters = "state", target = "v", unit = "m/s**2" }
null_bias = { enters = "input", target = "u", unit = "V" }
position_bias = { enters = "output", target = "position", unit = "m" }
pressure_bias = { enters = "output", target = "pressure", unit = "bar" }
leakage = { enters = "parameter", target = "leak", relative = true, min = -0.9, max = 10 }
"""
STEP, SAMPLES = 0.01, 2000  # s; 20 s
MASS, AREA = 500.0, 100.0  # kg, N/bar (10 cm^2)
VISCOUS, SPRING, WEIGHT = 2500.0, 20000.0, 500.0  # N s/m, N/m, N
COULOMB, STATIC = 600.0, 900.0  # N
STRIBECK, TURNING = 0.02, 0.004  # m/s; the second rounds off the sign of the speed
STIFFNESS = 1.9e7  # bar/m^3: 4 x 0.7 GPa on 1.5 l
VALVE, LAG = 5e-5, 0.012  # m^3/s/V, s
LEAK = 8e-7  # m^3/s/bar
SUPPLY = 140.0  # bar
WANDER, WANDER_TIME = 200.0, 2.0  # N, s
NOISE, QUANTUM = (3e-5, 0.4), (2e-5, 0.1)  # m, bar
PROPORTIONAL, FORWARD = 120.0, 20.0  # V/m, V s/m


def cylinder() -> Case:
    sizes = {
        "load": Sizes(2, 4, 8),
        "null_bias": Sizes(0.5, 1.0, 3.0),
        "position_bias": Sizes(0.03, 0.06, 0.15),
        "pressure_bias": Sizes(8, 16, 50),
        "leakage": Sizes(1, 2, 6, (1.0,)),
        "supply_drop": Sizes(0.2, 0.4, 0.5, (1.0,)),
    }
    return Case(
        "cylinder",
        FILE,
        truth,
        sizes,
        through={"leakage": 1, "supply_drop": 2},
        told_as={"supply_drop": ("unknown", 1.0)},
    )


def rates(x: Vector, u: Vector, d: Vector) -> Vector:
    """States x [m], v [m/s], p [bar] and the spool y [V]; d: the load [N], leakage and drop."""
    at, v, p, y = x
    load, leakage, drop = d
    rubs = COULOMB + (STATIC - COULOMB) * exp(-((v / STRIBECK) ** 2))
    force = AREA * p - VISCOUS * v - SPRING * at - WEIGHT - load - rubs * tanh(v / TURNING)
    over = SUPPLY * (1 - drop) - (p if y >= 0 else -p)
    through = VALVE * y * max(over / SUPPLY, 0.0) ** 0.5
    leaked = (1 + leakage) * LEAK * p
    return v, force / MASS, STIFFNESS * (through - AREA * 1e-5 * v - leaked), (u[0] - y) / LAG


def truth(rng: np.random.Generator) -> Truth:
    reference = moves(rng, SAMPLES, STEP, (-0.15, 0.15), (1.0, 2.5), rows=90, wave=0.02)  # m
    speed = np.gradient(reference, STEP)

    def command(k: int, y: Sequence[Vector]) -> Vector:
        wanted = PROPORTIONAL * (reference[k] - y[k][0]) + FORWARD * speed[k]
        return (float(np.clip(wanted, -10.0, 10.0)),)

    start = float(reference[0])
    load = coloured(rng, SAMPLES, STEP, (WANDER,), WANDER_TIME)
    return Truth(
        rates=rates,
        states=("x", "v", "p", "y"),
        start=(start, 0.0, (SPRING * start + WEIGHT) / AREA, 0.0),
        sensors=(0, 2),
        command=command,
        limits=((-10.0, 10.0),),
        disturbances=np.hstack([load, np.zeros((SAMPLES, 2))]),
        noise=white(rng, SAMPLES, NOISE),
        quantum=QUANTUM,
        step=STEP,
        substeps=8,
    )
