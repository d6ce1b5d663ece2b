"""`fit`: from a plant file and healthy logs to a model, validated by free run."""

import platform
from collections.abc import Callable, Sequence
from importlib import metadata
from typing import Any, NamedTuple

import jax
import numpy as np

from faultgauge.errors import InputError
from faultgauge.identification.algorithms import AlgorithmName
from faultgauge.identification.equation_error import Group, fit_group, groups, scale_networks
from faultgauge.identification.holdout import split
from faultgauge.identification.levenberg_marquardt import (
    CONVERGED,
    FAILED,
    NOT_CONVERGED,
    Solution,
)
from faultgauge.identification.samples import (
    Channels,
    Samples,
    Stretch,
    channels,
    collect,
    spread,
)
from faultgauge.identification.selection import free_run_errors, windows_from
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.simulation.free_run import RATE_STEP, fastest_rate
from faultgauge.telemetry import Run
from faultgauge.telemetry.resampling import cover

__all__ = ["FitReport", "fit"]

POINTS = 10_000  # training points kept; the paper advises 1,000 to 10,000
VALIDATION_POINTS = 2000
ENVELOPE_POINTS = 400


class GroupReport(NamedTuple):
    group: Group
    solution: Solution
    free_run: np.ndarray
    chosen: int


class FitReport(NamedTuple):
    """What happened during a fit: for the report, not needed to use the model."""

    groups: list[GroupReport]
    training: Samples
    stretches: list[Stretch]
    noise: dict[str, dict[str, float]]
    warnings: list[str]


def fit(
    plant: GrayBoxPlant,
    logs: Sequence[Run],
    validate: Sequence[Run] = (),
    *,
    seed: int = 0,
    restarts: int = 10,
    algorithm: AlgorithmName = "lm",
    progress: Callable[[str], None] = lambda text: None,
) -> tuple[Model, FitReport]:
    """Fit the unknowns of `plant` on healthy runs. The same seed gives the same bytes.

    Runs of `validate` stop and select, and never fit; a run that is in both is used for
    validation only. Without them the last 15 % of each run and spread windows are held out.
    `algorithm` is Levenberg-Marquardt or the paper's gradient descent with momentum.
    Raises `InputError` for logs that cannot determine the unknowns.
    """
    warnings = list(plant.spec.warnings)
    known = {run.content_hash for run in validate}
    doubled = [run.name for run in logs if run.content_hash in known]
    if doubled:
        warnings.append(
            f"{', '.join(doubled)}: given for fitting and for validation; used for validation only"
        )
    logs = [run for run in logs if run.content_hash not in known]
    if not logs:
        raise InputError("no run is left to fit: every log is also a --validate log; give another.")
    spec = plant.spec
    how = channels(spec, [*logs, *validate])
    if not how.outputs:
        raise InputError(
            f"none of the outputs {', '.join(spec.signals.output_names)} of plant {spec.name!r} "
            f"has a column in {logs[0].source}; name one with --map OUTPUT=EXPRESSION."
        )
    stretches, noise = collect(spec, logs, how)
    if validate:
        held, _ = collect(spec, validate, how)
        training = _join([s.samples for s in stretches])
        cuts = [[slice(0, len(s.t))] for s in held]
    else:
        masks, cuts = split(stretches)
        held = stretches
        training = _join(
            [s.samples.take(np.flatnonzero(m)) for s, m in zip(stretches, masks, strict=True)]
        )
    validation = _join(
        [s.samples.take(np.r_[cut]) for s, each in zip(held, cuts, strict=True) for cut in each]
    )
    training, validation = _thin(training, validation, how, spec, seed)
    windows = windows_from(held, cuts, spread(np.concatenate([s.measured for s in stretches])))
    plant, reports = _fit_groups(
        plant, how, training, validation, windows, seed, restarts, algorithm, progress, warnings
    )
    if reports:  # the last group's choice is the whole plant's
        error = reports[-1].free_run[reports[-1].chosen]
    else:
        error = free_run_errors([plant], windows, _max_step(plant, training))[0]
    if not np.isfinite(error):
        raise InputError(
            "every start diverges in free run on the held-out data; likely causes: (a) a sign or "
            "unit error in the plant file or --map, (b) an unstable plant logged in closed loop, "
            "(c) too little excitation. Check the report of `faultgauge inspect`."
        )
    record = _record(plant, how, training, logs, validate, stretches, noise, reports, seed)
    record["metrics"]["validation_free_run_nrmse"] = float(error)
    return Model(plant, record), FitReport(reports, training, stretches, noise, warnings)


