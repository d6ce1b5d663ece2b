"""Which outputs are sampled too early or too late, by what the innovation likelihood gains.

A bus that passes on an old value, a clock of a sensor's own: a sample is of another time than its
row, and is off by that times the rate of its output, so that noise of one size is too large at rest
and too small in motion. How far the times err is one level more, and must gain what Schwarz's
criterion asks of two, as errors of outputs do (G. Schwarz, Ann. Stat. 6 (1978)).
"""

from itertools import product

import jax.numpy as jnp
import numpy as np

from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.detection.calibration.noise_levels import Spans
from faultgauge.plants.model import Model

__all__ = ["with_jitter_of_sensors"]

SHARES = (0.3, 0.1, 0.03, 0.01)  # of a step of the log: by what times may err
CALMER = (1.0, 10.0)  # times less noise of samples, and of states, besides
NONE = 1e-6  # of a step: as good as none


def with_jitter_of_sensors(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with jitter of every output that gains by it while all else stays but the noise of
    its samples and of states, the one that gains most first."""
    measured = np.array([bool(jnp.isfinite(y).any()) for y in jnp.moveaxis(batch.y, 2, 0)])
    step, found = spans.shortest / 2, noise
    left = np.flatnonzero(measured & (noise.jitter == 0)).tolist()
    while left:
        none = found._replace(
            jitter=np.where(measured & (found.jitter == 0), NONE * step, found.jitter)
        )
        many, tried = [none], list[int]()
        for j, share, quieter, calmer in product(left, SHARES, CALMER, CALMER):
            one = np.arange(len(measured)) == j
            many.append(
                none._replace(
                    jitter=np.where(one, share * step, none.jitter),
                    sigma=np.where(one, none.sigma / quieter, none.sigma),
                    process=none.process / calmer,
                )
            )
            tried.append(j)
        cost = batch.about(many)
        best = int(np.argmin(cost[1:])) + 1
        if cost[0] - cost[best] <= np.log(batch.count):
            break
        j = tried[best - 1]
        one = np.arange(len(measured)) == j
        found = many[best]._replace(jitter=np.where(one, many[best].jitter, found.jitter))
        left.remove(j)
    return found
