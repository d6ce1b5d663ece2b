"""Which constants change within a run, by what the innovation likelihood gains.

A winding warms, oil thins, a filter clogs: a constant that differs between runs may differ within
one as well. It is then a Gauss-Markov process of the same spread, and how long it keeps its value
is one level more, which must gain what Schwarz's criterion asks of it (G. Schwarz, Ann. Stat. 6
(1978)).
"""

from itertools import product

import numpy as np

from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.detection.calibration.noise_levels import Spans
from faultgauge.plants.model import Model

__all__ = ["with_varying_constants"]

GRID = 3  # time constants that are tried
WIDER = (1.0, 5.0, 25.0)  # times the spread between runs
CALMER = (3.0, 30.0)  # times less discrepancy and process noise, where a constant varies besides


def with_varying_constants(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with the one constant varying within a run that gains most by it while all else stays
    but the noise of states, and their discrepancy; another one may be looked for beside it."""
    times = spans.settled * (spans.longest / spans.settled) ** (np.arange(GRID) / GRID)
    many, count = [noise], len(noise.spread)
    for k, time, wider, calmer in product(range(count), times, WIDER, CALMER):
        one = np.arange(count) == k
        if noise.varying[k]:
            continue
        factor = np.where(one, wider, 1.0)
        own = noise._replace(
            varying=np.where(one, time, noise.varying),
            process=noise.process / calmer,
            size=noise.size / calmer,
        )
        many.append(own.with_between(own.between * np.outer(factor, factor)))
    cost = batch.run(model, many).cost
    best = many[int(np.argmin(cost))]
    if cost[0] - cost.min() <= np.log(batch.count):
        return noise
    return noise.with_between(best.between)._replace(varying=best.varying)
