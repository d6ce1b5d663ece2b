"""`fit`: from a plant file and healthy logs to a model, validated by free run."""

import platform
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import metadata
from typing import Any, NamedTuple

import jax
import numpy as np

from faultgauge.errors import InputError
from faultgauge.identification.algorithms import AlgorithmName
from faultgauge.identification.command_checks import response_warnings
from faultgauge.identification.constants import Information, contradictions
from faultgauge.identification.equation_fit import (
    EquationFit,
    GroupReport,
    Material,
    fit_equations,
    material,
    max_step,
)
from faultgauge.identification.equation_uncertainty import equation_information
from faultgauge.identification.evaluation import divergence, predict, too_short
from faultgauge.identification.instruments import reference_columns
from faultgauge.identification.levenberg_marquardt import CONVERGED
from faultgauge.identification.log_checks import log_warnings
from faultgauge.identification.noise_floor import noise_floor
from faultgauge.identification.refinement.result import Refinement, refine_on_logs
from faultgauge.identification.samples import Channels, Samples, channels, in_effect, slow_columns
from faultgauge.identification.sizes import chosen_sizes, smallest_sufficient, with_hidden
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant_file import PlantSpec
from faultgauge.plants.signals import Signals
from faultgauge.telemetry import Run, rate_of
from faultgauge.telemetry.resampling import cover

__all__ = ["FitReport", "fit"]

ENVELOPE_POINTS = 400
POOR = 0.5  # of the outputs' spread: a quarter of the variance is not explained
LOOK_FOR = (
    "look for outliers (--robust), a stuck sensor or wrong units, give better parameter values, "
    "more restarts or more excitation, or add what the plant file lacks"
)
LOOSE = 0.1  # share of an input that its instrument explains, below which a fit is loose


class FitReport(NamedTuple):
    """What happened during a fit: for the report, not needed to use the model.

    `training` holds the points that were fitted; `noise` what smoothing left per state;
    `information` what they say about the parameters, where equation error had the last word.
    """

    groups: list[GroupReport]
    training: Samples
    noise: dict[str, dict[str, float]]
    warnings: list[str]
    refinement: Refinement | None = None
    information: Information | None = None


INSTRUMENT_UNUSED = (
    "an instrument frees the equation error of the loop's bias and does nothing for the "
    "refinement, which simulates; where disturbances move the plant, compare with --no-refine"
)


class _Result(NamedTuple):
    plant: GrayBoxPlant
    training: Samples
    error: float
    max_step: float
    sample_time: float


