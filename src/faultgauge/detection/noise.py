"""Noise of outputs, states and drifting parameters, by innovation likelihood on healthy runs.

    maximise  sum_k ln N(y_k; yhat_k|k-1, S_k)   over   ln sigma, ln process, ln drift

(Schweppe, IEEE TAC 11 (1965); Mehra, IEEE TAC 15 (1970)), with the healthy filter of the bank.
The levels of states and drifting parameters are then widened to what the model errs over many
samples (`coloured`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import minimize

from faultgauge.detection.coloured import widening
from faultgauge.detection.judged import (
    operating_points,
    pad_stretch,
    record_arrays,
    start_from_samples,
)
from faultgauge.errors import InputError
from faultgauge.identification.samples import in_effect
from faultgauge.observers.sigma_point import Belief, Hypothesis, SigmaPointFilter, solve_lower
from faultgauge.plants.model import Model
from faultgauge.plants.plant import Plant
from faultgauge.simulation.free_run import substeps_for
from faultgauge.telemetry import Run, segments

__all__ = ["Noise", "drifting_of", "estimate_noise", "noise_of", "spread_of_start"]

SAMPLES = 2048  # of a stretch, at most
STRETCHES = 4
LASTING = (16, 16384)  # stretches, and samples of each, for what lasts
REACH = np.log(1e4)  # a level is looked for within this factor of its first guess
DIFFERENCE = 1e-4  # of a logarithm, for the slope of the likelihood
STEPS = 30


class Noise(NamedTuple):
    """Standard deviations: `sigma` of a sample, `process` and `drift` per sqrt(s)."""

    sigma: Float[np.ndarray, "outputs"]
    process: Float[np.ndarray, "states"]
    drift: Float[np.ndarray, "drifting"]

    def as_dict(self, model: Model) -> dict[str, dict[str, float]]:
        """For the calibration block of a model file."""
        signals = model.plant.signals
        names = (signals.output_names, signals.state_names, drifting_of(model))
        return {
            key: dict(zip(each, values.tolist(), strict=True))
            for key, each, values in zip(self._fields, names, self, strict=True)
        }


def drifting_of(model: Model) -> tuple[str, ...]:
    """Parameters with `vary = "slow"`."""
    return tuple(p.name for p in model.plant.spec.parameters if p.vary == "slow")


def noise_of(model: Model) -> Noise:
    """What `calibrate` found. Raises `InputError` for a model without it."""
    block = (model.calibration or {}).get("noise")
    if block is None:
        raise InputError(
            "the model holds no noise levels, which the bank needs; run `faultgauge "
            "calibrate` on healthy logs, or use --observer eso."
        )
    signals = model.plant.signals
    names = (signals.output_names, signals.state_names, drifting_of(model))
    return Noise(
        *(
            np.array([float(block[key][name]) for name in each])
            for key, each in zip(Noise._fields, names, strict=True)
        )
    )


def spread_of_start(
    model: Model, noise: Noise, columns: Sequence[str]
) -> tuple[Float[np.ndarray, "states"], Float[np.ndarray, "drifting"]]:
    """How uncertain the state and the drifting parameters of a first sample are.

    A measured state is known as well as its output, a hidden one lies somewhere in the training
    envelope, and so does a parameter: within its own size of its value.
    """
    signals = model.plant.signals
    sd = np.std(operating_points(model).x, axis=0) + 1e-9
    for output, sigma in zip(signals.outputs, noise.sigma, strict=True):
        if output.measures is not None and output.name in columns:
            state = signals.state_names.index(output.measures)
            sd[state] = max(2 * sigma, 1e-12)
    values = {p.name: p for p in model.plant.spec.parameters}
    drifted = [
        0.1 * abs(values[name].value) or (_range(values[name].min, values[name].max) / 10)
        for name in drifting_of(model)
    ]
    return sd, np.array(drifted, float)


def _range(low: float, high: float) -> float:
    return high - low if np.isfinite(high - low) else 1.0


@dataclass(frozen=True)
class _Stretch:
    plant: Plant
    x: Float[np.ndarray, "states"]
    u: Float[np.ndarray, "samples inputs"]
    y: Float[np.ndarray, "samples outputs"]
    dt: Float[np.ndarray, "samples"]


def estimate_noise(model: Model, runs: Sequence[Run]) -> Noise:
    """The most likely levels on healthy `runs`.

    Raises `InputError` where no stretch is long enough or the filter never follows the data.
    """
    stretches = _stretches(model, runs)
    if not stretches:
        raise InputError(
            f"{runs[0].source}: no stretch of healthy data is long enough to tell the noise; give "
            "at least 100 samples in a row."
        )
    guess = _guess(model, runs, stretches)
    start = np.log(np.concatenate(guess))
    sizes = np.cumsum([len(part) for part in guess])[:-1]
    sd, drifted = spread_of_start(model, guess, list(runs[0].columns))
    root = np.diag(np.concatenate([sd, drifted]))
    drifting = drifting_of(model)
    substeps = substeps_for(runs[0].step, model.max_step)
    steps = np.concatenate([np.zeros((1, len(start))), DIFFERENCE * np.eye(len(start))])

    def cost(logs: Float[np.ndarray, "levels"]) -> tuple[float, Float[np.ndarray, "levels"]]:
        levels = np.exp(logs + steps)
        sigma, process, walk = np.split(levels, sizes, axis=1)
        select = np.zeros((len(levels), len(model.plant.signals.faults), 0))
        lanes = Hypothesis(*(jnp.asarray(a) for a in (select, process, walk, sigma)))
        total = np.zeros(len(levels))
        for s in stretches:
            mean = [float(getattr(s.plant, "parameters", {})[name]) for name in drifting]
            belief = Belief(jnp.asarray(np.append(s.x, mean)), jnp.asarray(root))
            u, y, dt = (jnp.asarray(a) for a in (s.u, s.y, s.dt))
            total -= np.asarray(_likelihoods(s.plant, lanes, belief, u, y, dt, drifting, substeps))
        count = sum(np.isfinite(s.y).sum() for s in stretches)
        return float(total[0] / count), (total[1:] - total[0]) / DIFFERENCE / count

    found: Any = minimize(
        cost,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=np.stack([start - REACH, start + REACH], axis=1),
        options={"maxiter": STEPS},
    )
    if not np.all(np.isfinite(found.x)):
        raise InputError(
            f"{runs[0].source}: the model does not follow these data at all, so its noise cannot "
            "be told; look at `faultgauge evaluate`."
        )
    noise = Noise(*np.split(np.exp(found.x), sizes))
    return _widened(model, runs, noise)


def _widened(model: Model, runs: Sequence[Run], noise: Noise) -> Noise:
    """`noise` with the levels of states and drifting parameters as `coloured` wants them."""
    stretches = _stretches(model, runs, *LASTING)
    sd, drifted = spread_of_start(model, noise, list(runs[0].columns))
    root = jnp.asarray(np.diag(np.concatenate([sd, drifted])))
    drifting = drifting_of(model)
    substeps = substeps_for(runs[0].step, model.max_step)
    select = np.zeros((len(model.plant.signals.faults), 0))

    def whitened(factor: float) -> list[Float[np.ndarray, "samples outputs"]]:
        levels = (select, factor * noise.process, factor * noise.drift, noise.sigma)
        lane = Hypothesis(*(jnp.asarray(a) for a in levels))
        found = []
        for s in stretches:
            mean = [float(getattr(s.plant, "parameters", {})[name]) for name in drifting]
            belief = Belief(jnp.asarray(np.append(s.x, mean)), root)
            u, y, dt = (jnp.asarray(a) for a in (s.u, s.y, s.dt))
            e = np.array(_innovations(s.plant, lane, belief, u, y, dt, drifting, substeps))
            e[~np.isfinite(s.y)] = np.nan
            found.append(e[:, np.isfinite(s.y).any(axis=0)])
        return found

    factor = widening(whitened)
    return noise._replace(process=factor * noise.process, drift=factor * noise.drift)


@eqx.filter_jit
def _innovations(
    plant: Plant,
    hypothesis: Hypothesis,
    belief: Belief,
    u: Float[Array, "samples inputs"],
    y: Float[Array, "samples outputs"],
    dt: Float[Array, "samples"],
    drifting: tuple[str, ...],
    substeps: int,
) -> Float[Array, "samples outputs"]:
    """The healthy filter's innovations, in their own standard deviations."""
    lane = SigmaPointFilter(plant, hypothesis, drifting, substeps)

    def body(
        carry: tuple[Belief, Array], sample: tuple[Array, Array, Array]
    ) -> tuple[tuple[Belief, Array], Array]:
        belief, before = carry
        u, y, dt = sample
        belief, _, gain = lane.step(belief, before, u, y, dt)
        return (belief, u), solve_lower(gain.root, gain.innovation)

    return jax.lax.scan(body, (belief, u[0]), (u, y, dt))[1]


