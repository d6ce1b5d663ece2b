"""The plant with what `Noise` says of it: its errors, how large they are, and where they start."""

from collections.abc import Sequence
from dataclasses import replace

import jax
import numpy as np
from jaxtyping import Array, Float

from faultgauge.detection.bank.noise import DOUBT, Noise
from faultgauge.detection.bank.uncertain_constants import constants_of, drifting_of
from faultgauge.detection.remember import once
from faultgauge.detection.rows.judged import operating_points
from faultgauge.plants.disturbed import Disturbed, Error, dynamic_states, following_inputs
from faultgauge.plants.model import Model
from faultgauge.plants.plant import Plant, respond, responses
from faultgauge.plants.signals import Fault
from faultgauge.programs import program

__all__ = [
    "directions_of",
    "disturbed",
    "error_of",
    "jitter_of",
    "offset_of",
    "process_of",
    "rates_of",
    "retold",
    "sampled_within",
    "scale_of",
    "spread_of_start",
    "start_spread",
    "width_of",
]


def retold(model: Model, noise: Noise) -> Model:
    """`model` with its constants as healthy logs have them."""
    values, names = model.plant.values(), constants_of(model).names
    mean = {n: values[n] + shift for n, shift in zip(names, noise.shift, strict=True)}
    return replace(model, plant=model.plant.with_constants(mean))


def disturbed(model: Model, noise: Noise, undeclared: tuple[Fault, ...] = ()) -> Disturbed:
    """The plant with the discrepancy and the uncertain constants that `noise` says."""
    known = constants_of(model)
    return Disturbed.of(
        model.plant,
        dynamic_states(model.plant),
        following_inputs(model.plant),
        error_of(model, noise),
        (*drifting_of(model), *known.names),
        jax.device_put(offset_of(model, noise)),
        jax.device_put(directions_of(model, noise)),
        undeclared,
        noise.wanders,
        noise.lags,
        noise.strays,
        noise.doubts,
        noise.leans,
        noise.trails,
        noise.zeros,
        noise.bends,
        noise.grips,
        tuple(len(drifting_of(model)) + k for k in known.positive),
    )


def offset_of(model: Model, noise: Noise) -> Float[np.ndarray, "parameters"]:
    """What the mean of each parameter of `Disturbed` is off the fitted value."""
    return np.concatenate([np.zeros(len(drifting_of(model))), noise.shift])


def directions_of(model: Model, noise: Noise) -> Float[np.ndarray, "parameters directions"]:
    """W: what a unit of each xi does to the parameters, drifting ones first. Of the constants
    W = D R^(1/2), R their correlation: each has a xi that is, of all, nearest to its own."""
    _, drifted = spread_of_start(model, np.ones(len(model.plant.signals.outputs)), ())
    k = len(drifted)
    W = np.zeros((k + len(noise.spread), k + len(noise.spread)))
    W[:k, :k] = np.diag(drifted)
    w, v = np.linalg.eigh(noise._replace(spread=np.ones(len(noise.spread))).between)
    W[k:, k:] = noise.spread[:, None] * ((v * np.sqrt(np.maximum(w, 0.0))) @ v.T)
    return W


def error_of(model: Model, noise: Noise) -> Error:
    """What of `noise` the plant itself has."""
    wanders, lags, strays = list(noise.wanders), list(noise.lags), list(noise.strays)
    own = (noise.lasting, noise.settling, noise.share)
    beside = (noise.wandering[wanders], noise.lag[lags], noise.late[lags], noise.straying[strays])
    doubts = list(noise.doubts)
    leans, trails, bends = list(noise.leans), list(noise.trails), list(noise.bends)
    doubt = (getattr(noise, name)[doubts] for name in DOUBT)
    # an input may have changed by all it can just before a log
    u = operating_points(model).u
    before = np.ptp(u, axis=0)[list(following_inputs(model.plant))]
    late = noise.leaning[leans], noise.lean[leans], noise.trail[trails]
    bend = noise.bend[bends], u.min(axis=0)[bends], u.max(axis=0)[bends]
    grips = list(noise.grips)
    grip = noise.gripping[grips], noise.slip[grips], noise.travel[grips]
    fading = np.concatenate([np.zeros(len(drifting_of(model))), noise.fading])
    parts = (*own, *beside, *doubt, *late, *bend, *grip, before, fading)
    return Error(*(jax.device_put(np.asarray(each)) for each in parts))


def jitter_of(many: Sequence[Noise]) -> Float[Array, "many outputs"] | None:
    """By what the times of samples err [s] under each of `many`; None where nothing does."""
    if not any(each.jitters for each in many):
        return None
    return jax.device_put(np.stack([each.jitter for each in many]))


def sampled_within(model: Model, noise: Noise) -> Float[np.ndarray, "outputs"]:
    """Standard deviation of a sample while outputs move as they usually do."""
    if not noise.jitters:
        return noise.sigma
    return np.hypot(noise.sigma, noise.jitter * output_rates_of(model))


