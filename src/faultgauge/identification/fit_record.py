"""What comes out of the stages of a fit, and the record of it that the model keeps."""

import platform
from collections.abc import Sequence
from importlib import metadata
from typing import Any, NamedTuple

import jax
import numpy as np

from faultgauge.identification.between_runs import between_runs
from faultgauge.identification.constants import ConstantsInformation
from faultgauge.identification.equation.fit import EquationFit, GroupReport, Material, max_step
from faultgauge.identification.equation.uncertainty import equation_information
from faultgauge.identification.optimise.levenberg_marquardt import CONVERGED
from faultgauge.identification.samples import Channels, Samples
from faultgauge.identification.simulation_error.result import Refinement
from faultgauge.identification.sizes import chosen_sizes
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.record import FitRecord
from faultgauge.plants.spec import PlantSpec
from faultgauge.telemetry import Run, rate_of
from faultgauge.telemetry.resampling import cover

__all__ = ["Anew", "Equations", "FitReport", "Outcome", "fit_record", "of_spread", "outcome"]

ENVELOPE_POINTS = 400  # of training, kept in the model


class Equations(NamedTuple):
    """What equation error `found` in what was `given`; `sized` is the plant that was begun with,
    its open sizes chosen."""

    found: EquationFit
    given: Material
    sized: GrayBoxPlant
    warnings: list[str]

    @property
    def starts(self) -> list[GrayBoxPlant]:
        """Of a refinement."""
        return [self.found.plant, *self.found.others]

    def information(self, how: Channels) -> ConstantsInformation:
        return equation_information(self.found.plant, how, self.found.reports, self.given)


class Outcome(NamedTuple):
    """A fitted plant, the points that it was fitted to, its free run's error on held-out data (a
    share of the outputs' spread), its longest step [s] and that of the logs [s]."""

    plant: GrayBoxPlant
    training: Samples
    error: float
    max_step: float
    sample_time: float


class Anew(NamedTuple):
    """Free runs that begin at the held-out part of each log: their error, as a share of each
    output's standard deviation, and how long the longest is [s]; and the same `through` whole
    stretches, `whole` [s]."""

    error: float
    seconds: float
    through: float
    whole: float


class FitReport(NamedTuple):
    """What happened during a fit: for the report, not needed to use the model.

    `training` holds the points that were fitted; `noise` what smoothing left per state;
    `information` what they say about the parameters, where equation error had the last word;
    `anew` are free runs of a refined model that is far off in those through whole logs, and of one
    by equation error that contradicts itself; `no_use` is that of the `warnings` which says that
    the free run is far off.
    """

    groups: list[GroupReport]
    training: Samples
    noise: dict[str, dict[str, float]]
    warnings: list[str]
    refinement: Refinement | None = None
    information: ConstantsInformation | None = None
    anew: Anew | None = None
    no_use: str | None = None

    def free_run(self, error: float) -> str:
        """What the free run is off by on held-out data, and over which time where that matters;
        `error` is that of the fit's choice, a share."""
        outputs = self.training.y.shape[1]
        said = of_spread(error, outputs)
        if self.anew is None or not self.anew.error < self.anew.through:
            return said if self.refinement is None else f"{said} in runs through whole logs"
        return (
            f"{of_spread(self.anew.error, outputs)} within {self.anew.seconds:.4g} s, and by "
            f"{100 * self.anew.through:.2f} % in runs through whole logs (up to "
            f"{self.anew.whole:.4g} s), in which small errors add up"
        )


def of_spread(error: float, outputs: int) -> str:
    """The error of a free run, a share, in words: of so many `outputs` in their mean."""
    share = f"{100 * error:.2f} % of"
    if outputs == 1:
        return f"{share} the output's standard deviation"
    return f"{share} an output's standard deviation (in the mean of all)"


def outcome(stage: Equations | None, refinement: Refinement | None) -> Outcome:
    """Of the last stage, one of which there was."""
    if refinement is not None:
        found, step = refinement, refinement.sample_time
        return Outcome(found.plant, found.training, found.error, step / found.substeps, step)
    assert stage is not None
    found, training = stage.found, stage.given.training
    step = float(np.median([s.step for s in stage.given.stretches]))
    return Outcome(found.plant, training, found.error, max_step(found.plant, training), step)


def fit_record(
    spec: PlantSpec,
    result: Outcome,
    how: Channels,
    logs: Sequence[Run],
    validate: Sequence[Run],
    stage: Equations | None,
    refinement: Refinement | None,
    known: ConstantsInformation | None,
    floor: dict[str, Any],
    seed: int,
    delays: dict[str, float],
) -> FitRecord:
    """The record of a fit of what `spec` left open; `known` is what equation error tells of
    constants, where it had the last word, `floor` the noise of every column, `delays` the dead
    times that the rows of the logs have."""
    told = refinement.information if refinement else known
    record: dict[str, Any] = {
        "seed": seed,
        "max_step": result.max_step,
        "sample_time": result.sample_time,
        **_envelope(result),
        "columns": {
            "states": [list(s or ("", 0)) for s in how.states],
            "outputs": list(how.outputs),
        },
        "derivatives": stage.given.noise if stage else {},
        "data": {
            "fit": sorted(run.content_hash for run in logs),
            "validate": sorted(run.content_hash for run in validate),
        },
        "metrics": {
            "validation_free_run_nrmse": result.error,
            "groups": [_group(report) for report in stage.found.reports] if stage else [],
        },
        "noise": floor,
        "versions": _versions(),
    }
    if refinement is not None:
        record["metrics"]["refinement"] = refinement.metrics()
        if refinement.per_run:
            lasting = refinement.information.residual_time * result.sample_time
            known_by = result.plant, result.training, result.error, lasting
            record["between"] = between_runs(*known_by, refinement.per_run)
    if stage is not None and stage.given.explained:
        record["instruments"] = stage.given.explained
    if told is not None:
        record["constants"] = told.for_bank()
    if spec.open_holds or spec.open_sizes or delays:
        hold = refinement.choices["hold"] if refinement else {}
        hidden = chosen_sizes(spec, result.plant)
        record["choices"] = {"hold": hold, "hidden": hidden} | ({"delay": delays} if delays else {})
    rate = rate_of([*logs, *validate])
    if rate is not None:
        steps = [run.logged for run in logs if run.logged is not None]
        record |= {"resample": rate, "log_step": float(np.median(steps))}
    return FitRecord.model_validate(record)


def _envelope(result: Outcome) -> dict[str, Any]:
    signals = result.plant.signals
    names = (*signals.state_names, *signals.input_names)
    points = np.concatenate([result.training.x, result.training.u], axis=1)
    thinned = cover(points, ENVELOPE_POINTS, np.random.default_rng(0))
    ranges = {
        name: [float(column.min()), float(column.max())]
        for name, column in zip(names, points.T, strict=True)
    }
    return {"envelope": ranges, "envelope_points": points[thinned].tolist()}


def _versions() -> dict[str, str]:
    return {
        "faultgauge": metadata.version("faultgauge"),
        "jax": jax.__version__,
        "numpy": np.__version__,
        "machine": platform.machine(),
    }


def _group(report: GroupReport) -> dict[str, Any]:
    where = {} if report.crowded is None else {"crowded": report.crowded}
    return {
        "unknowns": report.group.name,
        "form": report.form,
        "starts": len(report.solution.status),
        "converged": int(np.sum(report.solution.status == CONVERGED)),
        "trials": int(report.solution.trials[report.chosen]),
        "chosen": report.chosen,
        **where,
        "free_run_nrmse": float(report.free_run[report.chosen]),
    }
