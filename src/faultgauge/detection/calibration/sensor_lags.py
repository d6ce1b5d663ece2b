"""Which sensors trail what they measure, by what the innovation likelihood gains.

As a lag of an input (`input_lags`), one of a sensor is no error that changes by chance: a time
constant, which must gain what Schwarz's criterion asks of a lag there (G. Schwarz, Ann. Stat. 6
(1978)).
"""

from itertools import product

import numpy as np

from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.detection.calibration.noise_levels import LEAST_LAG, Spans
from faultgauge.detection.calibration.traces import trailing_outputs, with_traces
from faultgauge.plants.model import Model

__all__ = ["with_lags_of_sensors"]

GRID = 6  # time constants that are tried
SURER = (1.0, 10.0)  # times less of a change that is off by chance, where a sensor trails
SHORT = np.array([LEAST_LAG, 0.5, 1.0])  # times the shortest time of what comes and goes by chance


def with_lags_of_sensors(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with every output that reads no derivative behind a lag, where it gains by that while
    all else stays but the share by which changes are off."""
    there = trailing_outputs(model, batch)
    outputs = np.arange(len(there))
    shares = np.arange(1, GRID + 1) / (GRID + 1)
    times = [*SHORT * spans.shortest, *(spans.shortest ** (1 - shares) * spans.settled**shares)]
    none = with_traces(model, batch, noise, spans)
    many, tried = [none], []
    for j, time, surer in product(np.flatnonzero(there).tolist(), times, SURER):
        trail = np.where(outputs == j, time, none.trail)
        many.append(none._replace(trail=trail, share=noise.share / surer))
        tried.append(j)
    cost = batch.run(many).cost
    trail, share = 0.0 * outputs, noise.share
    for j in np.flatnonzero(there).tolist():
        own = [n for n, each in enumerate(tried, 1) if each == j]
        best = min(own, key=lambda n: cost[n])
        if cost[0] - cost[best] > np.log(batch.count):
            trail[j] = many[best].trail[j]
            share = np.minimum(share, many[best].share)
    return noise._replace(trail=trail, share=share)
