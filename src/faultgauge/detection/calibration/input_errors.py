"""Which inputs stray from what is commanded, by what the innovation likelihood gains.

Where an input acts in two places or more, one error of it is another thing than an error in each:
size and time constant are two levels more, and must gain what Schwarz's criterion asks of two (G.
Schwarz, Ann. Stat. 6 (1978)).
"""

from itertools import product

import numpy as np

from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.detection.calibration.noise_levels import Spans
from faultgauge.detection.rows.judged import operating_points
from faultgauge.plants.disturbed import shared_inputs
from faultgauge.plants.model import Model

__all__ = ["with_errors_of_inputs"]

GRID = 4  # time constants that are tried
SIZES = (0.1, 0.03, 0.01)  # of an input's range
CALMER = (1.0, 3.0, 10.0)  # times less discrepancy and process noise, where an input strays besides
NONE = 1e-6  # of an input's range: as good as no error


def with_errors_of_inputs(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with every input straying that gains by it while all else stays but the noise of
    states, and their discrepancy."""
    inputs = list(shared_inputs(model.plant))
    if not inputs:
        return noise
    width = np.std(operating_points(model).u, axis=0) + 1e-12
    there = np.isin(np.arange(len(width)), inputs)
    shares = np.arange(1, GRID + 1) / (GRID + 1)
    times = spans.shortest ** (1 - shares) * spans.longest**shares
    none = noise._replace(stray=NONE * width * there, straying=np.where(there, spans.shortest, 0.0))
    many, tried = [none], []
    for j, time, size, calmer in product(inputs, times, SIZES, CALMER):
        one = np.arange(len(width)) == j
        many.append(
            none._replace(
                stray=np.where(one, size * width, none.stray),
                straying=np.where(one, time, none.straying),
                process=noise.process / calmer,
                size=noise.size / calmer,
            )
        )
        tried.append(j)
    cost = batch.about(many)
    stray, straying = np.zeros(len(width)), np.zeros(len(width))
    for j in inputs:
        own = [k for k, each in enumerate(tried, 1) if each == j]
        best = min(own, key=lambda k: cost[k])
        if cost[0] - cost[best] > np.log(batch.count):
            stray[j], straying[j] = many[best].stray[j], many[best].straying[j]
    return noise._replace(stray=stray, straying=straying)