@eqx.filter_jit
def _likelihoods(
    plant: Plant,
    lanes: Hypothesis,
    belief: Belief,
    u: Float[Array, "samples inputs"],
    y: Float[Array, "samples outputs"],
    dt: Float[Array, "samples"],
    drifting: tuple[str, ...],
    substeps: int,
) -> Float[Array, "lanes"]:
    """ln p(y) of a stretch under every lane's noise levels, healthy."""

    def body(
        carry: tuple[Belief, Array, Array], sample: tuple[Array, Array, Array]
    ) -> tuple[tuple[Belief, Array, Array], None]:
        belief, before, total = carry
        u, y, dt = sample

        def one(hypothesis: Hypothesis, belief: Belief) -> tuple[Belief, Array]:
            lane = SigmaPointFilter(plant, hypothesis, drifting, substeps)
            return lane.step(belief, before, u, y, dt)[:2]

        belief, more = jax.vmap(one)(lanes, belief)
        return (belief, u, total + more), None

    count = len(lanes.sigma)
    start = jax.tree.map(lambda a: jnp.broadcast_to(a, (count, *a.shape)), belief)
    return jax.lax.scan(body, (start, u[0], jnp.zeros(count)), (u, y, dt))[0][2]


def _stretches(
    model: Model, runs: Sequence[Run], most: int = STRETCHES, longest: int = SAMPLES
) -> list[_Stretch]:
    found = []
    for log in runs:
        run = in_effect(model.plant.signals, log)
        outputs = [n for n in model.plant.signals.output_names if n in run.columns]
        for part in segments(run, [*model.plant.signals.input_names, *outputs]):
            if part.stop - part.start >= 100 and len(found) < most:
                part = slice(part.start, min(part.stop, part.start + longest))
                start = start_from_samples(model, run, part)
                u, y = record_arrays(model, run, part)
                u, y, dt = pad_stretch(u, y, run.t[part])
                found.append(_Stretch(start.plant, start.x, u, y, dt))
    return found


