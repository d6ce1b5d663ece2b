"""How an error outside the training range is counted, and the networks without their edges."""

from dataclasses import replace

import equinox as eqx
import numpy as np
from jaxtyping import Float

from faultgauge.excitation import Experiment, Sweep
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.network import Network
from faultgauge_studies.paper.cases import SUSTAINED
from faultgauge_studies.paper.claims.lemma1_limit import binned
from faultgauge_studies.paper.excited import SWEEP
from faultgauge_studies.paper.learning import rms

__all__ = [
    "ACCURATE",
    "EDGES",
    "LIMITED",
    "LIMIT_BINDS",
    "WIDER",
    "errors",
    "outside",
    "slope",
    "sweep_to",
    "unbounded",
]

LIMITED, LIMIT_BINDS = 200.0, 211.0  # N*m*s: the torque-speed limit binds from 210.5 on
EDGES = np.arange(0.0, 251.0, 10.0)  # N*m*s beyond the envelope
ACCURATE = 0.1 * SUSTAINED.size  # N*m: an error passes into an estimate whole; a tenth of 0.1 N*m
WIDER = 50.0  # N*m*s outside: as far as the widest sweep leaves room below the limit
REACH = 20.0  # times the training range that an unbounded network may reach


def errors(
    error: Float[np.ndarray, "points"],
    h: Float[np.ndarray, "points"],
    away: Float[np.ndarray, "points"],
) -> dict[str, float]:
    """Inside, 50 N*m*s outside, beyond the torque-speed limit, and how far it is good."""
    known = (away > 0) & (np.abs(h) <= LIMITED)
    by_distance = binned(away[known], error[known], EDGES)
    centre = (EDGES[1:] + EDGES[:-1]) / 2
    there = np.isfinite(by_distance)
    bad = EDGES[:-1][there & ~(by_distance <= ACCURATE)]
    return {
        "inside_rms": rms(error[away <= 0]),
        "inside_largest": float(np.abs(error[away <= 0]).max()),
        "outside_50": float(np.interp(WIDER, centre[there], by_distance[there])),
        "growth": slope(away[known], np.abs(error[known])),
        "good_to": float(bad[0]) if bad.size else np.inf,
        "beyond_limit": rms(error[np.abs(h) > LIMIT_BINDS]),
    }


def sweep_to(amplitude: float, seconds: float) -> Experiment:
    """The paper's experiment with another reach, N*m*s."""
    sweep = Sweep("hm", gain=0.03, amplitude=amplitude, cycles=1)
    return replace(SWEEP, seconds=seconds, sweep=sweep)


def outside(h: Float[np.ndarray, "points"], low: float, high: float) -> Float[np.ndarray, "points"]:
    """How far beyond [low, high], N*m*s; 0 inside."""
    return np.maximum(np.maximum(low - h, h - high), 0.0)


def slope(x: Float[np.ndarray, "points"], y: Float[np.ndarray, "points"]) -> float:
    """Least squares of y = a x."""
    return float(x @ y / (x @ x))


def unbounded(plant: GrayBoxPlant) -> GrayBoxPlant:
    """The same networks as eq (3) has them, without the edge value (up to 20 times the range)."""

    def widened(network: Network) -> Network:
        return eqx.tree_at(
            lambda n: (n.input_scale, n.weights_in),
            network,
            (network.input_scale * REACH, network.weights_in * REACH),
        )

    networks = {name: widened(network) for name, network in plant.networks.items()}
    return GrayBoxPlant(plant.signals, plant.spec, networks, plant.parameters)
