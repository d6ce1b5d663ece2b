"""Scoring a model by pure simulation: the log's inputs in, its outputs compared."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float

from faultgauge.errors import InputError
from faultgauge.identification.samples import spread, state_column
from faultgauge.plants.plant import Plant
from faultgauge.simulation.free_run import bucket, free_run, pad, simulate, substeps_for
from faultgauge.telemetry import Run, segments

__all__ = ["Prediction", "evaluate", "predict", "scores", "start_state"]

WARMUP = 50


class Prediction(NamedTuple):
    """A free run beside one gap-free stretch of a log; `warmup` samples are not scored.

    Outputs without telemetry are NaN in `measured`.
    """

    run: str
    t: Float[np.ndarray, "samples"]
    measured: Float[np.ndarray, "samples outputs"]
    predicted: Float[np.ndarray, "samples outputs"]
    x: Float[np.ndarray, "samples states"]
    warmup: int


def start_state(
    plant: Plant,
    t: Float[np.ndarray, "samples"],
    u: Float[np.ndarray, "samples inputs"],
    y: Float[np.ndarray, "samples outputs"],
    known: dict[str, float],
    max_step: float,
) -> Float[np.ndarray, "states"]:
    """Initial state of a run from its first samples.

    States in `known` are taken as measured; the hidden ones minimise the free run's squared
    output error over the samples given (Levenberg-Marquardt through the simulation). Where all
    states are known nothing is solved.
    """
    signals = plant.signals
    x0 = np.array([known.get(state.name, state.initial) for state in signals.states])
    hidden = np.array([state.name not in known for state in signals.states])
    if not hidden.any():
        return x0
    count = len(t)
    length = bucket(count)
    dt = np.zeros(length)
    dt[: count - 1] = np.diff(t)
    weight = np.isfinite(y) / spread(y)
    weight = np.concatenate([weight, np.zeros((length - count, y.shape[1]))])
    start = _solve_start(
        plant,
        jnp.asarray(x0),
        jnp.asarray(hidden),
        jnp.asarray(pad(u, length)),
        jnp.asarray(dt),
        jnp.asarray(pad(np.nan_to_num(y), length)),
        jnp.asarray(weight),
        substeps_for(float(np.median(np.diff(t))), max_step),
    )
    return np.asarray(start)


@eqx.filter_jit
def _solve_start(
    plant: Plant,
    x0: Float[Array, "states"],
    hidden: Bool[Array, "states"],
    u: Float[Array, "samples inputs"],
    dt: Float[Array, "samples"],
    y: Float[Array, "samples outputs"],
    weight: Float[Array, "samples outputs"],
    substeps: int,
) -> Float[Array, "states"]:
    f = jnp.zeros((len(dt), len(plant.signals.faults)))

    def error(change: Array, args: None) -> Array:
        start = x0 + jnp.where(hidden, change, 0.0)
        predicted = simulate(plant, start, u, dt, f, substeps).y
        return jnp.where(weight > 0, weight * (predicted - y), 0.0).ravel()

    solver = optx.LevenbergMarquardt(rtol=1e-8, atol=1e-8)
    solution = optx.least_squares(
        error,
        solver,
        jnp.zeros_like(x0),
        options={"jac": "fwd"},
        max_steps=50,
        throw=False,
    )
    start = x0 + jnp.where(hidden, solution.value, 0.0)
    return jnp.where(jnp.all(jnp.isfinite(start)), start, x0)


def predict(
    plant: Plant, runs: Sequence[Run], max_step: float, warmup: int = WARMUP
) -> list[Prediction]:
    """Free runs over every gap-free stretch of `runs`, from its first samples' state."""
    signals = plant.signals
    predictions = []
    for run in runs:
        states = {
            name: state_column(signals, name, list(run.columns)) for name in signals.state_names
        }
        outputs = [name for name in signals.output_names if name in run.columns]
        if not outputs:
            raise InputError(
                f"{run.source}: none of the outputs {', '.join(signals.output_names)} has a "
                "column; name one with --map OUTPUT=EXPRESSION."
            )
        columns = [*signals.input_names, *outputs, *(c for c in states.values() if c)]
        for part in segments(run, dict.fromkeys(columns)):
            predictions.append(_predict_part(plant, run, part, states, max_step, warmup))
    if not predictions:
        raise InputError(
            f"{runs[0].source}: no two samples in a row are complete; look at it with "
            "`faultgauge inspect`."
        )
    return predictions


def _predict_part(
    plant: Plant,
    run: Run,
    part: slice,
    states: dict[str, str | None],
    max_step: float,
    warmup: int,
) -> Prediction:
    signals = plant.signals
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
    known = {name: float(run.columns[c][part][0]) for name, c in states.items() if c}
    hidden = len(known) < len(signals.states)
    scored_from = min(warmup, count - 1) if hidden else 0
    first = max(scored_from, 2)
    x0 = (
        start_state(plant, t[:first], u[:first], y[:first], known, max_step)
        if (scored_from)
        else np.array([known.get(s.name, s.initial) for s in signals.states])
    )
    length = bucket(count)
    dt = np.zeros(length)
    dt[: count - 1] = np.diff(t)
    substeps = substeps_for(float(np.median(np.diff(t))), max_step)
    f = jnp.zeros((length, len(signals.faults)))
    simulated = free_run(
        plant, jnp.asarray(x0), jnp.asarray(pad(u, length)), jnp.asarray(dt), f, substeps
    )
    x, _, predicted = jax.device_get(simulated)
    return Prediction(
        run.name, t, y, np.asarray(predicted)[:count], np.asarray(x)[:count], scored_from
    )


def scores(
    measured: Float[np.ndarray, "samples"], predicted: Float[np.ndarray, "samples"]
) -> dict[str, float | None]:
    """RMSE (unit of the output), its share of the standard deviation, and R^2 (paper, eqs
    20 and 21: R^2 = 1 - RMSE^2 / VAR). None where the output has no spread or the run blew up."""
    good = np.isfinite(measured)
    error = (measured - predicted)[good]
    rmse = float(np.sqrt(np.mean(error**2))) if len(error) else np.nan
    spread = float(np.std(measured[good])) if len(error) else 0.0
    relative = rmse / spread if spread > 0 else np.nan
    found = {"r2": 1 - relative**2, "rmse": rmse, "nrmse": relative}
    return {key: value if np.isfinite(value) else None for key, value in found.items()}


def evaluate(
    plant: Plant, runs: Sequence[Run], max_step: float, warmup: int = WARMUP
) -> tuple[dict[str, Any], list[Prediction]]:
    """`{"outputs": {NAME: {r2, rmse, nrmse}}, "runs": [...]}` and the free runs behind it."""
    predictions = predict(plant, runs, max_step, warmup)
    names = plant.signals.output_names

    def table(parts: Sequence[Prediction]) -> dict[str, dict[str, float | None]]:
        measured = np.concatenate([p.measured[p.warmup :] for p in parts])
        predicted = np.concatenate([p.predicted[p.warmup :] for p in parts])
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
                "samples": int(sum(len(p.t) - p.warmup for p in parts)),
                "warmup": int(sum(p.warmup for p in parts)),
                "outputs": table(parts),
            }
        )
    return {"outputs": table(predictions), "runs": rows}, predictions
