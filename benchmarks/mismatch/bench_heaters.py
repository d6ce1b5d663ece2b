"""Two heaters and their thermometers on a board for teaching, for 50 minutes.

    Ch dH1 = Q (1 - sag)^2 p1 Q1 - (U (1 + draught) + V (H1 - Ta)) (H1 - Ta) + Uc (H2 - H1)
             - Ub (H1 - S1),   Cs dS1 = Ub (H1 - S1)

and the same for the other; what is measured is S1, by ten bits. That sensor and heater are two
lumps each, and their sizes, are of J. Kantor's notebooks about the Temperature Control Lab, from
memory. Losses grow with the temperature (V), the supply sags under both heaters' load, the air
moves, the constants are never twice the same and the room wanders. The file has two lumps, and a
room that moves slowly, as its writer knows. In contrast to `heaters`, logs begin nearly cold.
"""

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, scattered, white

__all__ = ["bench_heaters"]

FILE = """
name = "bench heaters"
[states]
T1 = { unit = "degC", derivative = "loss*(Ta - T1) + cross*(T2 - T1) + heat1*Q1" }
T2 = { unit = "degC", derivative = "loss*(Ta - T2) + cross*(T1 - T2) + heat2*Q2" }
[inputs]
Q1 = { unit = "%", min = 0, max = 100, hold = "zero" }
Q2 = { unit = "%", min = 0, max = 100, hold = "zero" }
[outputs]
sensor1 = { unit = "degC", value = "T1" }
sensor2 = { unit = "degC", value = "T2" }
[parameters]
loss = { value = 0.01, unit = "1/s", min = 0 }
cross = { value = 0.003, unit = "1/s", min = 0 }
heat1 = { value = 0.005, min = 0 }
heat2 = { value = 0.003, min = 0 }
Ta = { value = 22, unit = "degC", vary = "slow" }
[faults]
heater1_loss = { enters = "gain", target = "Q1" }
heater2_loss = { enters = "gain", target = "Q2" }
heater1_bias = { enters = "input", target = "Q1", unit = "%" }
heater2_bias = { enters = "input", target = "Q2", unit = "%" }
sensor1_bias = { enters = "output", target = "sensor1", unit = "K" }
sensor2_bias = { enters = "output", target = "sensor2", unit = "K" }
"""
STEP, SAMPLES = 1.0, 3000  # s; 50 min
HEATER, SENSOR = 5.5, 1.0  # J/K
LOSS, GROWS = 0.045, 1.5e-4  # W/K, W/K^2
BETWEEN, INSIDE = 0.02, 0.05  # W/K: from heater to heater, from heater to sensor
POWER = (0.032, 0.02)  # W/%
SAG = 0.006  # 1/W: the supply's voltage
SPREAD = 0.02  # of every constant, from run to run
ROOM, WANDER, WANDER_TIME = (20.0, 25.0), 0.7, 1200.0  # degC, K, s
DRAUGHT, DRAUGHT_TIME = 0.04, 90.0  # of the loss, s
WARM = 8.0  # K: what the last experiment has left at most
NOISE, HUM, HUM_TIME = 0.25, 0.1, 20.0  # K, K, s
QUANTUM = 3.3 / 1024 / 0.01  # K: ten bits of 3.3 V, 10 mV/K


def bench_heaters() -> Case:
    sizes = {
        "heater1_loss": Sizes(0.1, 0.2, 0.8, (1.0,)),
        "heater2_loss": Sizes(0.1, 0.2, 0.8, (1.0,)),
        "heater1_bias": Sizes(10, 20, 50),
        "heater2_bias": Sizes(10, 20, 50),
        "sensor1_bias": Sizes(4, 8, 20),
        "sensor2_bias": Sizes(3, 6, 15),
    }
    return Case("bench_heaters", FILE, truth, sizes)


def truth(rng: np.random.Generator) -> Truth:
    p1, p2, loss, grows, between, *lags = scattered(
        rng, (*POWER, LOSS, GROWS, BETWEEN, HEATER, HEATER, SENSOR, SENSOR), SPREAD
    )
    heater1, heater2, sensor1, sensor2 = lags
    drive = [levels(rng, SAMPLES, STEP, (0.0, 100.0), (180.0, 600.0)) for _ in POWER]
    room = rng.uniform(*ROOM) + coloured(rng, SAMPLES, STEP, (WANDER,), WANDER_TIME)
    air = coloured(rng, SAMPLES, STEP, (DRAUGHT,), DRAUGHT_TIME)
    warm = float(room[0, 0]) + float(rng.uniform(0.0, WARM))

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States H1, H2, S1, S2 [degC]; d: the room [degC], draught."""
        h1, h2, s1, s2 = x
        over1, over2 = h1 - d[0], h2 - d[0]
        share = (1 - SAG * (p1 * u[0] + p2 * u[1])) ** 2
        lost1 = (loss * (1 + d[1]) + grows * over1) * over1
        lost2 = (loss * (1 + d[1]) + grows * over2) * over2
        crossed, felt1, felt2 = between * (h2 - h1), INSIDE * (h1 - s1), INSIDE * (h2 - s2)
        return (
            (share * p1 * u[0] - lost1 + crossed - felt1) / heater1,
            (share * p2 * u[1] - lost2 - crossed - felt2) / heater2,
            felt1 / sensor1,
            felt2 / sensor2,
        )

    hum = coloured(rng, SAMPLES, STEP, (HUM, HUM), HUM_TIME)
    return Truth(
        rates=rates,
        states=("H1", "H2", "S1", "S2"),
        start=(warm, warm, warm, warm),
        sensors=(2, 3),
        command=lambda k, y: (drive[0][k], drive[1][k]),
        limits=((0.0, 100.0), (0.0, 100.0)),
        disturbances=np.hstack([room, air]),
        noise=white(rng, SAMPLES, (NOISE, NOISE)) + hum,
        quantum=(QUANTUM, QUANTUM),
        step=STEP,
        substeps=1,
    )
