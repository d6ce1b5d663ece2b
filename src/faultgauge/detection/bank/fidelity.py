"""How far the model's answer to what acts on the plant is off, from free runs over healthy logs.

The plant's answer to a fault is known as its answer to an input is, and no better: with y what was
measured and h the free run, both less their means,

    shape^2 = |y - h|^2 / |y|^2,    gain = (h . y) / (h . h) - 1,

by how much the answer is off in all, where `fit` held data out, and in size alone, from run to run.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from faultgauge.errors import InputError
from faultgauge.identification.validation.evaluation import POOR_FREE_RUN, Prediction, predict
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run, cut

__all__ = ["LONGEST_PIECE", "gain_error", "largest_changes", "shape_error"]

LONGEST_PIECE = 20_000  # samples of a free run
USUAL_GAIN = 0.05  # as good as one more output of one more run
USUAL_SHAPE = 0.1  # where the free run is lost, as that of an unstable plant is


def shape_error(model: Model) -> float:
    """By which share the model's answer is off in all; 0 where nobody held data out."""
    found = model.record.metrics.validation_free_run_nrmse
    if found is None:
        return 0.0
    return float(found) if found < 1 else USUAL_SHAPE


def gain_error(model: Model, runs: Sequence[Run]) -> float:
    """By which share the size of the model's answer is off (r.m.s.), by every output that the free
    run follows in every one of `runs`: one that is off by half and more, as where a plant
    integrates, is carried off by what is no answer."""
    logs = [replace(cut(run, slice(0, LONGEST_PIECE)), name=str(k)) for k, run in enumerate(runs)]
    try:
        between = model.record.between
        predictions = predict(model.plant, logs, model.max_step, between=between)
    except InputError:  # nowhere two samples in a row: nothing to follow
        predictions = []
    gains = [g for each in predictions for g in _gains(each)]
    return float(np.sqrt((np.sum(np.square(gains)) + USUAL_GAIN**2) / (len(gains) + 1)))


def largest_changes(model: Model, runs: Sequence[Run]) -> dict[str, float]:
    """By how much each input changes from row to row of `runs` at most: what follows a larger
    change no healthy log has shown."""
    found = {}
    for name in model.plant.signals.input_names:
        told = [run.columns[name][np.isfinite(run.columns[name])] for run in runs]
        found[name] = max(float(np.abs(np.diff(u)).max(initial=0.0)) for u in told)
    return found


def _gains(prediction: Prediction) -> list[float]:
    """Of every output that the free run follows."""
    found = []
    for y, h in zip(prediction.measured.T, prediction.predicted.T, strict=True):
        y, h = y[prediction.warmup :], h[prediction.warmup :]
        there = np.isfinite(y) & np.isfinite(h)
        y, h = (each[there] - np.mean(each[there]) for each in (y, h)) if there.any() else (y, h)
        if there.sum() > 1 and np.sum((y - h) ** 2) < POOR_FREE_RUN**2 * np.sum(y**2):
            found.append(float(h @ y / (h @ h) - 1))
    return found
