"""Scoring a model by pure simulation: the log's inputs in, its outputs compared."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from faultgauge.errors import InputError
from faultgauge.identification.between_runs import SUREST
from faultgauge.identification.samples import in_effect, spread, state_column
from faultgauge.identification.unknowns import Unknowns, unknown_constants
from faultgauge.plants.plant import Plant
from faultgauge.plants.record import BetweenRuns
from faultgauge.programs import program
from faultgauge.simulation.free_run import blow_up, bucket, free_run, pad, simulate, substeps_for
from faultgauge.telemetry import Run, as_sampled, segments
from faultgauge.telemetry.clock import Clock

__all__ = [
    "POOR_FREE_RUN",
    "WARMUP",
    "Prediction",
    "at_samples",
    "divergence",
    "evaluate",
    "evaluate_ensemble",
    "finds_start",
    "predict",
    "scores",
    "start_of_run",
    "too_short",
    "varying_parameters",
]

WARMUP = 50  # samples that find hidden initial states, if nobody says
POOR_FREE_RUN = 0.5  # of the outputs' spread: a quarter of the variance is not explained
FEWEST_SCORED = 5  # samples after a warm-up


class Prediction(NamedTuple):
    """A free run beside one stretch of a log without a gap in time or inputs.

    The first `warmup` samples are not scored, nor are outputs that were not sampled, NaN in
    `measured`; `u` are the inputs in effect, `clock` is the log's.
    """

    run: str
    t: Float[np.ndarray, "samples"]
    measured: Float[np.ndarray, "samples outputs"]
    predicted: Float[np.ndarray, "samples outputs"]
    x: Float[np.ndarray, "samples states"]
    warmup: int
    u: Float[np.ndarray, "samples inputs"]
    clock: Clock | None = None


def at_samples(prediction: Prediction, output: int) -> Prediction:
    """`prediction` at the samples of one output: all of it, but where its sensor is slower."""
    sampled = np.isfinite(prediction.measured[:, output])
    rows = ("t", "measured", "predicted", "x", "u")
    return prediction._replace(
        warmup=int(np.sum(sampled[: prediction.warmup])),
        **{name: getattr(prediction, name)[sampled] for name in rows},
    )


def start_of_run(
    plant: Plant,
    t: Float[np.ndarray, "samples"],
    u: Float[np.ndarray, "samples inputs"],
    y: Float[np.ndarray, "samples outputs"],
    known: dict[str, float],
    max_step: float,
    between: BetweenRuns | None = None,
) -> tuple[Plant, Float[np.ndarray, "states"]]:
    """(plant, initial state) of a run from its first samples.

    States in `known` are taken as measured; the hidden ones, and the run's own values of
    parameters that vary, minimise the free run's squared output error over the samples given
    (Levenberg-Marquardt through the simulation), both within their min and max. Where all are
    known nothing is solved. With what is known `between` runs, values per run minimise

        sum_outputs n mean((y - yhat)^2) / off^2 + sum_parameters (p - p_common)^2 / apart^2

    where what the plant lacks lasts, so that only n = T / lasting samples of an output in a time T
    are independent: no fewer than one, and no more than there are.
    """
    signals = plant.signals
    x0 = np.array([known.get(state.name, state.initial) for state in signals.states])
    hidden = np.array([state.name not in known for state in signals.states])
    varying = varying_parameters(plant)
    if not hidden.any() and not varying.parameters:
        return plant, x0
    count = len(t)
    length = bucket(count)
    dt = np.zeros(length)
    dt[: count - 1] = np.diff(t)
    sampled = np.isfinite(y)
    weight, prior = sampled / spread(y), SUREST
    if varying.parameters and between is not None:
        prior = 1.0
        varying = replace(varying, scales=tuple(between.apart[p] for p in varying.parameters))
        off = np.array([between.off[name] for name in signals.output_names])
        samples = np.maximum(np.sum(sampled, axis=0), 1)
        independent = np.clip((t[-1] - t[0]) / between.lasting, 1, samples)
        weight = sampled / off * np.sqrt(independent / samples)
    weight = np.concatenate([weight, np.zeros((length - count, y.shape[1]))])
    start, theta = _solve_start(
        plant,
        # with its values in it, each would be a program of its own
        replace(varying, centers=(), scales=()),
        jax.device_put(np.array(varying.centers, float)),
        jax.device_put(np.array(varying.scales, float)),
        jax.device_put(np.stack(varying.bounds(plant))),
        jax.device_put(x0),
        jax.device_put(hidden),
        jax.device_put(pad(u, length)),
        jax.device_put(dt),
        jax.device_put(pad(np.nan_to_num(y), length)),
        jax.device_put(weight),
        jax.device_put(prior),
        substeps_for(float(np.median(np.diff(t))), max_step),
    )
    return varying.assemble(plant, theta), np.asarray(start)


def varying_parameters(plant: Plant) -> Unknowns:
    """Those with a value per run, around the values that `plant` has."""
    found, values = unknown_constants(plant), plant.values()
    names = [found.parameters[k] for k in found.varying]
    return Unknowns(
        networks=(),
        parameters=tuple(names),
        positive=tuple(found.positive[k] for k in found.varying),
        centers=tuple(float(values[name]) for name in names),
        scales=tuple(found.scales[k] for k in found.varying),
    )


@program
def _solve_start(
    plant: Plant,
    varying: Unknowns,
    centers: Float[Array, "parameters"],
    scales: Float[Array, "parameters"],
    bounds: Float[Array, "two parameters"],
    x0: Float[Array, "states"],
    hidden: Bool[Array, "states"],
    u: Float[Array, "samples inputs"],
    dt: Float[Array, "samples"],
    y: Float[Array, "samples outputs"],
    weight: Float[Array, "samples outputs"],
    prior: Float[Array, ""],
    substeps: int,
) -> tuple[Float[Array, "states"], Float[Array, "parameters"]]:
    f = jnp.zeros((len(dt), len(plant.signals.faults)))
    states = len(x0)
    varying = replace(varying, centers=tuple(centers), scales=tuple(scales))

    least = jnp.asarray([state.min for state in plant.signals.states])
    most = jnp.asarray([state.max for state in plant.signals.states])

    def start_of(change: Array) -> Array:
        return jnp.where(hidden, jnp.clip(x0 + change[:states], least, most), x0)

    def own_of(change: Array) -> Array:
        return jnp.clip(change[states:], *bounds)

    def run(change: Array) -> Array:
        start = start_of(change)
        return simulate(varying.assemble(plant, own_of(change)), start, u, dt, f, substeps).y

    def error(change: Array, args: None) -> Array:
        left = jnp.where(weight > 0, weight * (run(change) - y), 0.0).ravel()
        return jnp.concatenate([left, prior * change[states:]])

    import optimistix as optx  # a third of a second to load, which few commands need

    solver = optx.LevenbergMarquardt(rtol=1e-8, atol=1e-8)
    solution = optx.least_squares(
        error,
        solver,
        jnp.zeros(states + len(varying.parameters)),
        options={"jac": "fwd"},
        max_steps=50,
        throw=False,
    )
    change = jnp.where(jnp.all(jnp.isfinite(solution.value)), solution.value, 0.0)
    return start_of(change), own_of(change)


def predict(
    plant: Plant,
    runs: Sequence[Run],
    max_step: float,
    warmup: int = WARMUP,
    between: BetweenRuns | None = None,
) -> list[Prediction]:
    """Free runs over every stretch of `runs` without a gap in time or inputs.

    A stretch starts from the first sample that has all measured states and an output; outputs that
    are empty later are gone through, not scored. Where states are hidden or parameters vary,
    `warmup` samples find them, with what is known `between` runs, and stretches that leave too
    little to score are left out.
    Raises `InputError` where no stretch is left.
    """
    parts = _parts(plant, runs, warmup)[0]
    return [_predict_part(plant, part, max_step, between) for part in parts]


def finds_start(plant: Plant, runs: Sequence[Run]) -> bool:
    """Whether first samples find part of a run's start: hidden states, a run's own parameters."""
    names = plant.signals.state_names
    hidden = any(not state_column(plant.signals, s, list(r.columns)) for r in runs for s in names)
    return hidden or bool(varying_parameters(plant).parameters)


def too_short(plant: Plant, runs: Sequence[Run], warmup: int = WARMUP) -> list[str]:
    """A sentence for every run without a stretch that outlasts the warm-up."""
    sentences = []
    for run in runs:
        parts, lost = _parts_of(plant, run, warmup)
        if lost and not parts:
            sentences.append(
                f"run {run.name!r} of {run.source} has at most {max(lost)} samples without a gap, "
                f"and a free run takes {warmup} to find its hidden start and {FEWEST_SCORED} to be "
                "scored: the model cannot be validated on it; give a longer one"
            )
    return sentences


class _Part(NamedTuple):
    """A stretch to run through: the states that its first sample tells, and its warm-up."""

    run: Run
    part: slice
    known: dict[str, float]
    warmup: int


def _parts(plant: Plant, runs: Sequence[Run], warmup: int) -> tuple[list[_Part], list[str]]:
    """All stretches long enough to be scored, and a sentence for every run that lost some."""
    found: list[_Part] = []
    sentences, longest = [], (0, runs[0])
    for run in runs:
        parts, lost = _parts_of(plant, run, warmup)
        found += parts
        if lost:
            longest = max(longest, (max(lost), run), key=lambda each: each[0])
            sentences.append(
                f"run {run.name!r} of {run.source}: {len(lost)} of {len(lost) + len(parts)} "
                f"stretches, of at most {max(lost)} samples, are left out: {warmup} samples of "
                f"warm-up leave fewer than {FEWEST_SCORED} to score; give a smaller --warmup or a "
                "longer log"
            )
    count, run = longest
    if not found and count:
        raise InputError(
            f"run {run.name!r} of {run.source} has at most {count} samples without a gap; the "
            f"warm-up that finds the hidden start takes {warmup} and leaves fewer than "
            f"{FEWEST_SCORED} to score; give a smaller --warmup or a longer log."
        )
    if not found:
        raise InputError(
            f"{run.source}: no two samples in a row have all inputs and a measured output; look "
            "at it with `faultgauge inspect`."
        )
    return found, sentences


def _parts_of(plant: Plant, log: Run, warmup: int) -> tuple[list[_Part], list[int]]:
    """The stretches of one run, and the lengths of those that the warm-up uses up."""
    signals = plant.signals
    run = in_effect(signals, log)
    columns = {s: state_column(signals, s, list(run.columns)) for s in signals.state_names}
    states = {state: run.columns[column] for state, column in columns.items() if column}
    outputs = [run.columns[name] for name in signals.output_names if name in run.columns]
    if not outputs:
        raise InputError(
            f"{run.source}: none of the outputs {', '.join(signals.output_names)} has a "
            "column; name one with --map OUTPUT=EXPRESSION."
        )
    measured = np.any([np.isfinite(y) for y in outputs], axis=0)
    ready = np.all([measured, *(np.isfinite(x) for x in states.values())], axis=0)
    unknown = finds_start(plant, [run])
    found, lost = list[_Part](), list[int]()
    for part in segments(run, signals.input_names):
        start = part.start + int(np.argmax(measured[part]))
        # a state that stays empty is as good as hidden; waiting for it would cost too much
        start += int(np.argmax(ready[start : min(start + WARMUP, part.stop)]))
        known = {name: float(x[start]) for name, x in states.items() if np.isfinite(x[start])}
        first = warmup if unknown or len(known) < len(signals.states) else 0
        scored = int(np.sum(measured[start + first : part.stop]))
        if scored >= (FEWEST_SCORED if first else 2):
            found.append(_Part(run, slice(start, part.stop), known, first))
        elif first and measured[part].any():
            lost.append(part.stop - start)
    return found, lost


def _predict_part(
    plant: Plant, each: _Part, max_step: float, between: BetweenRuns | None
) -> Prediction:
    signals, (run, part, known, warmup) = plant.signals, each
    t = run.t[part]
    count = len(t)
    u = (
        np.stack([run.columns[n][part] for n in signals.input_names], axis=1)
        if (signals.inputs)
        else np.zeros((count, 0))
    )
    nothing = np.full(count, np.nan)
    y = np.stack(
        [run.columns[n][part] if n in run.columns else nothing for n in signals.output_names], 1
    )
    first = max(warmup, 2)
    x0 = np.array([known.get(s.name, s.initial) for s in signals.states])
    if warmup:
        start = t[:first], u[:first], y[:first]
        plant, x0 = start_of_run(plant, *start, known, max_step, between)
    length = bucket(count)
    dt = np.zeros(length)
    dt[: count - 1] = np.diff(t)
    substeps = substeps_for(float(np.median(np.diff(t))), max_step)
    f = jnp.zeros((length, len(signals.faults)))
    simulated = free_run(
        plant, jnp.asarray(x0), jnp.asarray(pad(u, length)), jnp.asarray(dt), f, substeps
    )
    x, _, predicted = jax.device_get(simulated)
    predicted, x = np.asarray(predicted)[:count], np.asarray(x)[:count]
    measured = [as_sampled(run, n, t, y[:, j]) for j, n in enumerate(signals.output_names)]
    y = np.stack(measured, axis=1)
    return Prediction(run.name, t, y, predicted, x, warmup, _clipped(plant, u), run.clock)


def divergence(plant: Plant, predictions: Sequence[Prediction]) -> str:
    """That the free run diverges; when and in which state, where one leaves all bounds."""
    names = plant.signals.state_names
    found = filter(None, (blow_up(p.run, p.t, p.x, names) for p in predictions))
    return "the free run diverges" + next((f": {where}" for where in found), "")


def _clipped(
    plant: Plant, u: Float[np.ndarray, "samples inputs"]
) -> Float[np.ndarray, "samples inputs"]:
    limits = [(each.min, each.max) for each in plant.signals.inputs]
    return (
        np.stack([np.clip(u[:, k], *limit) for k, limit in enumerate(limits)], 1) if limits else u
    )


def scores(
    measured: Float[np.ndarray, "samples"], predicted: Float[np.ndarray, "samples"]
) -> dict[str, float | None]:
    """RMSE (unit of the output), its share of the standard deviation, and R^2 (paper, eqs
    20 and 21: R^2 = 1 - RMSE^2 / VAR). None where the output has no spread or the run blew up."""
    good = np.isfinite(measured)
    error = (measured - predicted)[good]
    with np.errstate(over="ignore"):  # of a run that blew up
        rmse = float(np.sqrt(np.mean(error**2))) if len(error) else np.nan
        spread = float(np.std(measured[good])) if len(error) else 0.0
        relative = np.float64(rmse / spread if spread > 0 else np.nan)
        found = {"r2": float(1 - relative**2), "rmse": rmse, "nrmse": float(relative)}
    return {key: value if np.isfinite(value) else None for key, value in found.items()}


def evaluate(
    plant: Plant,
    runs: Sequence[Run],
    max_step: float,
    warmup: int = WARMUP,
    between: BetweenRuns | None = None,
) -> tuple[dict[str, Any], list[Prediction]]:
    """`{"outputs": {NAME: {r2, rmse, nrmse}}, "runs": [...], "warnings": [...]}` and the free runs
    behind it. `samples` of a run are those scored in any output; `warnings` name what is left out.
    """
    parts, warnings = _parts(plant, runs, warmup)
    predictions = [_predict_part(plant, part, max_step, between) for part in parts]
    names = plant.signals.output_names

    def table(parts: Sequence[Prediction]) -> dict[str, dict[str, float | None]]:
        measured = _scored([p.measured for p in parts], parts)
        predicted = _scored([p.predicted for p in parts], parts)
        return {
            name: scores(measured[:, j], predicted[:, j])
            for j, name in enumerate(names)
            if np.isfinite(measured[:, j]).any()
        }

    rows = []
    for name in dict.fromkeys(p.run for p in predictions):
        parts = [p for p in predictions if p.run == name]
        rows.append(
            {
                "run": name,
                "samples": int(
                    np.sum(np.isfinite(_scored([p.measured for p in parts], parts)).any(1))
                ),
                "warmup": int(sum(p.warmup for p in parts)),
                "outputs": table(parts),
            }
        )
    found = {"outputs": table(predictions), "runs": rows, "warnings": warnings}
    return found, predictions


def evaluate_ensemble(
    plants: Sequence[Plant],
    runs: Sequence[Run],
    max_step: float,
    warmup: int = WARMUP,
    between: BetweenRuns | None = None,
) -> dict[str, dict[str, float | None]]:
    """`{OUTPUT: {r2, rmse, nrmse, spread}}` of the mean of the plants' free runs.

    `spread` (unit of the output) is the plants' standard deviation, root mean square over the
    samples. Like the scores it is None where a plant diverges.
    """
    free_runs = [predict(plant, runs, max_step, warmup, between) for plant in plants]
    parts = [_scored([p.measured for p in free_runs[0]], free_runs[0])]
    parts += [_scored([p.predicted for p in each], each) for each in free_runs]
    measured, predicted = parts[0], np.stack(parts[1:])
    with np.errstate(over="ignore", invalid="ignore"):
        mean, deviation = predicted.mean(axis=0), predicted.std(axis=0)
        found = {}
        for j, name in enumerate(plants[0].signals.output_names):
            good = np.isfinite(measured[:, j])
            if good.any():
                spread_of = float(np.sqrt(np.mean(deviation[good, j] ** 2)))
                found[name] = {
                    **scores(measured[:, j], mean[:, j]),
                    "spread": spread_of if np.isfinite(spread_of) else None,
                }
    return found


def _scored(
    arrays: Sequence[Float[np.ndarray, "_ outputs"]], predictions: Sequence[Prediction]
) -> Float[np.ndarray, "samples outputs"]:
    return np.concatenate([a[p.warmup :] for a, p in zip(arrays, predictions, strict=True)])
