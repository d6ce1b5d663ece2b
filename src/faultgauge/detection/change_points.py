"""Where in a window a fault began, how large it is and which one it is: change-point posterior.

In a window at most one fault begins and then stays constant. For a cause k and an onset at sample
n, with score r and information N of its size f ~ N(0, S^2) from `shocks`,

    ln p(y | k, n) - ln p(y | healthy) = (r^2 V - ln(1 + N S^2)) / 2,   V = 1 / (N + 1/S^2),
    f | k, n, y ~ N(r V, V),

times the mass of f within the fault's limits, posterior over prior; the prior of (k, n) is the
cause's onset rate times the step. A window ends where the bank saw its fault go, and at a gap.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.special import log_ndtr

from faultgauge.detection.bank import FaultBank
from faultgauge.detection.course import AT_START
from faultgauge.detection.decisions import Decision
from faultgauge.detection.flat_line import FlatLine
from faultgauge.detection.judged import pad_stretch, record_arrays, start_from_samples
from faultgauge.detection.levels import driven
from faultgauge.detection.noise import spread_of_start
from faultgauge.detection.onset import onset_of
from faultgauge.detection.shocks import Record, Shocks, Sizes, shocks
from faultgauge.detection.verdicts import FAULT, NAMED
from faultgauge.identification.samples import in_effect
from faultgauge.observers.sigma_point import Belief, Hypothesis
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.telemetry import Run, segments

__all__ = ["Causes", "Window", "causes_of", "shocks_of", "total", "windows_of"]

PASSES = 2  # of linearising the filter around the fault that was found
FEWEST = 20  # samples below which a window is not judged


class Window(NamedTuple):
    """The samples `part` of a run, its arrays padded to the length of a bucket."""

    plant: GrayBoxPlant
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


def total(weight: Float[np.ndarray, "..."]) -> float:
    """ln of a sum of weights."""
    return float(np.logaddexp.reduce(weight, axis=None))


def windows_of(bank: FaultBank, decision: Decision) -> Iterator[Window]:
    """The windows of a judged run that have samples to judge, in order.

    Parameters of the run are found at its first window: at a later one they would take up a fault
    that is there already.
    """
    run = in_effect(bank.model.plant.signals, decision.run)
    run, _ = FlatLine(bank.model, sized=True).used(run)
    believed = _believed(bank, decision)
    plant = None
    for part in _windows(bank, decision, run):
        window = _window(bank, run, part, believed, plant)
        if window is not None:
            plant = window.plant
            yield window


def causes_of(bank: FaultBank, window: Window) -> Causes:
    """The posterior of a window, beside the faults that are known in it.

    A fault that beats the healthy hypothesis is linearised around itself: what it does to the
    state, and to its own effect, then counts in full.
    """
    faults = bank.model.plant.signals.faults
    plain = shocks_of(bank, window)
    found = _causes(bank, window, plain)
    seen = [plain] * (len(faults) + 1)
    for k, fault in enumerate(faults):
        for _ in range(PASSES if total(found.weight[:, k]) > 0 else 0):
            best = int(np.argmax(found.weight[:, k]))
            size = float(np.clip(found.mean[best, k], fault.min, fault.max))
            seen[k] = shocks_of(bank, window, window.record.f.at[best:, k].set(size))
            again = _causes(bank, window, seen[k])
            more = float(seen[k].base - plain.base)
            found.weight[:, k] = again.weight[:, k] + more
            found.mean[:, k], found.sd[:, k] = again.mean[:, k], again.sd[:, k]
    return found._replace(seen=tuple(seen))


def _believed(bank: FaultBank, decision: Decision) -> Bool[np.ndarray, "samples"]:
    """Samples at which the model is trusted: inside the training envelope, or under an alarm that
    began there."""
    return decision.posterior.inside | (np.array(decision.status) == FAULT)


def _windows(bank: FaultBank, decision: Decision, run: Run) -> Iterator[slice]:
    """Stretches without a gap, cut where a fault went and the plant was healthy again: as long
    before the bank saw it as it may take to see it. What lies between belongs to no window."""
    names = bank.model.plant.signals.fault_names
    for stretch in segments(run, bank.model.plant.signals.input_names or bank.outputs):
        first = stretch.start
        for event in decision.events:
            stop = int(np.searchsorted(run.t, event.end, "right"))
            if not first < stop < stretch.stop or not _healthy_after(decision, stop, stretch.stop):
                continue
            late = 0.0
            if event.size is not None:
                late = onset_of(bank, names.index(event.fault), event.size)[1]
            last = int(np.searchsorted(run.t, max(event.end - late, event.start), "right"))
            yield slice(first, max(last, first))
            first = stop
        yield slice(first, stretch.stop)


def _healthy_after(decision: Decision, stop: int, end: int) -> bool:
    """Whether the bank was sure of it between `stop` and the next event."""
    t = decision.run.t
    starts = [int(np.searchsorted(t, event.start)) for event in decision.events]
    following = min((start for start in starts if start >= stop), default=end)
    return bool(np.any(decision.posterior.healthy[stop : min(following, end)] >= NAMED))


def _window(
    bank: FaultBank,
    run: Run,
    part: slice,
    believed: Bool[np.ndarray, "samples"],
    plant: GrayBoxPlant | None,
) -> Window | None:
    complete = np.all([np.isfinite(run.columns[n][part]) for n in bank.outputs], axis=0)
    usable = np.flatnonzero(complete & believed[part])
    if len(usable) < FEWEST:
        return None
    part = slice(part.start + int(usable[0]), part.stop)
    model, levels = bank.model, bank.levels
    start = start_from_samples(model, run, part)
    u, y = record_arrays(model, run, part)
    y[:, [n not in bank.outputs for n in model.plant.signals.output_names]] = np.nan
    y[~believed[part]] = np.nan
    u, y, dt = pad_stretch(u, y, run.t[part])
    if plant is None:
        plant = driven(replace(model, plant=start.plant))
    # The first sample has found the start: it is not to be believed twice, least of all where
    # a sensor's bias may have been there already.
    nobody, drifted = spread_of_start(model, bank.noise, ())
    mean = [float(plant.parameters[name]) for name in bank.modes.drifting]
    belief = Belief(
        jnp.asarray(np.append(start.x, mean)), jnp.diag(jnp.asarray(np.append(nobody, drifted)))
    )
    every = len(levels.size)
    noise = Hypothesis(
        jnp.zeros((every, 1)),
        jnp.asarray(levels.process),
        jnp.asarray(np.append(levels.drift, 0.0)),
        jnp.asarray(levels.sigma),
    )
    record = Record(*(jnp.asarray(a) for a in (u, y, dt, *np.zeros((2, len(dt), every)))))
    return Window(plant, noise, belief, record, run.t[part], part)


def shocks_of(bank: FaultBank, window: Window, f: jax.Array | None = None) -> Shocks:
    """What the filter says of a window, linearised around the guess `f`."""
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
    )


def _causes(bank: FaultBank, window: Window, found: Shocks) -> Causes:
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
