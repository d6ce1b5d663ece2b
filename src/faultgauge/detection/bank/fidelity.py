"""How far the model's answer to what acts on the plant is off, from free runs over healthy logs.

The plant's answer to a fault is known as its answer to an input is, and no better: with y what was
measured and h the free run, both less their means,

    shape^2 = |y - h|^2 / |y|^2,    gain = (h . y) / (h . h) - 1,

by how much the answer is off in all, and in size alone, from run to run. In long free runs small
errors add up, as where a plant integrates, and in short ones noise and an unsure start count as
much as any answer: of runs through whole logs, halves of them, quarters, ..., those tell `shape`
that are off least. An output that none follows is carried off by what is no answer, as a level is
by an inflow that nobody measures, and tells nothing of one. Nor does a run follow what is a
sensor's own error, with s its share of |y| (r.m.s.): where that is why none does, as of an
accelerometer in hover, and less than half of y,

    (shape^2 - s^2) / (1 - s^2)    stands for shape^2,

and a usual share at least, as noise hides what is closer.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank.extended import sampled_within
from faultgauge.detection.bank.noise import Noise
from faultgauge.errors import InputError
from faultgauge.identification.validation.evaluation import POOR_FREE_RUN, Prediction, predict
from faultgauge.identification.validation.restarted import SHORTEST_PIECE, pieces
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run

__all__ = ["LONGEST_PIECE", "Following", "gain_error", "largest_changes", "shape_error"]

LONGEST_PIECE = 20_000  # samples of a free run
ENOUGH = 32  # free runs: with other constants more would tell the same
# times as far off: free runs with constants that are not the plant's. 1.2 at most on ten rigs whose
# constants were, 3.5 on one where they were not
WORSE = 1.5
USUAL_GAIN = 0.05  # as good as one more output of one more run
USUAL_SHAPE = 0.2  # where every free run is lost, as that of an unstable plant is
MOST_OWN = 0.5  # of what an output shows (squares): what else it shows is hidden in more


def shape_error(model: Model, runs: Sequence[Run], noise: Noise) -> float:
    """By which share the model's answer is off in all in `runs`, by the outputs that free runs
    follow, each in the parts that it does so best; of those that none follows the best, or a usual
    share. `noise` tells how much of an output is its sensor's own. 0 for a model that nobody
    fitted."""
    if model.record.metrics.validation_free_run_nrmse is None:
        return 0.0
    least, parts = np.full(len(model.plant.signals.outputs), np.inf), 1
    while min(len(run.t) for run in runs) >= parts * SHORTEST_PIECE:
        off = _off(_free_runs(model, runs, parts))
        if not np.any(off < least):
            break
        least, parts = np.fmin(least, off), 2 * parts
    own = _own(model, runs, noise) ** 2
    noisy = (least >= POOR_FREE_RUN) & (own < MOST_OWN)
    beyond = np.sqrt(np.maximum(least[noisy] ** 2 - own[noisy], 0.0) / (1 - own[noisy]))
    least[noisy] = np.maximum(beyond, USUAL_SHAPE)
    followed = least[least < POOR_FREE_RUN]
    if len(followed):
        return _together(followed)
    return float(least.min()) if least.min() < 1.0 else USUAL_SHAPE


def _own(model: Model, runs: Sequence[Run], noise: Noise) -> Float[np.ndarray, "outputs"]:
    """Which share of what each output shows in `runs` is its sensor's own error (r.m.s.); all where
    it never moves."""
    moves = []
    for name in model.plant.signals.output_names:
        shown = (run.columns[name] for run in runs if name in run.columns)
        told = [np.nanvar(y) for y in shown if np.isfinite(y).any()]
        moves.append(np.mean(told or [0.0]))
    own = sampled_within(model, noise) ** 2
    own[list(noise.wanders)] += noise.wander[list(noise.wanders)] ** 2
    return np.sqrt(np.divide(own, moves, out=np.ones(len(own)), where=np.array(moves) > 0))


def _least_off(model: Model, runs: Sequence[Run]) -> tuple[float, int]:
    """(by which share `ENOUGH` free runs are off, the parts of `runs` in which it is least); 1 and
    1 where none follows them."""
    least, best, parts = 1.0, 1, 1
    while min(len(run.t) for run in runs) >= parts * SHORTEST_PIECE:
        off = _together(_off(_free_runs(model, runs, parts, ENOUGH)))
        if off > least < 1.0:
            break
        least, best = min((off, parts), (least, best))
        parts *= 2
    return least, best


class Following:
    """Whether free runs follow `runs` with other constants about as well as with the fitted ones.

    Innovations say what explains the next sample, and where the file lacks something (friction that
    sticks, a gust that a loop answers) may ask for constants of which no run is one. Every output
    that the fitted ones follow is held against them, in the parts in which they do so best: a heat
    capacity shows in a temperature alone.
    """

    def __init__(self, model: Model, runs: Sequence[Run]) -> None:
        self.model, self.runs = model, runs

    @cached_property
    def _fitted(self) -> tuple[Float[np.ndarray, "outputs"], int]:
        """By which share each output of free runs with the fitted constants is off, and in which
        parts."""
        _, parts = _least_off(self.model, self.runs)
        return _off(_free_runs(self.model, self.runs, parts, ENOUGH)), parts

    def __call__(self, names: Sequence[str], shift: Float[np.ndarray, "constants"]) -> bool:
        """With `names` off the fitted values by `shift`."""
        off, parts = self._fitted
        followed = off < 1.0
        if not followed.any():
            return True  # nothing follows them, whatever the constants
        values = self.model.plant.values()
        shifted = {n: values[n] + s for n, s in zip(names, shift, strict=True)}
        other = replace(self.model, plant=self.model.plant.with_constants(shifted))
        error = _off(_free_runs(other, self.runs, parts, ENOUGH))
        return bool(np.all(error <= WORSE * np.maximum(off, USUAL_GAIN), where=followed))


def gain_error(model: Model, runs: Sequence[Run]) -> float:
    """By which share the size of the model's answer is off (r.m.s.), by every output that the free
    run follows in every one of `runs`: one that is off by half and more, as where a plant
    integrates, is carried off by what is no answer."""
    predictions = _free_runs(model, runs, 1)
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


def _free_runs(
    model: Model, runs: Sequence[Run], parts: int, most: int | None = None
) -> list[Prediction]:
    """Over so many `parts` of each of `runs`, evenly spread where there are more than `most`; none
    where nothing can be followed."""
    cuts = [piece for run in runs for piece in pieces(run, parts, LONGEST_PIECE)]
    told = np.unique(np.linspace(0, len(cuts) - 1, most or len(cuts)).round().astype(int))
    named = [replace(cuts[k], name=str(k)) for k in told]
    try:
        return predict(model.plant, named, model.max_step, between=model.record.between)
    except InputError:  # nowhere two samples in a row
        return []


def _off(predictions: Sequence[Prediction]) -> Float[np.ndarray, "outputs"]:
    """Shape of every output; infinite where a free run diverges, no number where it never moves."""
    errors, moves = [], []
    for each in predictions:
        y, h = each.measured[each.warmup :], each.predicted[each.warmup :]
        there = np.isfinite(y)
        both = [np.where(there, a, 0.0) for a in (y - h, y)]
        means = [a.sum(axis=0) / np.maximum(there.sum(axis=0), 1) for a in both]
        own = [
            np.sum(np.where(there, a - m, 0.0) ** 2, axis=0)
            for a, m in zip(both, means, strict=True)
        ]
        errors.append(own[0])
        moves.append(own[1])
    error, moved = np.sum(errors, axis=0), np.sum(moves, axis=0)
    shares = np.where(np.isfinite(error), error, np.inf) / np.where(moved > 0, moved, np.nan)
    return np.sqrt(shares)


def _together(off: Float[np.ndarray, "outputs"]) -> float:
    """The root of the mean of shape^2 over the outputs that move; infinite where none does."""
    shares = off[~np.isnan(off)] ** 2
    return float(np.sqrt(np.mean(shares))) if len(shares) else np.inf


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
