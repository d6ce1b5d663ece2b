"""The residual r = y - yhat (paper, eq 9) against one of three healthy references."""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.detection.judged import (
    bandwidth_of,
    measured_outputs,
    operating_points,
    record_arrays,
    run_observer,
    start_from_samples,
)
from faultgauge.errors import InputError
from faultgauge.identification.samples import in_effect, state_column
from faultgauge.observers.luenberger import design_luenberger
from faultgauge.plants.model import Model
from faultgauge.plants.plant import Plant, respond
from faultgauge.simulation.free_run import bucket, free_run, pad, substeps_for
from faultgauge.simulation.integrators import step as integrate
from faultgauge.telemetry import Run, segments

__all__ = ["REFERENCES", "Reference", "residuals"]

Reference = Literal["free", "measured", "observer"]
REFERENCES: tuple[Reference, ...] = ("free", "measured", "observer")


def residuals(
    model: Model, log: Run, reference: Reference
) -> dict[str, Float[np.ndarray, "samples"]]:
    """r per measured output, one row per sample, NaN where nothing was sampled.

    `free`: the model runs from the stretch's first state on the inputs alone. `measured`: it is
    fed with the measured states at every sample; an output that is itself a state is predicted
    from the sample before. `observer`: a state observer without a fault follows the outputs.
    """
    signals = model.plant.signals
    run = in_effect(signals, log)
    outputs = [name for name in signals.output_names if name in run.columns]
    found = {name: np.full(len(run.t), np.nan) for name in outputs}
    for part in segments(run, [*signals.input_names, *outputs]):
        r = {"free": _free, "measured": _measured, "observer": _observed}[reference](
            model, run, part
        )
        for name in outputs:
            found[name][part] = r[:, signals.output_names.index(name)]
    return found


def _free(model: Model, run: Run, part: slice) -> Float[np.ndarray, "samples outputs"]:
    u, y = record_arrays(model, run, part)
    t, count = run.t[part], part.stop - part.start
    length = bucket(count)
    dt = np.zeros(length)
    dt[: count - 1] = np.diff(t)
    f = jnp.zeros((length, len(model.plant.signals.faults)))
    start = start_from_samples(model, run, part)
    predicted = free_run(
        start.plant,
        jnp.asarray(start.x),
        jnp.asarray(pad(u, length)),
        jnp.asarray(dt),
        f,
        substeps_for(run.step, model.max_step),
    ).y
    return y - np.asarray(predicted)[:count]


def _measured(model: Model, run: Run, part: slice) -> Float[np.ndarray, "samples outputs"]:
    signals = model.plant.signals
    columns = [state_column(signals, name, list(run.columns)) for name in signals.state_names]
    hidden = [n for n, c in zip(signals.state_names, columns, strict=True) if c is None]
    if hidden:
        raise InputError(
            f"{run.source}: --reference measured needs every state measured, but "
            f"{', '.join(hidden)} has no column; use --reference free or observer."
        )
    u, y = record_arrays(model, run, part)
    x = np.stack([run.columns[c][part] for c in columns if c is not None], axis=1)
    dt = np.append(np.diff(run.t[part]), 0.0)
    substeps = substeps_for(run.step, model.max_step)
    static, ahead = _beside(model.plant, jnp.asarray(x), jnp.asarray(u), jnp.asarray(dt), substeps)
    predicted = np.asarray(static).copy()
    for j, output in enumerate(signals.outputs):
        if output.measures is not None:
            state = signals.state_names.index(output.measures)
            predicted[1:, j] = np.asarray(ahead)[:-1, state]
    return y - predicted


@eqx.filter_jit
def _beside(
    plant: Plant,
    x: Float[Array, "samples states"],
    u: Float[Array, "samples inputs"],
    dt: Float[Array, "samples"],
    substeps: int,
) -> tuple[Float[Array, "samples outputs"], Float[Array, "samples states"]]:
    """(h at the measured states, the states one sample later)."""
    healthy = jnp.zeros(len(plant.signals.faults))
    u_next = jnp.concatenate([u[1:], u[-1:]])
    static = jax.vmap(lambda x, u: respond(plant, x, u)[1])(x, u)
    ahead = jax.vmap(lambda x, u, v, dt: integrate(plant, x, u, v, healthy, dt, substeps))(
        x, u, u_next, dt
    )
    return static, ahead


def _observed(model: Model, run: Run, part: slice) -> Float[np.ndarray, "samples outputs"]:
    design = design_luenberger(
        model.plant,
        operating_points(model),
        run.step,
        bandwidth_of(model, run.step),
        measured_outputs(model, [run]),
        model.max_step,
    )
    u, y = record_arrays(model, run, part)
    start = start_from_samples(model, run, part)
    innovation = run_observer(design.observer, start, u, y, run.t[part])[1]
    return np.where(np.isfinite(y), innovation, np.nan)
