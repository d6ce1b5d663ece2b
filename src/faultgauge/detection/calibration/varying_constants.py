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
LIKELY = 4  # constants of which more is tried than the spread between runs
WIDER = (1.0, 5.0, 25.0)  # times the spread between runs
CALMER = (1.0, 3.0, 30.0)  # times less discrepancy and process noise, where a constant varies


def with_varying_constants(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with the one constant varying within a run that gains most by it while all else stays
    but the noise of states, and their discrepancy; another one may be looked for beside it."""
    times = spans.settled * (spans.longest / spans.settled) ** (np.arange(GRID) / GRID)
    constants = np.flatnonzero(noise.varying == 0)

    def varied(k: int, time: float, wider: float, calmer: float) -> Noise:
        one = np.arange(len(noise.spread)) == k
        factor = np.where(one, wider, 1.0)
        own = noise._replace(
            varying=np.where(one, time, noise.varying),
            process=noise.process / calmer,
            size=noise.size / calmer,
        )
        return own.with_between(own.between * np.outer(factor, factor))

    if not len(constants):
        return noise
    told = product(constants.tolist(), times, WIDER[:1], CALMER)
    cost = batch.about([noise, *(varied(*each) for each in told)])[1:]
    likely = constants[np.argsort(cost.reshape(len(constants), -1).min(axis=1))[:LIKELY]]
    told = product(likely.tolist(), times, WIDER, CALMER[1:])
    many = [noise, *(varied(*each) for each in told)]
    cost = batch.run(many).cost
    best = many[int(np.argmin(cost))]
    if cost[0] - cost.min() <= np.log(batch.count):
        return noise
    return noise.with_between(best.between)._replace(varying=best.varying)
