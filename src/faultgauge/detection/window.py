"""A window of a log, and the posterior of every onset and cause in it.

In a window at most one fault begins and then stays constant. For a cause k and an onset at sample
n, with score r and information N of its size f ~ N(0, S^2) from `shocks`,

    ln p(y | k, n) - ln p(y | healthy) = (r^2 V - ln(1 + N S^2)) / 2,   V = 1 / (N + 1/S^2),
    f | k, n, y ~ N(r V, V),

times the mass of f within the fault's limits, posterior over prior; the prior of (k, n) is the
cause's onset rate times the step.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.special import log_ndtr

from faultgauge.detection.bank import FaultBank
from faultgauge.detection.course import AT_START
from faultgauge.detection.judged import pad_stretch, record_arrays
from faultgauge.detection.noise import spread_of_start
from faultgauge.detection.shocks import Record, Shocks, Sizes, shocks
from faultgauge.observers.sigma_point import Belief, Hypothesis
from faultgauge.plants.plant import Plant
from faultgauge.telemetry import Run

__all__ = ["Causes", "Window", "causes_in", "shocks_of", "window_of"]


class Window(NamedTuple):
    """The samples `part` of a run, its arrays padded to the length of a bucket."""

    plant: Plant
    noise: Hypothesis
    belief: Belief
    record: Record
    t: Float[np.ndarray, "samples"]
    part: slice


class Causes(NamedTuple):
    """ln of posterior weight (not normalised) of every onset and cause, declared ones first and
    then undeclared drives without and with a jump; mean and sd of a declared fault's size; the
    innovations as each declared fault is linearised, the last ones without any."""

    weight: Float[np.ndarray, "samples causes"]
    mean: Float[np.ndarray, "samples declared"]
    sd: Float[np.ndarray, "samples declared"]
    seen: tuple[Shocks, ...]


def window_of(
    bank: FaultBank,
    plant: Plant,
    run: Run,
    part: slice,
    believed: Bool[np.ndarray, "samples"],
    mean: Float[np.ndarray, "kept"],
    least: int = 0,
) -> Window:
    """The samples `part` of `run`, of which those are used that are `believed`; they start at
    about `mean` [states, drifting parameters]. Padded to the bucket of `least` samples or more."""
    model, levels = bank.model, bank.levels
    u, y = record_arrays(model, run, part)
    y[:, [n not in bank.outputs for n in model.plant.signals.output_names]] = np.nan
    y[~believed[part]] = np.nan
    u, y, dt = pad_stretch(u, y, run.t[part], least)
    # The first sample has found the start: it is not to be believed twice, least of all where
    # a sensor's bias may have been there already.
    nobody, drifted = spread_of_start(model, bank.noise, ())
    belief = Belief(jnp.asarray(mean), jnp.diag(jnp.asarray(np.append(nobody, drifted))))
    every = len(levels.size)
    noise = Hypothesis(
        jnp.zeros((every, 1)),
        jnp.asarray(levels.process),
        jnp.asarray(np.append(levels.drift, 0.0)),
        jnp.asarray(levels.sigma),
    )
    record = Record(*(jnp.asarray(a) for a in (u, y, dt, *np.zeros((2, len(dt), every)))))
    return Window(plant, noise, belief, record, run.t[part], part)


def shocks_of(
    bank: FaultBank,
    window: Window,
    f: jax.Array | None = None,
    span: jax.Array | None = None,
) -> Shocks:
    """What the filter says of a window, linearised around the guess `f`, or over `span`."""
    record = window.record if f is None else window.record._replace(f=f)
    declared, levels = len(bank.levels.onset), bank.levels
    sizes = Sizes(jnp.asarray(levels.size[declared:]), jnp.asarray(levels.jump))
    return shocks(
        window.plant,
        window.noise,
        window.belief,
        record,
        sizes,
        bank.modes.drifting,
        bank.modes.substeps,
        span,
    )


def causes_in(bank: FaultBank, window: Window, found: Shocks) -> Causes:
    """The posterior of a window from what the filter says of it."""
    levels, faults = bank.levels, bank.model.plant.signals.faults
    count, declared = len(window.t), len(faults)
    dt = np.asarray(window.record.dt)[:count, None]
    rate = np.concatenate([levels.onset, levels.unknown[:2]])
    with np.errstate(divide="ignore"):  # an unknown mode that is not worth having
        prior = np.log(rate * dt)
        prior[0] = np.log(np.minimum(rate * 3600, AT_START))
    score, information = (np.asarray(a)[:count] for a in (found.score, found.information))
    size = levels.size[:declared]
    variance = 1 / (information + size**-2.0)
    mean, sd = score * variance, np.sqrt(variance)
    gain = (score**2 * variance - np.log1p(information * size**2)) / 2
    for k, fault in enumerate(faults):
        gain[:, k] += _mass(fault.min, fault.max, mean[:, k], sd[:, k])
        gain[:, k] -= _mass(fault.min, fault.max, np.zeros(1), size[k : k + 1])
    gain = np.concatenate([gain, np.asarray(found.unknown)[:count]], axis=1)
    return Causes(prior + gain, mean, sd, (found,))


def _mass(
    low: float, high: float, mean: Float[np.ndarray, "n"], sd: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """ln of the probability of N(mean, sd^2) between two limits, 0 of which lies between."""
    below, above = log_ndtr((low - mean) / sd), log_ndtr((mean - high) / sd)
    inside = -np.expm1(np.logaddexp(below, above))
    near = np.where(below > above, log_ndtr((mean - low) / sd), log_ndtr((high - mean) / sd))
    return np.where(inside > 1e-3, np.log(np.maximum(inside, 1e-3)), near)