def process_of(
    noise: Noise, drifted: Float[np.ndarray, "drifting"]
) -> Float[np.ndarray, "extended"]:
    """Per sqrt(s), of the states of `Disturbed`."""
    wanders, strays, grips = list(noise.wanders), list(noise.strays), list(noise.grips)
    return np.concatenate(
        [
            noise.process,
            noise.size * np.sqrt(2 / noise.lasting),
            np.sqrt(2 / noise.settling),
            noise.wander[wanders] * np.sqrt(2 / noise.wandering[wanders]),
            np.zeros(len(noise.lags)),
            noise.stray[strays] * np.sqrt(2 / noise.straying[strays]),
            np.zeros(len(noise.leans + noise.trails + noise.zeros)),
            noise.grip[grips] * np.sqrt(2 / noise.gripping[grips]),
            np.zeros(len(noise.share)),
            noise.drift / np.maximum(drifted, 1e-300),
            np.sqrt(2 * noise.fading),
        ]
    )


def spread_of_start(
    model: Model, sigma: Float[np.ndarray, "outputs"], columns: Sequence[str]
) -> tuple[Float[np.ndarray, "states"], Float[np.ndarray, "drifting"]]:
    """How uncertain the state and the drifting parameters of a first sample are.

    A measured state is known as well as its output, a hidden one lies somewhere in the training
    envelope, and so does a parameter: within its own size of its value.
    """
    signals = model.plant.signals
    sd = np.std(operating_points(model).x, axis=0) + 1e-9
    for output, noise in zip(signals.outputs, sigma, strict=True):
        if output.measures is not None and output.name in columns:
            state = signals.state_names.index(output.measures)
            sd[state] = max(2 * noise, 1e-12)
    values = {p.name: p for p in model.plant.spec.parameters}
    drifted = [
        0.1 * abs(values[name].value) or (width_of(values[name].min, values[name].max) / 10)
        for name in drifting_of(model)
    ]
    return sd, np.array(drifted, float)


def start_spread(
    model: Model, noise: Noise, columns: Sequence[str]
) -> Float[np.ndarray, "extended"]:
    """Of the states of `Disturbed` when a log begins."""
    sd, drifted = spread_of_start(model, noise.sigma, columns)
    width = np.ptp(operating_points(model).u, axis=0)
    follows, leans = np.ones(len(noise.share)), list(noise.leans)
    wanders, lags = list(noise.wanders), list(noise.lags)
    late = noise.late[lags] * ranges_of(model)[lags]
    stray = noise.stray[list(noise.strays)], np.abs(noise.lean[leans]) * width[leans]
    trails = list(noise.trails)
    trail = noise.trail[trails] * output_rates_of(model)[trails]
    # of a state only what its sensor trailed says how it begins
    for j, behind in zip(trails, trail, strict=True):
        measures = model.plant.signals.outputs[j].measures
        if measures is not None:
            k = model.plant.signals.state_names.index(measures)
            sd[k] = np.hypot(sd[k], behind)
    own = trail, noise.zero[list(noise.zeros)], noise.grip[list(noise.grips)]
    rest = noise.wander[wanders], late, *stray, *own, 0 * follows
    directions = np.ones(len(drifted) + len(noise.spread))
    return np.concatenate([sd, noise.size, follows, *rest, directions])


def scale_of(model: Model, noise: Noise) -> Float[np.ndarray, "extended"]:
    """How large the states of `Disturbed` are."""
    x = np.std(operating_points(model).x, axis=0) + 1e-9
    rest = np.ones(len(drifting_of(model)) + len(noise.spread))
    u = np.std(operating_points(model).u, axis=0) + 1e-9
    follows = u[list(following_inputs(model.plant))]
    own = noise.wander[list(noise.wanders)], ranges_of(model)[list(noise.lags)]
    stray = noise.stray[list(noise.strays)], u[list(noise.leans)]
    trails = list(noise.trails)
    stray = *stray, noise.trail[trails] * output_rates_of(model)[trails]
    stray = *stray, noise.zero[list(noise.zeros)], noise.grip[list(noise.grips)]
    return np.concatenate([x, noise.size, np.ones(len(follows)), *own, *stray, follows, rest])


@once
def rates_of(model: Model) -> Float[np.ndarray, "states"]:
    """Standard deviation of the states' derivatives over the training envelope."""
    found = _rates(model)
    return np.std(found, axis=0) + 1e-9 * np.abs(found).max(axis=0, initial=0.0) + 1e-12


@once
def ranges_of(model: Model) -> Float[np.ndarray, "outputs"]:
    """Of the outputs over the training envelope."""
    points = operating_points(model)
    outputs = np.asarray(responses(model.plant, *map(jax.device_put, points))[1])
    return np.ptp(outputs[np.isfinite(outputs).all(axis=1)], axis=0) + 1e-12


@once
def output_rates_of(model: Model) -> Float[np.ndarray, "outputs"]:
    """Standard deviation of the outputs' derivatives over the training envelope, their inputs and
    what they read of derivatives held."""
    points = operating_points(model)
    found = np.asarray(_output_rates(model.plant, *map(jax.device_put, points)))
    return np.std(found[np.isfinite(found).all(axis=1)], axis=0) + 1e-12


@program
def _output_rates(plant: Plant, x: Array, u: Array) -> Array:
    def moves(x: Array, u: Array) -> Array:
        dx, _ = respond(plant, x, u)
        return jax.jvp(lambda x: plant.output(dx, x, u), (x,), (dx,))[1]

    return jax.vmap(moves)(x, u)


def _rates(model: Model) -> Float[np.ndarray, "points states"]:
    points = operating_points(model)
    found = np.asarray(responses(model.plant, *map(jax.device_put, points))[0])
    return found[np.isfinite(found).all(axis=1)]


def width_of(low: float, high: float) -> float:
    """The width of a range; 1 where it is open."""
    return high - low if np.isfinite(high - low) else 1.0