def _guess(model: Model, runs: Sequence[Run], stretches: Sequence[_Stretch]) -> Noise:
    """First guesses: sigma from second differences, a state as unsure as a tenth of its own
    output's noise in one sample, or a thousandth of its range where it is hidden."""
    signals, step = model.plant.signals, runs[0].step
    sigma = np.ones(len(signals.outputs))
    for j, output in enumerate(signals.outputs):
        own = [s.y[np.isfinite(s.y[:, j]), j] for s in stretches]
        second = np.concatenate([np.diff(y, 2) for y in own])
        if len(second):
            sigma[j] = 1.4826 * np.median(np.abs(second)) / np.sqrt(6)
            sigma[j] = max(sigma[j], 1e-6 * np.std(second), 1e-12)
        if output.sigma:
            sigma[j] = output.sigma
    process = 1e-3 * np.ptp(operating_points(model).x, axis=0) + 1e-12
    for j, output in enumerate(signals.outputs):
        if output.measures is not None:
            process[signals.state_names.index(output.measures)] = 0.1 * sigma[j]
    process = process / np.sqrt(step)
    values = {p.name: p for p in model.plant.spec.parameters}
    length = float(np.sum(stretches[0].dt))
    drift = [
        (0.1 * abs(values[n].value) or _range(values[n].min, values[n].max) / 10) / length**0.5
        for n in drifting_of(model)
    ]
    return Noise(sigma, process, np.array(drift, float))
