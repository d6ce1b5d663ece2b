"""Which outputs' own equations lack something, by what the innovation likelihood gains.

An output's own equation is given an error that lasts, or one that an input's change makes, where
the likelihood pays for it: size and time constant are two levels more, and must gain what Schwarz's
criterion asks of two (G. Schwarz, Ann. Stat. 6 (1978)).
"""

from itertools import product
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank.noise import LATE, WANDER, Noise
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.detection.calibration.noise_levels import Spans
from faultgauge.plants.disturbed import answering_outputs
from faultgauge.plants.model import Model

__all__ = ["with_errors_of_outputs"]

GRID = 4  # time constants that are tried
CALMER = (1.0, 10.0)  # times less process noise, where an output wanders besides
HALF = 0.5  # of what an input's change does to an output: what may come late
NONE = 1e-6  # times its noise: as good as no error


def with_errors_of_outputs(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with the likelier of wandering and being late, if it is not there yet, for every
    output that gains by it while all else stays but the process noise."""
    measured = np.array([bool(jnp.isfinite(y).any()) for y in jnp.moveaxis(batch.y, 2, 0)])
    answering = np.isin(np.arange(len(measured)), answering_outputs(model.plant))
    shares = np.arange(1, GRID + 1) / (GRID + 1)
    times = spans.shortest ** (1 - shares) * spans.longest**shares
    # a lag shows in the samples that follow an input's change: from the shortest on
    lags = spans.shortest * (spans.settled / spans.shortest) ** (np.arange(GRID) / GRID)
    each = np.eye(len(measured))

    def little(levels: tuple[str, str], size: Float[np.ndarray, "outputs"]) -> dict[str, Any]:
        old = [getattr(noise, name) for name in levels]
        new = (NONE * size, np.full(len(measured), spans.shortest))
        return {n: np.where(a > 0, a, b) for n, a, b in zip(levels, old, new, strict=True)}

    none = noise._replace(**little(WANDER, noise.sigma * measured))
    none = none._replace(**little(LATE, 1.0 * (measured & answering)))
    many, tried = [none], list[tuple[tuple[str, str], int]]()
    wanders = np.flatnonzero(measured & (noise.wander == 0))
    late = np.flatnonzero(measured & answering & (noise.late == 0))
    for levels, outputs, size, lasting, factors in (
        (WANDER, wanders, noise.sigma, times, CALMER),
        (LATE, late, np.full(len(measured), HALF), lags, CALMER[:1]),
    ):
        for j, time, factor in product(outputs.tolist(), lasting, factors):
            changed = (getattr(none, levels[0]) + each[j] * size, getattr(none, levels[1]).copy())
            changed[1][j] = time
            own = dict(zip(levels, changed, strict=True))
            many.append(none._replace(process=noise.process / factor, **own))
            tried.append((levels, j))
    cost = batch.run(model, many).cost
    found = {name: getattr(noise, name).copy() for name in (*WANDER, *LATE)}
    for j in np.flatnonzero(measured).tolist():
        own = [k for k, (_, output) in enumerate(tried, 1) if output == j]
        best = min(own, key=lambda k: cost[k], default=0)
        if cost[0] - cost[best] > np.log(batch.count):
            for name in tried[best - 1][0]:
                found[name][j] = getattr(many[best], name)[j]
    return noise._replace(**found)
