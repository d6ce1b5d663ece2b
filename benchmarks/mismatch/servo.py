"""A position loop with a motor whose friction remembers where it came from (Dahl's model).

    dq = w,   dw = K u - b w - F + load,   dF = s w (1 - F sign(w)/Fc)

Dahl, "A Solid Friction Model" (1968): before it slides, the friction is a spring of hysteresis.
The file has Coulomb's friction as tanh(w/w0) and no memory. A PD controller works on the encoder.
A bias of the voltage is to the outputs what a load is, K times as large, and is told as one.
"""

from collections.abc import Sequence

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, moves, white

__all__ = ["servo"]

FILE = """
name = "servo"
[states]
q = { unit = "rad", derivative = "w" }
w = { unit = "rad/s", derivative = "K*u - b*w - Fc*tanh(w/w0)" }
[inputs]
u = { unit = "V", min = -12, max = 12, hold = "zero" }
[outputs]
position = { unit = "rad", value = "q" }
[parameters]
K = { value = 15, min = 0 }
b = { value = 1, min = 0 }
Fc = { value = 4, min = 0 }
w0 = { value = 0.2, unit = "rad/s", fixed = true }
[faults]
load = { enters = "state", target = "w", unit = "rad/s**2" }
encoder_offset = { enters = "output", target = "position", unit = "rad" }
amplifier_loss = { enters = "gain", target = "u" }
voltage_bias = { enters = "input", target = "u", unit = "V", monitor = "disabled" }
"""
STEP, SAMPLES = 0.01, 1500
GAIN, VISCOUS, COULOMB = 20.0, 1.5, 6.0  # rad/s^2/V, 1/s, rad/s^2
BREAKAWAY = 0.02  # rad
PROPORTIONAL, DERIVATIVE = 15.0, 1.0  # V/rad, V s/rad
COUNTS = 4096  # of the encoder, per revolution


def servo() -> Case:
    return Case(
        "servo",
        FILE,
        truth,
        {
            "load": Sizes(12, 24, 60),
            "encoder_offset": Sizes(0.1, 0.2, 0.5),
            "amplifier_loss": Sizes(0.1, 0.2, 0.8, (1.0,)),
            "voltage_bias": Sizes(0.6, 1.2, 3.0),
        },
        told_as={"voltage_bias": ("load", GAIN)},
    )


def rates(x: Vector, u: Vector, d: Vector) -> Vector:
    """States q, w and the friction F [rad/s^2]."""
    _, w, friction = x
    slid = 1 - friction / COULOMB * (1.0 if w >= 0 else -1.0)
    return w, GAIN * u[0] - VISCOUS * w - friction, COULOMB / BREAKAWAY * w * slid


def truth(rng: np.random.Generator) -> Truth:
    reference = moves(rng, SAMPLES, STEP, (-2.0, 2.0), (0.6, 2.0), rows=50, wave=0.5)  # rad
    speed = np.gradient(reference, STEP)

    def command(k: int, y: Sequence[Vector]) -> Vector:
        turning = (y[k][0] - y[k - 1][0]) / STEP if k else 0.0
        wanted = PROPORTIONAL * (reference[k] - y[k][0]) + DERIVATIVE * (speed[k] - turning)
        return (float(np.clip(wanted, -12.0, 12.0)),)

    return Truth(
        rates=rates,
        states=("q", "w", "F"),
        start=(float(reference[0]), 0.0, 0.0),
        sensors=(0,),
        command=command,
        limits=((-12.0, 12.0),),
        disturbances=np.zeros((SAMPLES, 1)),
        noise=white(rng, SAMPLES, (0.2 * 2 * np.pi / COUNTS,)),
        quantum=(2 * np.pi / COUNTS,),
        step=STEP,
        substeps=5,
    )
