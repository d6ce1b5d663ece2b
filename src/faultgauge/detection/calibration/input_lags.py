"""Which inputs come later than the model has it, by what the innovation likelihood gains.

A lag that the file lacks is no error that changes by chance: size and time constant are two levels
more, and must gain what Schwarz's criterion asks of two (G. Schwarz, Ann. Stat. 6 (1978)).
"""

from itertools import product

import numpy as np

from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.detection.calibration.noise_levels import LAG, Spans
from faultgauge.detection.calibration.traces import with_traces
from faultgauge.plants.disturbed import following_inputs
from faultgauge.plants.model import Model

__all__ = ["with_lags_of_inputs"]

GRID = 6  # time constants that are tried
SURER = (1.0, 10.0)  # times less of a change that is off by chance, where an input comes late


def with_lags_of_inputs(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with every input late that gains by it while all else stays but the share by which
    its changes are off."""
    shares = np.arange(1, GRID + 1) / (GRID + 1)
    times = [spans.shortest, *(spans.shortest ** (1 - shares) * spans.settled**shares)]
    following = list(following_inputs(model.plant))
    inputs = np.arange(len(model.plant.signals.inputs))
    none = with_traces(model, batch, noise, spans)
    many, tried = [none], []
    for j, at, surer in product(following, range(GRID + 2), SURER):
        one, k = inputs == j, following.index(j)
        # a lag is what most of a change that settles may be
        time = (float(noise.settling[k]), *times)[at]
        share = noise.share.copy()
        share[k] /= surer
        lean, leaning = np.where(one, LAG, none.lean), np.where(one, time, none.leaning)
        many.append(none._replace(lean=lean, leaning=leaning, share=share))
        tried.append(j)
    cost = batch.about(many)
    lean, leaning, share = 0.0 * inputs, 0.0 * inputs, noise.share.copy()
    for j in following:
        own, k = [n for n, each in enumerate(tried, 1) if each == j], following.index(j)
        best = min(own, key=lambda n: cost[n])
        if cost[0] - cost[best] > np.log(batch.count):
            lean[j], leaning[j], share[k] = LAG, many[best].leaning[j], many[best].share[k]
    return noise._replace(lean=lean, leaning=leaning, share=share)
