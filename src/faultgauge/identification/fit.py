"""`fit`: from a plant file and healthy logs to a model, validated by free run."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from faultgauge.errors import InputError
from faultgauge.identification.command_checks import response_warnings
from faultgauge.identification.constants import contradictions
from faultgauge.identification.equation.fit import (
    EquationFit,
    fit_equations,
    material,
    max_step,
)
from faultgauge.identification.equation.instruments import reference_columns
from faultgauge.identification.fit_record import (
    Equations,
    FitReport,
    Outcome,
    fit_record,
    outcome,
)
from faultgauge.identification.log_checks import log_warnings
from faultgauge.identification.noise_floor import noise_floor
from faultgauge.identification.optimise.algorithms import AlgorithmName
from faultgauge.identification.row_order import rows_late, rows_late_warnings
from faultgauge.identification.samples import Channels, channels, in_effect, slow_columns
from faultgauge.identification.simulation_error.result import Refinement, refine_on_logs
from faultgauge.identification.sizes import chosen_sizes, smallest_sufficient, with_hidden
from faultgauge.identification.unseen import run_anew, run_through, through_whole
from faultgauge.identification.validation.evaluation import (
    POOR_FREE_RUN,
    divergence,
    predict,
    too_short,
)
from faultgauge.identification.validation.growth import growth
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.settle import settle
from faultgauge.plants.signals import Signals
from faultgauge.plants.spec import PlantSpec
from faultgauge.progress import within
from faultgauge.telemetry import Run, rate_of

__all__ = ["FitReport", "fit"]

EQUATIONS = 0.2  # of the work, where a refinement follows

FOLLOWS = 0.1  # of the outputs' spread: a free run that is off by less follows
FOLDS = 5.0  # in which an error of a hundredth becomes one of the whole
LOOK_FOR = (
    "look for outliers (--robust), a stuck sensor or wrong units, give better parameter values, "
    "more restarts or more excitation, make inputs of outputs that the plant does not set itself, "
    "or add what the plant file lacks"
)
LOOSE = 0.1  # share of an input that its instrument explains, below which a fit is loose

INSTRUMENT_UNUSED = (
    "an instrument frees the equation error of the loop's bias and does nothing for the "
    "refinement, which simulates; where disturbances move the plant, compare with --no-refine"
)


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
    goes on to simulation error (None: where equation error cannot treat a hidden state, a parameter
    that varies or a sensor slower than the rows, where it is far off or the file's own values run
    better, and where one of the next two is asked for); `robust` bounds what an outlier can do;
    `ensemble` keeps the next best as `members`. Raises `InputError` for logs of too little.
    """
    _check_refined(refine, robust, ensemble)
    plant = _as_resampled(plant, [*logs, *validate])
    plant, delays = _as_rows_are_written(plant, logs)
    spec, warnings = plant.spec, [*plant.spec.warnings, *rows_late_warnings(plant.spec, delays)]
    logs = _not_validated(logs, validate, warnings)
    how = _seen(spec, runs := [*logs, *validate])
    warnings += [*log_warnings(spec.signals, runs), *too_short(plant, runs)]
    by_simulation = _by_simulation(spec, how, refine)
    goes_on = refine is None and not spec.signals.instruments  # where equation error sees nothing
    asked, slow = bool(by_simulation or ensemble or robust), slow_columns(how, logs)
    refine = _refined(spec, slow, refine, asked, warnings)
    acting, unseen = ([in_effect(spec.signals, run) for run in runs] for runs in (logs, validate))
    stage = refinement = None
    if not by_simulation:
        how = replace(how, references=reference_columns(spec.signals, logs))
        told = within(progress, 0.0, EQUATIONS if refine else 1.0)
        stage = _by_equations(plant, acting, unseen, how, seed, restarts, algorithm, told)
        warnings += stage.warnings
        refine = refine or (goes_on and _is_poor(plant, stage, acting))
    if refine:
        begun = (stage.sized, stage.starts) if stage else (plant, [])
        told = within(progress, EQUATIONS if stage else 0.0, 1.0)
        refinement = refine_on_logs(*begun, acting, unseen, how, seed, restarts, robust, told)
        warnings += [*refinement.warnings, *_contradicted(stage, how, refinement)]
    result = _finite(outcome(stage, refinement), validate or logs)
    if known := stage.information(how) if stage and not refinement else None:
        warnings += known.warnings()
    if stage and result.error < 1:  # a model of no use says nothing about the input
        warnings += response_warnings(result.plant, stage.given.stretches, stage.given.noise)
    known_by = stage, refinement, known, noise_floor(spec.signals, acting)
    record = fit_record(spec, result, how, logs, validate, *known_by, seed, delays)
    model = Model(result.plant, record)
    if ensemble and refinement is not None:
        model = model.with_members(refinement.members[1:])
    groups, noise = (stage.found.reports, stage.given.noise) if stage else ([], {})
    account = FitReport(groups, result.training, noise, warnings, refinement, known)
    return model, _with_its_use(model, account, result, [] if validate else logs)


def _by_equations(
    plant: GrayBoxPlant,
    acting: Sequence[Run],
    unseen: Sequence[Run],
    how: Channels,
    seed: int,
    restarts: int,
    algorithm: AlgorithmName,
    progress: Callable[[str], None],
) -> Equations:
    spec = plant.spec
    given = material(spec, acting, unseen, how, seed)
    found = smallest_sufficient(
        plant,
        lambda sized: _error_and_stage(
            fit_equations(sized, how, given, seed, restarts, algorithm, progress)
        ),
    )
    if spec.open_sizes:
        plant = with_hidden(plant, chosen_sizes(spec, found.plant))
    warnings = [*found.warnings, *_loose(spec.signals, given.explained)]
    return Equations(found, given, plant, warnings)


