"""The residual r = y - yhat (paper, eq 9) against one of three healthy references."""

from dataclasses import dataclass, replace
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.detection.judged import (
    Past,
    Start,
    bandwidth_of,
    measured_outputs,
    operating_points,
    record_arrays,
    rows_between,
    start_from_samples,
    steps_to,
    stretches,
)
from faultgauge.errors import InputError
from faultgauge.identification.samples import in_effect, state_column
from faultgauge.observers import Observer
from faultgauge.observers.follow import follow
from faultgauge.observers.luenberger import design_luenberger
from faultgauge.observers.measured_states import MeasuredStates
from faultgauge.observers.open_loop import OpenLoop
from faultgauge.plants.model import Model
from faultgauge.simulation.free_run import bucket, free_run, pad, substeps_for
from faultgauge.telemetry import Run

__all__ = ["REFERENCES", "HealthyReference", "Reference", "curved_inputs", "residuals"]

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
    healthy = HealthyReference.of(model, run, reference)
    found = {name: np.full(len(run.t), np.nan) for name in healthy.outputs}
    ahead = reference == "free" and curved_inputs(model)
    for part in stretches(run, healthy.names, healthy.opening):
        start = start_from_samples(model, run, part)
        if ahead:
            r = _free(model, run, part, start)
        else:
            u, y, *rest = healthy.samples(run, part)
            judge, state = healthy.begin(start, u[0])
            r = y - follow(judge, state, (u, y, *rest))[1].y
        for name in healthy.outputs:
            found[name][part] = r[:, signals.output_names.index(name)]
    return found


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

    def begin(
        self, start: Start, u: Float[np.ndarray, "inputs"], past: Past | None = None
    ) -> tuple[Any, Any]:
        """(judge with the run's own plant, its first state): a gap starts it anew."""
        judge = eqx.tree_at(lambda each: each.plant, self.judge, start.plant)
        return judge, judge.init(jnp.asarray(start.x), jnp.asarray(u))

    def samples(self, run: Run, part: slice) -> tuple[Float[np.ndarray, "samples ..."], ...]:
        """What the judge's step is given: u, y, dt and, where it is fed with them, the states."""
        given = (*record_arrays(self.model, run, part), steps_to(run.t[part]))
        if not self.states:
            return given
        return *given, np.stack([run.own(name)[part] for name in self.states], axis=1)


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


def _free(
    model: Model, run: Run, part: slice, start: Start
) -> Float[np.ndarray, "samples outputs"]:
    """The free run with the true course of band-limited inputs, all samples at once."""
    u, y = record_arrays(model, run, part)
    t, count = run.t[part], part.stop - part.start
    length = bucket(count)
    dt = np.zeros(length)
    dt[: count - 1] = np.diff(t)
    f = jnp.zeros((length, len(model.plant.signals.faults)))
    predicted = free_run(
        start.plant,
        jnp.asarray(start.x),
        jnp.asarray(pad(u, length)),
        jnp.asarray(dt),
        f,
        substeps_for(run.step, model.max_step),
    ).y
    return y - np.asarray(predicted)[:count]