def _fit_groups(
    plant: GrayBoxPlant,
    how: Channels,
    training: Samples,
    validation: Samples,
    windows: Any,
    seed: int,
    restarts: int,
    algorithm: AlgorithmName,
    progress: Callable[[str], None],
    warnings: list[str],
) -> tuple[GrayBoxPlant, list[GroupReport]]:
    """Fit every group, take the best by equation error, then select each by free run."""
    found, reports = [], []
    for number, group in enumerate(groups(plant.spec, how.outputs)):
        progress(f"fitting {group.name}")
        plant = scale_networks(plant, group, training)
        rngs = [np.random.default_rng([seed, number, k]) for k in range(restarts)]
        plants, solution = fit_group(plant, group, training, validation, rngs, algorithm=algorithm)
        _judge(group, solution, warnings)
        plant = plants[int(np.nanargmin(_ranked(solution)))]
        found.append((group, plants, solution))
    max_step = _max_step(plant, training)
    for group, plants, solution in found:
        progress(f"selecting {group.name} by free run")
        candidates = [_exchange(plant, other, group) for other in plants]
        errors = free_run_errors(candidates, windows, max_step)
        errors = np.where(solution.status == FAILED, np.inf, errors)
        # the file's own start wins ties, then the earliest: the same bytes on every run
        chosen = int(np.argmin(np.round(errors, 12)))
        plant = candidates[chosen]
        if solution.status[chosen] == NOT_CONVERGED:
            warnings.append(
                f"{group.name}: not converged after {solution.trials[chosen]} trials; the fit may "
                "still be good (see its validation), more data or fewer hidden units would help"
            )
        reports.append(GroupReport(group, solution, errors, chosen))
    return plant, reports


def _ranked(solution: Solution) -> np.ndarray:
    return np.where(solution.status == FAILED, np.inf, solution.validation_cost)


def _judge(group: Group, solution: Solution, warnings: list[str]) -> None:
    failed = int(np.sum(solution.status == FAILED))
    if failed == len(solution.status):
        raise InputError(
            f"{group.name}: no start has a finite cost; likely causes: (a) sqrt, log or a division "
            "by zero inside the range of the logs, (b) a parameter value or bound that makes the "
            "expression infinite; protect the expression with max() or set min and max."
        )
    if failed:
        warnings.append(
            f"{group.name}: {failed} of {len(solution.status)} starts had no finite cost"
        )


def _exchange(plant: GrayBoxPlant, other: GrayBoxPlant, group: Group) -> GrayBoxPlant:
    """`plant` with the unknowns of `group` taken from `other`."""
    networks = {n: (other if n in group.networks else plant).networks[n] for n in plant.networks}
    parameters = {
        p: (other if p in group.parameters else plant).parameters[p] for p in plant.parameters
    }
    return GrayBoxPlant(plant.signals, plant.spec, networks, parameters)


def _join(parts: list[Samples]) -> Samples:
    return Samples(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _thin(
    training: Samples, validation: Samples, how: Channels, spec: Any, seed: int
) -> tuple[Samples, Samples]:
    """At most 10,000 and 2,000 points that cover the envelope."""
    if len(training.x) < 10 or len(validation.x) < 2:
        raise InputError(
            f"only {len(training.x)} training and {len(validation.x)} validation samples are left "
            "after smoothing; give a longer log."
        )
    kept = []
    for samples, count in ((training, POINTS), (validation, VALIDATION_POINTS)):
        points = np.concatenate([samples.x, samples.u], axis=1)
        kept.append(samples.take(cover(points, count, np.random.default_rng(seed))))
    return kept[0], kept[1]


def _max_step(plant: GrayBoxPlant, training: Samples) -> float:
    points = training.take(np.linspace(0, len(training.x) - 1, 500).astype(int))
    rate = fastest_rate(plant, points.x, points.u)
    return RATE_STEP / rate if rate > 0 else 1e9


def _record(
    plant: GrayBoxPlant,
    how: Channels,
    training: Samples,
    logs: Sequence[Run],
    validate: Sequence[Run],
    stretches: list[Stretch],
    noise: dict[str, dict[str, float]],
    reports: list[GroupReport],
    seed: int,
) -> dict[str, Any]:
    names = (*plant.signals.state_names, *plant.signals.input_names)
    points = np.concatenate([training.x, training.u], axis=1)
    thinned = cover(points, ENVELOPE_POINTS, np.random.default_rng(0))
    return {
        "seed": seed,
        "max_step": _max_step(plant, training),
        "sample_time": float(np.median([s.step for s in stretches])),
        "envelope": {
            name: [float(column.min()), float(column.max())]
            for name, column in zip(names, points.T, strict=True)
        },
        "envelope_points": points[thinned].tolist(),
        "columns": {"states": [list(s) for s in how.states], "outputs": list(how.outputs)},
        "derivatives": noise,
        "data": {
            "fit": sorted(run.content_hash for run in logs),
            "validate": sorted(run.content_hash for run in validate),
        },
        "metrics": {
            "groups": [
                {
                    "unknowns": report.group.name,
                    "starts": len(report.solution.status),
                    "converged": int(np.sum(report.solution.status == CONVERGED)),
                    "trials": int(report.solution.trials[report.chosen]),
                    "chosen": report.chosen,
                    "free_run_nrmse": float(report.free_run[report.chosen]),
                }
                for report in reports
            ],
        },
        "versions": {
            "faultgauge": metadata.version("faultgauge"),
            "jax": jax.__version__,
            "numpy": np.__version__,
            "machine": platform.machine(),
        },
    }
