"""Which inputs come later than the model has it, and which sensors trail what they measure, by what
the innovation likelihood gains.

A lag that the file lacks is no error that changes by chance: its levels must gain what Schwarz's
criterion asks of two (G. Schwarz, Ann. Stat. 6 (1978)). Of one input and one output a lag of either
does the same, of several it does not: so the one that gains most is taken, then the next beside it.
"""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.bank.noise import LEAN, TRAIL, Noise
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.detection.calibration.noise_levels import LAG, Spans
from faultgauge.plants.disturbed import answering_outputs, following_inputs
from faultgauge.plants.model import Model

__all__ = ["false_lags", "with_lags", "without_lags"]

GRID = 6  # time constants that are tried
SURER = (1.0, 10.0)  # times less of a change that is off by chance, where an input comes late
NONE = 1e-6  # of an input's change, or of the shortest time: as good as no lag
LESS = 0.95  # of the share that a change is off by: a lag that leaves more is none
TOLD = 1.05  # times the shortest time: the end of a search


def with_lags(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with every input and every sensor late that gains by it while all else stays but the
    share by which changes are off."""
    following = list(following_inputs(model.plant))
    measured = np.array([bool(jnp.isfinite(y).any()) for y in jnp.moveaxis(batch.y, 2, 0)])
    trailing = measured & ~np.isin(np.arange(len(measured)), answering_outputs(model.plant))
    inputs = np.arange(len(model.plant.signals.inputs))
    there = np.isin(inputs, following)
    # of all that may be late next to nothing is: one compiled program for all
    best = noise._replace(
        lean=np.where(there & (noise.lean == 0), NONE * LAG, noise.lean),
        leaning=np.where(there & (noise.leaning == 0), spans.shortest, noise.leaning),
        trail=np.where(trailing & (noise.trail == 0), NONE * spans.shortest, noise.trail),
    )
    found = noise
    while True:
        tried = [*_late_inputs(noise, found, best, following, spans)]
        tried += _late_sensors(found, best, trailing, spans)
        if not tried:
            return found
        cost = batch.run(model, [best, *tried]).cost
        least = int(np.argmin(cost[1:]))
        if cost[0] - cost[1 + least] <= np.log(batch.count):
            return found
        best = tried[least]
        lean, trail = best.lean <= LAG / 2, best.trail >= spans.shortest
        found = found._replace(
            lean=np.where(lean, best.lean, 0.0),
            leaning=np.where(lean, best.leaning, 0.0),
            trail=np.where(trail, best.trail, 0.0),
            share=best.share,
        )


def _times(spans: Spans) -> list[float]:
    shares = np.arange(1, GRID + 1) / (GRID + 1)
    return [spans.shortest, *(spans.shortest ** (1 - shares) * spans.settled**shares)]


def _late_inputs(
    noise: Noise, found: Noise, best: Noise, following: list[int], spans: Spans
) -> Iterator[Noise]:
    """`best` with one input more that comes late than have been `found`."""
    for k, j in enumerate(following):
        if found.lean[j]:
            continue
        one = np.arange(len(best.lean)) == j
        # a lag is what most of a change that settles may be
        for time in (float(noise.settling[k]), *_times(spans)):
            for surer in SURER:
                share = best.share.copy()
                share[k] /= surer
                lean, leaning = np.where(one, LAG, best.lean), np.where(one, time, best.leaning)
                yield best._replace(lean=lean, leaning=leaning, share=share)


def _late_sensors(
    found: Noise, best: Noise, trailing: Bool[np.ndarray, "outputs"], spans: Spans
) -> Iterator[Noise]:
    """`best` with one output more that trails than have been `found`."""
    for j in np.flatnonzero(trailing & (found.trail == 0)).tolist():
        one = np.arange(len(best.trail)) == j
        for time in _times(spans):
            for surer in SURER:
                yield best._replace(trail=np.where(one, time, best.trail), share=best.share / surer)


def false_lags(
    model: Model, before: Noise, found: Noise, spans: Spans
) -> tuple[Bool[np.ndarray, "inputs"], Bool[np.ndarray, "outputs"]]:
    """The inputs whose lag, which was not there `before`, leaves as much of a change to chance as
    there was, and so explains something else, or would be shorter than can be told; and the outputs
    that trail by less than can be told."""
    less = np.zeros(len(found.lean), bool)
    less[list(following_inputs(model.plant))] = found.share < LESS * before.share
    short = TOLD * spans.shortest
    leans = (found.lean != 0) & (before.lean == 0) & (~less | (found.leaning < short))
    return leans, (found.trail > 0) & (before.trail == 0) & (found.trail < short)


def without_lags(
    noise: Noise, false: tuple[Bool[np.ndarray, "inputs"], Bool[np.ndarray, "outputs"]]
) -> Noise:
    """`noise` without the lags that are `false`."""

    def kept(names: tuple[str, ...], none: Bool[np.ndarray, "some"]) -> dict[str, Float]:
        return {name: np.where(none, 0.0, getattr(noise, name)) for name in names}

    return noise._replace(**kept(LEAN, false[0]), **kept(TRAIL, false[1]))
