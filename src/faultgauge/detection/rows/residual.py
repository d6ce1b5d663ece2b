"""The residual r = y - yhat (paper, eq 9) against one of three healthy references."""

from dataclasses import dataclass, replace
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.detection.rows.along import Along, placed
from faultgauge.detection.rows.judged import (
    bandwidth_of,
    measured_outputs,
    operating_points,
    rows_between,
    samples_to_start,
    start_from_samples,
    steps_to,
    stretches,
)
from faultgauge.detection.rows.prepared import Prepared, StretchStart, as_it_acts
from faultgauge.errors import InputError
from faultgauge.identification.samples import state_column
from faultgauge.observers import Observer
from faultgauge.observers.luenberger import design_luenberger
from faultgauge.observers.measured_states import MeasuredStates
from faultgauge.observers.open_loop import OpenLoop
from faultgauge.plants.model import Model
from faultgauge.simulation.free_run import bucket, free_run, pad, substeps_for
from faultgauge.telemetry import Run

__all__ = [
    "REFERENCES",
    "HealthyReference",
    "Reference",
    "Residuals",
    "curved_inputs",
    "residuals",
    "residuals_of",
]

Reference = Literal["free", "measured", "observer"]
REFERENCES: tuple[Reference, ...] = ("free", "measured", "observer")


def residuals(
    model: Model, log: Run, reference: Reference
) -> dict[str, Float[np.ndarray, "samples"]]:
    """r per measured output, one row per sample, NaN where nothing was sampled.

    `free`: the model runs from the stretch's first state on the inputs alone. `measured`: it is
    fed with the measured states at every sample; an output that is itself a state is predicted
    from the sample before. `observer`: a state observer without a fault follows the outputs. There
    is none at the samples that a hidden first state was found from.
    """
    return residuals_of(model, as_it_acts(model.plant.signals, log), reference)


def residuals_of(
    model: Model, acting: Prepared, reference: Reference
) -> dict[str, Float[np.ndarray, "samples"]]:
    """The same of a run whose inputs are given as they act."""
    if reference == "free" and curved_inputs(model):
        return _free(model, acting)
    return Residuals(model, acting.run, reference).push(acting)


class Residuals:
    """Those of one run or stream, whose inputs are given as they act."""

    def __init__(self, model: Model, run: Run, reference: Reference) -> None:
        """Raises `InputError` where `run` has not the columns that the reference needs."""
        self.healthy = HealthyReference.of(model, run, reference)
        self.along = Along(self.healthy)

    def push(self, rows: Prepared) -> dict[str, Float[np.ndarray, "samples"]]:
        """r of the next `rows`, however many."""
        names, said = self.healthy.model.plant.signals.output_names, self.along.push(rows)
        infos = said.joined()
        if infos is None:
            return {name: np.full(len(rows.u), np.nan) for name in self.healthy.outputs}
        return {
            name: rows.run.own(name) - placed(said, infos.y[:, names.index(name)])
            for name in self.healthy.outputs
        }


def curved_inputs(model: Model) -> list[str]:
    """Inputs whose course between two samples takes samples of the future to know."""
    return [each.name for each in model.plant.signals.inputs if each.hold == "band-limited"]


@dataclass(frozen=True)
class HealthyReference:
    """A reference for one run: `judge` answers every sample with yhat.

    `outputs` have a column; `names`, all but those of slow sensors, must be sampled throughout a
    stretch; `states` are the columns that the judge is fed with, if it is.
    """

    model: Model
    judge: Observer | MeasuredStates
    outputs: tuple[str, ...]
    names: tuple[str, ...]
    states: tuple[str, ...] = ()

    @staticmethod
    def of(model: Model, run: Run, reference: Reference) -> "HealthyReference":
        """Raises `InputError` where `run` has not the columns that the reference needs."""
        signals = model.plant.signals
        outputs = tuple(name for name in signals.output_names if name in run.columns)
        steady = [name for name in outputs if rows_between([run], name) == 1]
        names = (*signals.input_names, *steady)
        substeps = substeps_for(run.step, model.max_step)
        if reference == "free":
            return HealthyReference(model, OpenLoop(model.plant, -1, substeps), outputs, names)
        if reference == "measured":
            judge = MeasuredStates(model.plant, substeps)
            return HealthyReference(model, judge, outputs, names, _state_columns(model, run))
        measured = measured_outputs(model, [run])
        # placed for the fastest sensor; a slower one beside it corrects less often, and so later
        step = run.step * min(rows_between([run], name) for name in measured)
        design = design_luenberger(
            model.plant,
            operating_points(model),
            step,
            bandwidth_of(model, step),
            measured,
            model.max_step,
        )
        judge = replace(design.observer, substeps=substeps)
        return HealthyReference(model, judge, outputs, names)

    @property
    def opening(self) -> tuple[str, ...]:
        """The columns that its first sample must have."""
        return tuple(dict.fromkeys([*self.names, *self.outputs]))

    def begin(self, start: StretchStart, u: Float[np.ndarray, "inputs"]) -> tuple[Any, Any]:
        """(judge with the run's own plant, its first state)."""
        judge = eqx.tree_at(lambda each: each.plant, self.judge, start.plant)
        return judge, judge.init(jnp.asarray(start.x), jnp.asarray(u))

    def samples(self, rows: Prepared) -> tuple[Float[np.ndarray, "samples ..."], ...]:
        """What the judge's step is given: u, y, dt and, where it is fed with them, the states."""
        given = (rows.u, rows.y, steps_to(rows.run.t))
        if not self.states:
            return given
        return *given, np.stack([rows.run.own(name) for name in self.states], axis=1)


def _state_columns(model: Model, run: Run) -> tuple[str, ...]:
    signals = model.plant.signals
    columns = [state_column(signals, name, list(run.columns)) for name in signals.state_names]
    hidden = [n for n, c in zip(signals.state_names, columns, strict=True) if c is None]
    if hidden:
        raise InputError(
            f"{run.source}: --reference measured needs every state measured, but "
            f"{', '.join(hidden)} has no column; use --reference free or observer."
        )
    return tuple(c for c in columns if c is not None)


def _free(model: Model, acting: Prepared) -> dict[str, Float[np.ndarray, "samples"]]:
    """Free runs with the true course of band-limited inputs, whole stretches at once."""
    signals, run = model.plant.signals, acting.run
    healthy = HealthyReference.of(model, run, "free")
    found = {name: np.full(len(run.t), np.nan) for name in healthy.outputs}
    substeps = substeps_for(run.step, model.max_step)
    for part in stretches(run, healthy.names, healthy.opening):
        stretch = acting.cut(part)
        start = start_from_samples(model, stretch)
        t, count = run.t[part], part.stop - part.start
        length = bucket(count)
        dt = np.zeros(length)
        dt[: count - 1] = np.diff(t)
        f = np.zeros((length, len(signals.faults)))
        x, u, dt, f = map(jax.device_put, (start.x, pad(stretch.u, length), dt, f))
        r = stretch.y - np.asarray(free_run(start.plant, x, u, dt, f, substeps).y)[:count]
        r[: samples_to_start(model, run.columns) - 1] = np.nan
        for name in healthy.outputs:
            found[name][part] = r[:, signals.output_names.index(name)]
    return found