def _is_poor(plant: GrayBoxPlant, stage: Equations, logs: Sequence[Run]) -> bool:
    """Whether equation error is far off on held-out data, or the file's values run better, there or
    through whole `logs`: what comes and goes by itself is in the start of a short free run, and a
    state that hardly moves looks good in one. Without an input there is nothing to follow: noise
    carries off every free run, of which errors over one step tell more."""
    found = stage.found
    if any(each.stated for each in found.reports):
        return True
    if not plant.signals.inputs:
        return False
    if POOR_FREE_RUN <= found.error < np.inf:
        return True
    if plant.spec.networks or found.error < FOLLOWS:
        return False
    longest = [max_step(each, stage.given.training) for each in (found.plant, plant)]
    as_fitted, as_stated = (
        through_whole(each, logs, step)
        for each, step in zip((found.plant, plant), longest, strict=True)
    )
    return as_stated < as_fitted


def _contradicted(stage: Equations | None, how: Channels, refinement: Refinement) -> list[str]:
    """Constants that the refinement has elsewhere than simulated instruments had them."""
    if stage is None or not any(each.form == "instrumental" for each in stage.found.reports):
        return []
    before = stage.information(how)
    return contradictions(before.constants, refinement.information.constants)


def _check_refined(refine: bool | None, robust: bool, ensemble: bool) -> None:
    if (ensemble or robust) and refine is False:
        option = "--ensemble" if ensemble else "--robust"
        raise InputError(
            f"{option} is about the refinement, which --no-refine leaves out; leave one of the two "
            "away."
        )


def _seen(spec: PlantSpec, runs: Sequence[Run]) -> Channels:
    """Where states and outputs come from. Raises where no output has a column."""
    how = channels(spec, runs)
    if not how.outputs:
        raise InputError(
            f"none of the outputs {', '.join(spec.signals.output_names)} of plant {spec.name!r} "
            f"has a column in {runs[0].source}; name one with --map OUTPUT=EXPRESSION."
        )
    return how


def _as_resampled(plant: GrayBoxPlant, runs: Sequence[Run]) -> GrayBoxPlant:
    """`plant`, with no hold left open where `runs` were resampled: that took means, which are held
    in between."""
    if rate_of(runs) is None:
        return plant
    return replace(plant, spec=replace(plant.spec, open_holds=()))


def _as_rows_are_written(
    plant: GrayBoxPlant, logs: Sequence[Run]
) -> tuple[GrayBoxPlant, dict[str, float]]:
    """`plant`, with the dead times [s] that the rows of `logs` have where the file leaves them
    open; these."""
    delays = rows_late(plant.spec, logs)
    spec = settle(plant.spec, delays=delays)
    return replace(plant, spec=spec, signals=spec.signals), delays


def _finite(result: Outcome, runs: Sequence[Run]) -> Outcome:
    """`result`. Raises where every start diverges."""
    if not np.isfinite(result.error):
        where = divergence(result.plant, predict(result.plant, runs, result.max_step))
        raise InputError(
            f"every start diverges on the held-out data, {where}; likely causes: (a) a sign or "
            "unit error in the plant file or --map, (b) an unstable plant logged in closed loop, "
            "(c) too little excitation. Check the report of `faultgauge inspect`."
        )
    return result


def _with_its_use(
    model: Model, account: FitReport, result: Outcome, logs: Sequence[Run]
) -> FitReport:
    """`account`, which warns where the model is of no use. Where a refined one is far off in runs
    through whole `logs`, it runs anew over what was held out of them; one by equation error that
    contradicts itself runs through whole ones."""
    known = account.information
    if logs and account.refinement is not None and result.error >= POOR_FREE_RUN:
        account = account._replace(anew=run_anew(model, account, logs, result.error))
    elif logs and known is not None and any(each.contradicted for each in known.constants):
        account = account._replace(anew=run_through(model, account, logs))
    no_use = _of_no_use(result, account)
    account.warnings.extend(no_use)
    return account._replace(no_use=next(iter(no_use), None))


def _of_no_use(result: Outcome, account: FitReport) -> list[str]:
    """A warning where the free run is far off, wherever it begins: what integrates drifts in a long
    one, and may yet be right; of what runs away it tells nothing."""
    error = min(result.error, account.anew.error if account.anew else np.inf)
    if error < POOR_FREE_RUN:
        return []
    fold = 1 / max(growth(result.plant, result.training), 1e-300)
    if FOLDS * fold < result.sample_time * len(result.training.x):
        return [
            "without its loop the plant that was fitted runs away: what is off by a little is off "
            f"2.7 times as much {fold:.2g} s later, and no free run follows that, however good the "
            "model is; look at whether the constants are plausible, and fit with instrument in "
            "[inputs.NAME] where the log has what the loop follows"
        ]
    if error < 1:
        return [
            f"on held-out data the free run is off by {100 * error:.0f} % of each "
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


def _refined(
    spec: PlantSpec, slow: Sequence[str], refine: bool | None, asked: bool, warnings: list[str]
) -> bool:
    """Whether the fit goes on to simulation error; where that is left open, where a column is slow
    or it is `asked` for by the plant or an option."""
    if slow and refine is False:
        warnings.append(_between_samples(slow))
    found = bool(slow or asked) if refine is None else refine
    if spec.signals.instruments and found:
        warnings.append(INSTRUMENT_UNUSED)
    return found


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
