"""The data that a fit has not seen, and what the fitted model does on them."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from faultgauge.errors import InputError
from faultgauge.identification.fit_record import Anew, FitReport
from faultgauge.identification.holdout import LAST_SHARE
from faultgauge.identification.samples import Samples, channels, in_effect
from faultgauge.identification.validation.evaluation import (
    WARMUP,
    Prediction,
    evaluate,
    finds_start,
    predict,
)
from faultgauge.identification.validation.validate import Validation, validate
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.record import BetweenRuns
from faultgauge.telemetry import Run, cut, segments
from faultgauge.telemetry.runs import ROUNDING

__all__ = ["Unseen", "held_out", "on_unseen", "run_anew", "run_through", "through_whole"]


class Unseen(NamedTuple):
    """Scores as of `evaluate`, the free runs behind them, and the tests of a sceptic."""

    scores: dict[str, Any]
    predictions: list[Prediction]
    validation: Validation


def on_unseen(
    model: Model,
    account: FitReport,
    logs: Sequence[Run],
    held: Sequence[Run] = (),
    others: Sequence[tuple[Model, FitReport]] = (),
) -> Unseen | None:
    """The model on the runs `held` for validation; without any, on what its fit held out of
    `logs`. None where that is too short to run through.

    `others` are fits of the same logs with other seeds, tested beside it. A refinement that went on
    to fit the held-out part, too, is tested as it was before.
    """
    runs = list(held) or held_out(model, account, logs)
    if not runs:
        return None
    plant, training = _judged(model, account)
    try:
        between = model.record.between
        scores, predictions = evaluate(plant, runs, model.max_step, between=between)
    except InputError:  # nothing to score beside the warm-up
        return None
    beside = [
        predict(_judged(*other)[0], runs, other[0].max_step, between=other[0].record.between)
        for other in others
    ]
    checked = validate(plant, predictions, training, beside)
    return Unseen(scores, predictions, checked)


def run_anew(model: Model, account: FitReport, logs: Sequence[Run], through: float) -> Anew | None:
    """The free runs of `on_unseen` over what was held out of `logs`, where those `through` whole
    ones err by so much; None where that is too short to run through, or one diverges."""
    found = _errs(model, account, held_out(model, account, logs))
    return Anew(*found, through, _longest(model, logs)) if found else None


def run_through(model: Model, account: FitReport, logs: Sequence[Run]) -> Anew | None:
    """Free runs through whole `logs` beside those of equation error over what it held out, whose
    error the record has; None where one diverges."""
    found, longest = _errs(model, account, logs), _longest(model, logs)
    error = model.record.metrics.free_run_error
    return Anew(error, LAST_SHARE * longest, found[0], longest) if found else None


def through_whole(plant: GrayBoxPlant, logs: Sequence[Run], longest: float) -> float:
    """What free runs of `plant` through whole `logs`, by steps of `longest` [s] at most, are off
    by, a share of the outputs' spread; infinite where one diverges."""
    found = _off(plant, logs, longest, None)
    return found[0] if found else np.inf


def _errs(model: Model, account: FitReport, runs: Sequence[Run]) -> tuple[float, float] | None:
    """(what free runs through `runs` are off by, how long the longest is scored [s])."""
    return _off(_judged(model, account)[0], runs, model.max_step, model.record.between)


def _off(
    plant: GrayBoxPlant, runs: Sequence[Run], max_step: float, between: BetweenRuns | None
) -> tuple[float, float] | None:
    try:
        found, parts = evaluate(plant, runs, max_step, between=between)
    except InputError:  # nothing to score beside the warm-up
        return None
    scored = found["outputs"].values()
    shares = [each["nrmse"] for each in scored if each["nrmse"] is not None]
    if not shares or any(each["rmse"] is None for each in scored):
        return None
    lasts = [float(part.t[-1] - part.t[part.warmup]) for part in parts]
    return float(np.sqrt(np.mean(np.square(shares)))), max(lasts)


def _longest(model: Model, logs: Sequence[Run]) -> float:
    """The longest stretch of `logs` [s]."""
    names = model.plant.signals.input_names
    whole = [run.t[part] for run in logs for part in segments(run, names)]
    return float(max(t[-1] - t[0] for t in whole))


def _judged(model: Model, account: FitReport) -> tuple[GrayBoxPlant, Samples]:
    """The plant before it was fitted to what was held out, and the points it was fitted to."""
    if account.refinement is None:
        return model.plant, account.training
    return account.refinement.judged.plants[0], account.refinement.judged.training


def held_out(model: Model, account: FitReport, logs: Sequence[Run]) -> list[Run]:
    """The last 15 % of every stretch of `logs`, each a run of its own: no stage has fitted them.

    A stretch ends where the stage that fits needs it to: equation error where any column is
    empty, simulation error where an input is. Where a free run has to find its start, the samples
    of its warm-up come before: the fit has seen them, and they are not scored.
    """
    signals = model.plant.signals
    how = channels(model.plant.spec, logs)
    needed = [how.needed] if account.groups else []
    needed += [how.inputs] if account.refinement else []
    delay = max((each.delay for each in signals.inputs), default=0.0)
    lead = WARMUP if finds_start(model.plant, logs) else 0
    found = []
    for run in logs:
        acting = in_effect(signals, run)
        tails = np.ones(len(run.t), bool)
        for names in needed:
            tails &= _tails(acting, names)
        edges = np.flatnonzero(np.diff(tails, prepend=False, append=False)).reshape(-1, 2)
        for first, stop in edges[np.diff(edges)[:, 0] > 1].tolist():
            begin = max(first - lead, _start_of_stretch(acting, how.inputs, first))
            start = np.searchsorted(run.t, run.t[begin] - delay)  # commands that act from it on
            found.append(cut(run, slice(int(start), int(stop))))
    return found


def _start_of_stretch(run: Run, names: Iterable[str], sample: int) -> int:
    return next(part.start for part in segments(run, names) if sample < part.stop)


def _tails(run: Run, names: Iterable[str]) -> np.ndarray:
    tails = np.zeros(len(run.t), bool)
    for part in segments(run, names):
        t = run.t[part]
        length = t[-1] - t[0] + run.step
        tails[part] = t >= t[0] + (1 - LAST_SHARE) * length - ROUNDING * run.step
    return tails
