"""Which states stick where they come to rest, by what the innovation likelihood gains.

A bearing, a piston, a valve's stem: at rest friction is whatever holds, up to what breaks loose,
and a curve through zero has none of it. Where healthy logs show it, a force holds the state near
zero and lets go as it moves: its size, how long it lasts and within what it lets go are three
levels more, and must gain what Schwarz's criterion asks of three (G. Schwarz, Ann. Stat. 6 (1978)).
"""

from itertools import product

import numpy as np

from faultgauge.detection.bank.extended import rates_of
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.detection.calibration.noise_levels import Spans
from faultgauge.detection.rows.judged import operating_points
from faultgauge.plants.disturbed import dynamic_states
from faultgauge.plants.model import Model

__all__ = ["with_grips"]

GRID = 3  # time constants that are tried
SIZES = (1.0, 0.3, 0.1)  # of how a state's rate varies
SLIPS = (0.3, 0.1, 0.03, 0.01)  # of how the state itself does
CALMER = (1.0, 10.0)  # times less discrepancy and process noise, where a state sticks besides
NONE = 1e-6  # of a rate: as good as no grip
LEVELS = 1.5  # times what Schwarz's criterion asks of two


def with_grips(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with every state sticking that comes to rest and gains by it while all else stays but
    the noise of states, and their discrepancy."""
    points, rates = operating_points(model).x, rates_of(model)
    width = np.std(points, axis=0)
    rests = (points.min(axis=0, initial=0.0) < 0) & (points.max(axis=0, initial=0.0) > 0)
    states = [k for k in dynamic_states(model.plant) if rests[k] and not noise.grip[k]]
    if not states:
        return noise
    there = np.isin(np.arange(len(width)), states)
    shares = np.arange(1, GRID + 1) / (GRID + 1)
    times = spans.shortest ** (1 - shares) * spans.settled**shares
    none = noise._replace(
        grip=np.where(there, NONE * rates, noise.grip),
        gripping=np.where(there, spans.shortest, noise.gripping),
        slip=np.where(there, width, noise.slip),
    )
    many, tried = [none], []
    for k, time, size, slip, calmer in product(states, times, SIZES, SLIPS, CALMER):
        one = np.arange(len(width)) == k
        many.append(
            none._replace(
                grip=np.where(one, size * rates, none.grip),
                gripping=np.where(one, time, none.gripping),
                slip=np.where(one, slip * width, none.slip),
                process=noise.process / calmer,
                size=noise.size / calmer,
            )
        )
        tried.append(k)
    cost = batch.run(model, many).cost
    found = noise
    for k in states:
        best = min((j for j, each in enumerate(tried, 1) if each == k), key=lambda j: cost[j])
        if cost[0] - cost[best] > LEVELS * np.log(batch.count):
            one = np.arange(len(width)) == k
            found = found._replace(
                grip=np.where(one, many[best].grip, found.grip),
                gripping=np.where(one, many[best].gripping, found.gripping),
                slip=np.where(one, many[best].slip, found.slip),
            )
    return found
