"""Which inputs act along a curve that the file has straight, by what the innovation likelihood
gains.

A valve, a pump, a heater at a voltage: what such an input does is off by where it stands, which no
error that comes and goes in time says. A parabola through the ends of its range is one level more,
and must gain what Schwarz's criterion asks of a lag (G. Schwarz, Ann. Stat. 6 (1978)).
"""

from itertools import product

import numpy as np

from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.detection.calibration.noise_levels import Spans
from faultgauge.detection.calibration.traces import with_traces
from faultgauge.plants.disturbed import following_inputs
from faultgauge.plants.model import Model

__all__ = ["with_curves_of_inputs"]

TRIED = (-0.1, -0.03, -0.01, 0.01, 0.03, 0.1)  # of an input's range
CALMER = (1.0, 3.0, 10.0)  # times less discrepancy, where it is the curve of an input


def with_curves_of_inputs(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with every input bent that gains by it while all else stays but the discrepancy."""
    following = list(following_inputs(model.plant))
    inputs = np.arange(len(model.plant.signals.inputs))
    none = with_traces(model, batch, noise, spans)
    many, tried = [none], []
    for j, bend, calmer in product(following, TRIED, CALMER):
        bends = np.where(inputs == j, bend, none.bend)
        many.append(none._replace(bend=bends, size=noise.size / calmer))
        tried.append(j)
    cost = batch.run(many).cost
    bends, size = 0.0 * inputs, noise.size
    for j in following:
        own = [n for n, each in enumerate(tried, 1) if each == j]
        best = min(own, key=lambda n: cost[n])
        if cost[0] - cost[best] > np.log(batch.count):
            bends[j] = many[best].bend[j]
            size = np.minimum(size, many[best].size)
    return noise._replace(bend=bends, size=size)