def fit(
    plant: GrayBoxPlant,
    logs: Sequence[Run],
    validate: Sequence[Run] = (),
    *,
    seed: int = 0,
    restarts: int = 10,
    algorithm: AlgorithmName = "lm",
    refine: bool | None = None,
    robust: bool = False,
    ensemble: bool = False,
    progress: Callable[[str], None] = lambda text: None,
) -> tuple[Model, FitReport]:
    """Fit the unknowns of `plant` on healthy runs. The same seed gives the same bytes.

    Runs of `validate` stop and select, and never fit; a run that is in both is used for
    validation only. Without them the last 15 % of each run and spread windows are held out.
    `algorithm` is Levenberg-Marquardt or the paper's gradient descent with momentum. `refine`
    goes on from equation error to simulation error (None: where a state is hidden, a parameter
    varies or a sensor is slower than the rows, which equation error cannot treat, where the file's
    own values run better than what it finds, and where one of the next two is asked for); `robust`
    bounds what an outlier can do to it; `ensemble` keeps its next best models in the model too, as
    `members`.
    Raises `InputError` for logs that cannot determine the unknowns.
    """
    if (ensemble or robust) and refine is False:
        option = "--ensemble" if ensemble else "--robust"
        raise InputError(
            f"{option} is about the refinement, which --no-refine leaves out; leave one of the two "
            "away."
        )
    rate = rate_of([*logs, *validate])
    if rate is not None:
        plant = _held_at_zero(plant)
    spec = plant.spec
    warnings = list(spec.warnings)
    logs = _not_validated(logs, validate, warnings)
    how = channels(spec, [*logs, *validate])
    if not how.outputs:
        raise InputError(
            f"none of the outputs {', '.join(spec.signals.output_names)} of plant {spec.name!r} "
            f"has a column in {logs[0].source}; name one with --map OUTPUT=EXPRESSION."
        )
    warnings += log_warnings(spec.signals, [*logs, *validate])
    warnings += too_short(plant, [*logs, *validate])
    by_simulation = _by_simulation(spec, how, refine)
    slow = slow_columns(how, logs)
    if slow and refine is False:
        warnings.append(_between_samples(slow))
    goes_on = refine is None and not spec.signals.instruments  # where equation error sees nothing
    refine = bool(by_simulation or slow or ensemble or robust) if refine is None else refine
    acting, unseen = ([in_effect(spec.signals, run) for run in runs] for runs in (logs, validate))
    groups: list[GroupReport] = []
    noise: dict[str, dict[str, float]] = {}
    warm: list[GrayBoxPlant] = []
    result = refinement = given = None
    if spec.signals.instruments and refine:
        warnings.append(INSTRUMENT_UNUSED)
    if not by_simulation:
        how = replace(how, references=reference_columns(spec.signals, logs))
        given = material(spec, acting, unseen, how, seed)
        stage = smallest_sufficient(
            plant,
            lambda sized: _error_and_stage(
                fit_equations(sized, how, given, seed, restarts, algorithm, progress)
            ),
        )
        warnings += [*stage.warnings, *_loose(spec.signals, given.explained)]
        groups, noise, warm = stage.reports, given.noise, [stage.plant, *stage.others]
        if spec.open_sizes:
            plant = with_hidden(plant, chosen_sizes(spec, stage.plant))
        result = _of_equations(stage, given)
        refine = refine or (goes_on and any(each.stated for each in groups))
    if refine:
        refinement = refine_on_logs(
            plant, warm, acting, unseen, how, seed, restarts, robust, progress
        )
        warnings += refinement.warnings
        if (
            result is not None
            and given is not None
            and any(g.form == "instrumental" for g in groups)
        ):
            before = equation_information(result.plant, how, groups, given)
            warnings += contradictions(before.constants, refinement.information.constants)
        result = _of_refinement(refinement)
    assert result is not None
    warnings += _of_no_use(result, validate or logs)
    known = None
    if given is not None and refinement is None:
        known = equation_information(result.plant, how, groups, given)
        warnings += known.warnings()
    if given is not None and result.error < 1:  # a model of no use says nothing about the input
        warnings += response_warnings(result.plant, given.stretches, given.noise)
    record = _record(result, how, logs, validate, noise, groups, refinement, seed)
    if rate is not None:
        steps = [run.logged for run in logs if run.logged is not None]
        record |= {"resample": rate, "log_step": float(np.median(steps))}
    if given is not None and given.explained:
        record["instruments"] = given.explained
    record["noise"] = noise_floor(spec.signals, acting)
    told = refinement.information if refinement is not None else known
    if told is not None:
        record["constants"] = told.for_bank()
    if spec.open_holds or spec.open_sizes:
        record["choices"] = _choices(spec, result.plant, refinement)
    model = Model(result.plant, record)
    if ensemble and refinement is not None:
        model = model.with_members(refinement.members[1:])
    return model, FitReport(groups, result.training, noise, warnings, refinement, known)


def _held_at_zero(plant: GrayBoxPlant) -> GrayBoxPlant:
    """`plant` with no hold left open: resampling took means, which are held in between."""
    return replace(plant, spec=replace(plant.spec, open_holds=()))


def _of_no_use(result: _Result, runs: Sequence[Run]) -> list[str]:
    """A warning where the free run is far off. Raises where every start diverges."""
    if not np.isfinite(result.error):
        where = divergence(result.plant, predict(result.plant, runs, result.max_step))
        raise InputError(
            f"every start diverges on the held-out data, {where}; likely causes: (a) a sign or "
            "unit error in the plant file or --map, (b) an unstable plant logged in closed loop, "
            "(c) too little excitation. Check the report of `faultgauge inspect`."
        )
    if result.error < POOR:
        return []
    if result.error < 1:
        return [
            f"on held-out data the free run is off by {100 * result.error:.0f} % of each "
            f"output's standard deviation, which is little to rely on: {LOOK_FOR}"
        ]
    return [
        "on held-out data the free run is worse than each output's mean would be: do not use "
        f"this model; {LOOK_FOR}"
    ]


