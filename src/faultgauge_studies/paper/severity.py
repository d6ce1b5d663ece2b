"""What the residual says of a fault's size (eq 9 and below), and which channel sees which fault."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant
from faultgauge.simulation.satellite.loop import Telemetry
from faultgauge.simulation.satellite.observatory import PERIOD, run
from faultgauge.simulation.schedules import Constant, Schedule
from faultgauge_studies.paper.cases import ONSET, SECONDS, Case
from faultgauge_studies.paper.learning import PITCH, beside

__all__ = ["SIZES", "channels_at", "growth", "jumps", "mean", "output_offset", "severities"]

SIZES = (0.02, 0.05, 0.1, 0.15, 0.2)  # N*m
LATER = 100.0  # s
SPAN = 20.0  # s, of every mean: two thirds of a period of f(t)


def torque_residual(plant: Plant, flown: Telemetry) -> Float[np.ndarray, "samples"]:
    """r = T - That against the free-running reference, N*m."""
    return np.asarray(flown.torque[:, PITCH]) - beside(plant, flown).y[:, 0]


def severities(
    wheel: GrayBoxPlant, plant: Plant, seed: int, inner: Sequence[Schedule]
) -> dict[float, Float[np.ndarray, "samples"]]:
    """m2(d, t): the residual after an input fault of each size from 500 s on."""
    found = {}
    for size in SIZES:
        fault = Schedule("d", "input", "u", Constant(size, ONSET), unit="N*m")
        flown = run(wheel, SECONDS, seed, inner, {"pitch": [fault]})
        found[size] = torque_residual(plant, flown)
    return found


def output_offset(
    wheel: GrayBoxPlant, plant: Plant, seed: int, inner: Sequence[Schedule], size: float
) -> Float[np.ndarray, "samples"]:
    """r for an offset of `size` on the torque output from 500 s on: r = m1(d1) = d1."""
    fault = Schedule("d", "output", "T", Constant(size, ONSET), unit="N*m")
    return torque_residual(plant, run(wheel, SECONDS, seed, inner, {"pitch": [fault]}))


def jumps(case: Case, r: Float[np.ndarray, "samples"]) -> dict[str, float]:
    """How far the residual jumps between the samples around each jump of the fault, N*m."""
    return {f"{t:g}s": float(r[_at(t)] - r[_at(t) - 1]) for t in case.jumps}


def mean(r: Float[np.ndarray, "samples"], start: float) -> float:
    """Mean over the 20 s from `start` [s] on."""
    return float(r[_at(start) : _at(start + SPAN)].mean())


def growth(r: Float[np.ndarray, "samples"]) -> float:
    """|r| 100 s after the onset over |r| at the onset, each a mean over 20 s."""
    return abs(mean(r, ONSET + LATER - SPAN / 2)) / abs(mean(r, ONSET))


def channels_at(channels: Mapping[str, Float[np.ndarray, "samples"]]) -> dict[str, float]:
    """What each channel shows 100 s after the onset: mean over 20 s less that before it."""
    return {
        name: mean(x, ONSET + LATER - SPAN / 2) - mean(x, ONSET - SPAN)
        for name, x in channels.items()
    }


def _at(t: float) -> int:
    return round(t / PERIOD)
