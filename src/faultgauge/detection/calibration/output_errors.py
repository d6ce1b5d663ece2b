"""Which outputs' own equations lack something, by what the innovation likelihood gains.

An output's own equation is given a zero that each run has another of, an error that lasts, or one
that an input's change makes, where the likelihood pays for it: size and time constant are two
levels more, and must gain what Schwarz's criterion asks of two (G. Schwarz, Ann. Stat. 6 (1978)).
"""

from itertools import product
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank.noise import LATE, WANDER, ZERO, Noise
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.detection.calibration.noise_levels import Spans
from faultgauge.plants.disturbed import answering_outputs
from faultgauge.plants.model import Model

__all__ = ["with_errors_of_outputs"]

GRID = 4  # time constants that are tried
CALMER = (1.0, 10.0)  # times less process noise, where an output wanders besides
HALF = 0.5  # of what an input's change does to an output: what may come late
NONE = 1e-6  # times its noise: as good as no error
OFF = (1.0, 10.0, 100.0)  # times its noise: by what a zero may be off


def with_errors_of_outputs(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with the likeliest of a zero that is off, wandering and being late, if it is not
    there yet, for every output that gains by it while all else stays but the process noise."""
    measured = np.array([bool(jnp.isfinite(y).any()) for y in jnp.moveaxis(batch.y, 2, 0)])
    answering = np.isin(np.arange(len(measured)), answering_outputs(model.plant))
    shares = np.arange(1, GRID + 1) / (GRID + 1)
    times = spans.shortest ** (1 - shares) * spans.longest**shares
    # a lag shows in the samples that follow an input's change: from the shortest on
    lags = spans.shortest * (spans.settled / spans.shortest) ** (np.arange(GRID) / GRID)

    def little(levels: tuple[str, ...], size: Float[np.ndarray, "outputs"]) -> dict[str, Any]:
        old = [getattr(noise, name) for name in levels]
        new = (NONE * size, np.full(len(measured), spans.shortest))
        return {n: np.where(a > 0, a, b) for n, a, b in zip(levels, old, new, strict=False)}

    none = noise._replace(**little(WANDER, noise.sigma * measured))
    none = none._replace(**little(LATE, 1.0 * (measured & answering)))
    none = none._replace(**little(ZERO, noise.sigma * measured))
    tried = list[_Error]()
    for levels, may, size, lasting, factors in (
        (ZERO, measured, noise.sigma, OFF, CALMER),
        (WANDER, measured, noise.sigma, times, CALMER),
        (LATE, measured & answering, np.full(len(measured), HALF), lags, CALMER[:1]),
    ):
        outputs = np.flatnonzero(may & (getattr(noise, levels[0]) == 0))
        for j, time, factor in product(outputs.tolist(), lasting, factors):
            larger = size[j] * (time if levels == ZERO else 1.0)
            own = dict[str, float](zip(levels, (larger, time), strict=False))
            tried.append(_Error(j, own, noise.process / factor))
    found, enough = noise, np.log(batch.count)
    while tried:
        many = [error.beside(none)._replace(process=error.process) for error in tried]
        cost = batch.about([none, *many])
        gains = cost[0] - cost[1:]
        best = int(np.argmax(gains))
        if gains[best] <= enough:
            break
        found, none = tried[best].beside(found), many[best]
        # what outputs share is the error of one of them
        rest = (each.output != tried[best].output for each in tried)
        tried = [
            e for e, gain, other in zip(tried, gains, rest, strict=True) if other and gain > enough
        ]
    return found


class _Error(NamedTuple):
    """By what an output may err, and the process noise beside that."""

    output: int
    levels: dict[str, float]
    process: Float[np.ndarray, "states"]

    def beside(self, noise: Noise) -> Noise:
        """`noise` with this error, too."""
        here = np.arange(len(noise.sigma)) == self.output
        own = {n: np.where(here, a, getattr(noise, n)) for n, a in self.levels.items()}
        return noise._replace(**own)