def _by_simulation(spec: PlantSpec, how: Channels, refine: bool | None) -> list[str]:
    """Hidden states, varying parameters and what a fleet says of some: simulation error alone can
    find them, or heed it."""
    told = [each.name for each in spec.networks if each.known]
    told += [p.name for p in spec.parameters if p.vary or p.spread is not None]
    names = [*how.hidden, *told]
    if names and refine is False:
        raise InputError(
            f"{', '.join(names)} of plant {spec.name!r}: hidden states and varying parameters are "
            "found by simulation error only; leave the refinement on."
        )
    return names


def _between_samples(slow: Sequence[str]) -> str:
    names = ", ".join(map(repr, slow))
    return (
        f"column {names} is sampled more slowly than the rows, and equation error takes the slopes "
        "between its samples for derivatives, which biases constants; use --refine"
    )


def _error_and_stage(stage: EquationFit) -> tuple[float, EquationFit]:
    return stage.error, stage


def _loose(signals: Signals, explained: dict[str, float]) -> list[str]:
    return [
        f"column {each.instrument!r}, the instrument of input {each.name!r}, explains only "
        f"{100 * explained[each.name]:.1f} % of it: the fit is free of the loop's bias, but "
        "loose; give logs in which the reference moves more"
        for each in signals.inputs
        if explained.get(each.name, 1.0) < LOOSE
    ]


def _choices(
    spec: PlantSpec, plant: GrayBoxPlant, refinement: Refinement | None
) -> dict[str, dict[str, Any]]:
    """What the file left open and the fit decided."""
    hold = refinement.choices["hold"] if refinement else {}
    return {"hold": hold, "hidden": chosen_sizes(spec, plant)}


def _of_equations(stage: EquationFit, given: Material) -> _Result:
    return _Result(
        stage.plant,
        given.training,
        stage.error,
        max_step(stage.plant, given.training),
        float(np.median([s.step for s in given.stretches])),
    )


def _of_refinement(found: Refinement) -> _Result:
    longest = found.sample_time / found.substeps
    return _Result(found.plant, found.training, found.error, longest, found.sample_time)


def _not_validated(logs: Sequence[Run], validate: Sequence[Run], warnings: list[str]) -> list[Run]:
    """The logs to fit: those that are not also given for validation."""
    known = {run.content_hash for run in validate}
    doubled = [run.name for run in logs if run.content_hash in known]
    if doubled:
        warnings.append(
            f"{', '.join(doubled)}: given for fitting and for validation; used for validation only"
        )
    left = [run for run in logs if run.content_hash not in known]
    if not left:
        raise InputError("no run is left to fit: every log is also a --validate log; give another.")
    return left


def _record(
    result: _Result,
    how: Channels,
    logs: Sequence[Run],
    validate: Sequence[Run],
    noise: dict[str, dict[str, float]],
    groups: Sequence[GroupReport],
    refinement: Refinement | None,
    seed: int,
) -> dict[str, Any]:
    signals = result.plant.signals
    names = (*signals.state_names, *signals.input_names)
    points = np.concatenate([result.training.x, result.training.u], axis=1)
    thinned = cover(points, ENVELOPE_POINTS, np.random.default_rng(0))
    record = {
        "seed": seed,
        "max_step": result.max_step,
        "sample_time": result.sample_time,
        "envelope": {
            name: [float(column.min()), float(column.max())]
            for name, column in zip(names, points.T, strict=True)
        },
        "envelope_points": points[thinned].tolist(),
        "columns": {
            "states": [list(s or ("", 0)) for s in how.states],
            "outputs": list(how.outputs),
        },
        "derivatives": noise,
        "data": {
            "fit": sorted(run.content_hash for run in logs),
            "validate": sorted(run.content_hash for run in validate),
        },
        "metrics": {
            "validation_free_run_nrmse": result.error,
            "groups": [_group(report) for report in groups],
        },
        "versions": {
            "faultgauge": metadata.version("faultgauge"),
            "jax": jax.__version__,
            "numpy": np.__version__,
            "machine": platform.machine(),
        },
    }
    if refinement is not None:
        record["metrics"]["refinement"] = refinement.metrics()
    return record


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
