"""A small chill store: a fan coil cools air, goods store, and the compressor's speed is controlled.

    Cc dTc = heat (Ta - Tc) + vapour - Q - melts
    Ca dTa = (loss + door) (To - Ta) + fan's heat - heat (Ta - Tc) - k (Ta - Ts)
    Cs dTs = k (Ta - Ts) - inner (Ts - Ti),   Ci dTi = inner (Ts - Ti),   lag ds = compressor - s
    Q = P (1 + a Tc) / (1 + a P / R),   P = Qn s (1 - c (To - 25)),   heat = K fan^0.6 / (1 + m/m0)

with k = keep (1 + fan)/2. Suction gas gets thin as it evaporates colder, Q/R below the coil; a warm
condenser takes some. Vapour freezes on a coil below 0 degC, and insulates it until it melts: every
5 h the compressor stands for 20 min. By day the door opens. Coil, air and goods are lumps, as in
models of refrigerated display cases. The file has a capacity straight in the speed, one lump of
goods, k constant, another power of the fan; no frost, vapour, condenser, door, lags or contact of
sensors.
"""

from collections.abc import Sequence

import numpy as np

from mismatch.case import Case, Sizes
from mismatch.truth import Truth, Vector, coloured, levels, scattered, white

__all__ = ["cold_room"]

FILE = """
name = "cold room"
[terms]
cooling = "Q*compressor*(1 + rise*coil)"
blown = "UA*fan**0.8*(air - coil)"
stored = "keep*(air - goods)"
leaks = "(loss + ajar)*(ambient - air)"
[states]
coil = { unit = "degC", derivative = "(blown - cooling)/C_coil" }
air = { unit = "degC", derivative = "(fan_heat*fan**3 + leaks - blown - stored)/C_air" }
goods = { unit = "degC", derivative = "stored/C_goods" }
[inputs]
compressor = { min = 0, max = 1, hold = "zero" }
fan = { min = 0.4, max = 1, hold = "zero" }
ambient = { unit = "degC", hold = "linear" }
[outputs]
coil_probe = { unit = "degC", value = "coil" }
air_probe = { unit = "degC", value = "air" }
goods_probe = { unit = "degC", value = "goods" }
[parameters]
Q = { unit = "W", value = 1750, fixed = true }
rise = { unit = "1/K", value = 0.03, min = 0, max = 0.08 }
UA = { unit = "W/K", value = 110, min = 20, max = 500 }
C_coil = { unit = "J/K", value = 1.5e4, min = 3e3, max = 1e5 }
C_air = { unit = "J/K", value = 1.2e5, min = 3e4, max = 6e5 }
C_goods = { unit = "J/K", value = 9e5, min = 2e5, max = 5e6 }
keep = { unit = "W/K", value = 80, min = 10, max = 400 }
loss = { unit = "W/K", value = 24, min = 5, max = 80 }
fan_heat = { unit = "W", value = 90, fixed = true }
ajar = { unit = "W/K", value = 0, fixed = true }
[faults]
compressor_loss = { enters = "gain", target = "compressor", min = 0, max = 0.8 }
coil_icing = { enters = "parameter", target = "UA", relative = true, min = -0.9, max = 0 }
door_ajar = { enters = "parameter", target = "ajar", unit = "W/K", min = 0, max = 100 }
goods_heat = { enters = "state", target = "goods", unit = "K/s", min = 0, max = 8e-4 }
air_bias = { enters = "output", target = "air_probe", unit = "K", min = -4, max = 4 }
coil_bias = { enters = "output", target = "coil_probe", unit = "K", min = -8, max = 8 }
"""
STEP, SAMPLES, EVERY, DEFROST = 20.0, 3600, 18000.0, 1200.0  # s; 20 h a log
POWER, DENSER, UNDER, CONDENSER = 1900.0, 0.035, 400.0, 0.007  # W, 1/K, W/K, 1/K
FANNED, LOSS, KEEP, INNER = 130.0, 35.0, 110.0, 250.0  # W/K: at full fan; skin to core
COIL, AIR, SKIN, CORE, FAN = 2e4, 1.5e5, 2e5, 5e5, 90.0  # J/K; W
MOIST, BELOW, VAPOUR, ICE = 0.12, 2.0, 2.83e6, 3.34e5  # share; K: dew point; J/kg, J/kg
FROST, THIN, MELTS = 8.0, 0.1, 600.0  # kg that double the coil's resistance, kg, W/K
LAG, PROBE, TOUCH = 40.0, 50.0, 0.06  # s, s; share of air in what the coil's probe shows
AMBIENT, SWING, WEATHER, ERRS, WANDERS = (20.0, 23.0), 2.5, 0.5, 0.2, 3600.0  # degC, K, K, K, s
DOOR, ROWS, OPENED, DAY = (20.0, 80.0), 2, 3.0, 12.0  # W/K, open for so long, per h, h
NOISE, QUANTUM, SPREAD = (0.08, 0.05, 0.04), (0.1, 0.1, 0.1), 0.015  # K; share, from run to run
GAIN, INTEGRAL, LEAST, STARTS = 0.25, 1200.0, 0.15, 0.2  # 1/K, s, speeds


