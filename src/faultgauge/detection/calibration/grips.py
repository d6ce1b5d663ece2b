"""Which states stick where they come to rest, by what the innovation likelihood gains.

A bearing, a piston, a valve's stem: at rest friction is whatever holds, up to what breaks loose,
and a curve through zero has none of it. Where healthy logs show it, a force holds the state near
zero and lets go as it moves: its size, how long it lasts, within what it lets go and on which
travel it becomes another are four levels more, and must gain what Schwarz's criterion asks of four
(G. Schwarz, Ann. Stat. 6 (1978)).
"""

from itertools import product

import numpy as np

from faultgauge.detection.bank.extended import rates_of
from faultgauge.detection.bank.noise import GRIP, Noise
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.detection.calibration.noise_levels import Spans, as_fitted
from faultgauge.detection.rows.judged import operating_points
from faultgauge.plants.disturbed import dynamic_states
from faultgauge.plants.model import Model

__all__ = ["with_grips"]

GRID = 3  # time constants that are tried
SIZES = (1.0, 0.3, 0.1)  # of how a state's rate varies
SLIPS = (0.3, 0.1, 0.03, 0.01)  # of how the state itself does
CALMER = 10.0  # times less discrepancy and process noise, where a state sticks besides
NONE = 1e-6  # of a rate: as good as no grip
LEVELS = 2.0  # times what Schwarz's criterion asks of two


def with_grips(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with every state sticking that comes to rest and gains by it while all else stays but
    the noise of states, their discrepancy, and the constants."""
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
        travel=np.where(there, width * spans.settled, noise.travel),
    )
    calmer = none._replace(process=none.process / CALMER, size=none.size / CALMER)
    # what stuck and was not borne has moved the constants, too
    rests = none, calmer, as_fitted(model, calmer)
    many, tried = [none], []
    for k, time, size, slip, rest in product(states, times, SIZES, SLIPS, rests):
        one = np.arange(len(width)) == k
        many.append(
            rest._replace(
                grip=np.where(one, size * rates, none.grip),
                gripping=np.where(one, times[-1], none.gripping),
                slip=np.where(one, slip * width, none.slip),
                travel=np.where(one, slip * width * time, none.travel),
            )
        )
        tried.append(k)
    cost = batch.run(many).cost
    gains = {k: [cost[0] - cost[j] for j, each in enumerate(tried, 1) if each == k] for k in states}
    enough = LEVELS * np.log(batch.count)
    sticking = [k for k in states if max(gains[k]) > enough]
    if not sticking:
        return noise
    best = {k: many[1 + tried.index(k) + int(np.argmax(gains[k]))] for k in sticking}
    likeliest = best[max(sticking, key=lambda k: max(gains[k]))]
    own = {name: getattr(noise, name).copy() for name in GRIP}
    for k in sticking:
        for name in GRIP:
            own[name][k] = getattr(best[k], name)[k]
    return likeliest._replace(**own)
