"""Lemma 1 holds up to a horizon T: how the error of a free run really grows with it."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.excitation import Experiment, Sweep
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge_studies.paper.bench import Bench, Traces
from faultgauge_studies.paper.claims.learned import medians, rates, replay, unseen
from faultgauge_studies.paper.excited import SWEEP
from faultgauge_studies.paper.tables import Results

__all__ = ["cycles", "gronwall", "horizon_verdict", "measure_horizon", "steepest"]

HORIZONS = (1, 3, 10, 30, 100, 300, 1000, 3000, 4000)  # s
CYCLES = 4  # of the sweep, in the record of the horizon
STEADY = 2.0  # times the error of the first cycle after four: a steady drift would give 4


def cycles(times: int) -> Experiment:
    """The experiment, `times` as long with as many triangles."""
    sweep = Sweep("hm", gain=0.03, amplitude=150.0, cycles=times)
    return replace(SWEEP, seconds=times * SWEEP.seconds, sweep=sweep)


def measure_horizon(bench: Bench, plant: GrayBoxPlant) -> tuple[dict[str, Any], Traces]:
    """The largest errors of a free run up to each horizon, and what Gronwall's lemma allows."""
    log = unseen(bench.wheel, cycles(CYCLES), bench.seed, ())
    h, u = log.columns["hm"], log.columns["u"]
    free = replay(plant, log)
    drift, error = np.abs(free.x[:, 0] - h), np.abs(free.y[:, 0] - log.columns["T"])
    epsilon = float(np.abs(rates(plant, h, u) - log.columns["d_h"]).max())
    lipschitz = steepest(bench.wheel, h, u)
    last = [min(t, len(log.t) - 1) + 1 for t in HORIZONS]  # 1 Hz
    figures = {
        "seconds": list(HORIZONS),
        "momentum": [float(drift[:k].max()) for k in last],
        "torque": [float(error[:k].max()) for k in last],
        "bound": [gronwall(epsilon, lipschitz, float(t)) for t in HORIZONS],
        "lipschitz": lipschitz,
        "epsilon": epsilon,
    }
    return figures, {"lemma1_horizon": {"t": log.t, "momentum": drift, "torque": error}}


def gronwall(epsilon: float, lipschitz: float, t: float) -> float:
    """epsilon (exp(L t) - 1)/L: how far |F - g1| <= epsilon may drive two solutions apart."""
    with np.errstate(over="ignore"):
        return float(epsilon * np.expm1(lipschitz * t) / lipschitz)


def steepest(
    wheel: GrayBoxPlant, h: Float[np.ndarray, "points"], u: Float[np.ndarray, "points"]
) -> float:
    """The largest |dF/dh| [1/s] at the points and, where friction is steepest, at h = 0."""
    at = jnp.asarray(np.append(h, 0.0)[:, None]), jnp.asarray(np.append(u, 0.0)[:, None])
    return float(jnp.abs(jax.jit(jax.vmap(jax.jacfwd(wheel.derivative)))(*at)).max())


def horizon_verdict(found: Results) -> str:
    """How the error grows with T, beside the bound that a proof by Gronwall would give."""
    momentum, bound = medians(found["momentum"]), medians(found["bound"])
    seconds = found["seconds"]
    first, last = seconds.index(1000), len(seconds) - 1
    growth = momentum[last] / momentum[first]
    steady = growth <= STEADY
    word = "does not grow" if steady else "grows"
    damped = (
        "; friction damps what a run has drifted, which the lemma does not count" if steady else ""
    )
    kept = "stays below" if np.all(momentum <= bound) else "does not stay below"
    return (
        f"The horizon: from T = {seconds[first]} s to {seconds[last]} s the largest error of "
        f"momentum goes from {momentum[first]:.3g} to {momentum[last]:.3g} N·m·s ({growth:.3g} "
        f"times): it {word} with T as a drift would (4 times). It {kept} Gronwall's bound, which "
        f"allows {bound[seconds.index(100)]:.3g} N·m·s at 100 s and soon says nothing{damped}."
    )