def cold_room() -> Case:
    sizes = {
        "compressor_loss": Sizes(0.12, 0.25, 0.5, (1.0,)),
        "coil_icing": Sizes(0.2, 0.35, 0.6, (-1.0,)),
        "door_ajar": Sizes(8.0, 16.0, 40.0, (1.0,)),
        "goods_heat": Sizes(1e-4, 2e-4, 4e-4, (1.0,)),
        "air_bias": Sizes(0.6, 1.2, 2.5),
        "coil_bias": Sizes(1.0, 2.0, 5.0),
    }
    through = {"door_ajar": 1, "coil_icing": 2, "goods_heat": 3}
    return Case("cold_room", FILE, truth, sizes, through=through)


def truth(rng: np.random.Generator) -> Truth:
    power, fanned, loss, keep = scattered(rng, (POWER, FANNED, LOSS, KEEP), SPREAD)

    def rates(x: Vector, u: Vector, d: Vector) -> Vector:
        """States coil, air, goods' skin and core [degC], speed, frost [kg], air's thermometer.

        d: ambient [degC], door [W/K], change of the coil's heat transfer as a share, goods [K/s].
        """
        coil, air, skin, core, speed, frost, seen = x
        heat = fanned * (1 + d[2]) * u[1] ** 0.6 / (1 + frost / FROST)
        given, vapour = heat * (air - coil), MOIST * heat * max(air - BELOW - coil, 0.0)
        melts = MELTS * max(coil, 0.0) * frost / (frost + THIN)
        full = power * speed * (1 - CONDENSER * (d[0] - 25))
        cooling = full * (1 + DENSER * coil) / (1 + DENSER * full / UNDER)
        stored, inwards = keep * (0.5 + 0.5 * u[1]) * (air - skin), INNER * (skin - core)
        warms = (loss + d[1]) * (d[0] - air) + FAN * u[1] ** 3
        return (
            (given + vapour - cooling - melts) / COIL,
            (warms - given - stored) / AIR,
            (stored - inwards) / SKIN + d[3],
            inwards / CORE + d[3],
            (u[0] - speed) / LAG,
            vapour * min(max(-2 * coil, 0.0), 1.0) / VAPOUR - melts / ICE,
            (air - seen) / PROBE,
        )

    t = STEP * np.arange(SAMPLES)
    wanted = levels(rng, SAMPLES, STEP, (1.5, 6.5), (7200.0, 16200.0))
    blows = levels(rng, SAMPLES, STEP, (0.6, 1.0), (3600.0, 9000.0))
    defrosts = ((t + rng.uniform(0, EVERY)) % EVERY < DEFROST).tolist()
    hour = (rng.uniform(0, 24) + t / 3600) % 24
    opens = (hour < DAY) & (rng.random(SAMPLES) < OPENED * STEP / 3600)
    door = np.convolve(opens * rng.uniform(*DOOR, SAMPLES), np.ones(ROWS))[:SAMPLES]
    wander = coloured(rng, SAMPLES, STEP, (WEATHER, ERRS), WANDERS).T
    ambient = rng.uniform(*AMBIENT) + SWING * np.sin(2 * np.pi * (hour - 2) / 24) + wander[0]
    shown = np.round(ambient + wander[1], 1).tolist()
    still, summed, runs = np.zeros(SAMPLES), 0.5, True

    def command(k: int, y: Sequence[Vector]) -> Vector:
        nonlocal summed, runs
        if defrosts[k]:
            return 0.0, 1.0, shown[k]
        off = GAIN * (y[k][1] - wanted[k])
        speed = off + summed
        if 0.0 < speed < 1.0 or off * (speed - 0.5) < 0:
            summed += off * STEP / INTEGRAL
        runs = speed > (LEAST if runs else STARTS)
        return min(max(speed, LEAST), 1.0) if runs else 0.0, blows[k], shown[k]

    return Truth(
        rates=rates,
        states=("coil", "air", "goods", "core", "speed", "frost", "seen"),
        start=(wanted[0] - 6, wanted[0], wanted[0] + 0.5, wanted[0] + 0.5, 0.5, 0.3, wanted[0]),
        sensors=(lambda x, d: x[0] + TOUCH * (x[1] - x[0]), 6, lambda x, d: (x[2] + x[3]) / 2),
        command=command,
        limits=((0.0, 1.0), (0.4, 1.0), (-50.0, 60.0)),
        disturbances=np.column_stack((ambient, door, still, still)),
        noise=white(rng, SAMPLES, NOISE),
        quantum=QUANTUM,
        step=STEP,
        substeps=4,
    )
