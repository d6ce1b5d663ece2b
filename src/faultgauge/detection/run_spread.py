"""How much constants differ from run to run, and by how much the fit is off their mean.

What each stretch says of its own constants tells (the EM algorithm: Dempster, Laird and Rubin,
J. R. Statist. Soc. B 39 (1977))

    mean = avg m_r,    C = (sum_r (m_r - mean)^2 + V_r + C_0) / (R + 1),

the fitted values being those of one more run, and constants of one unit pooled, since few runs tell
each one's spread badly. What of it lies between the stretches of one run, a gap makes anew: a
vehicle that has landed flies on with another trim.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from faultgauge.detection.innovation_likelihood import Likelihood
from faultgauge.detection.noise import Noise, constants_of, directions_of, drifting_of, usual_spread
from faultgauge.plants.model import Model

__all__ = ["constants_retold"]

ALIKE = 10.0  # times: constants of one unit that differ by more are of two kinds


def constants_retold(model: Model, batch: Likelihood, noise: Noise) -> Noise:
    """`noise` with the constants' mean and spread as every stretch's own say."""
    known, skip = constants_of(model), len(drifting_of(model))
    if not known.names:
        return noise
    cost, mean, P, *_ = batch.run(model, [noise])
    for _ in range(2):
        W = directions_of(model, known, noise.spread)[skip:, skip:]
        own = mean[0, :, skip:] @ W.T
        V = np.einsum("ij,rjk,ik->ri", W, P[0][:, skip:, skip:], W)
        off = np.concatenate([noise.shift + own, np.zeros((1, own.shape[1]))])  # the fit: one more
        mean_off, count = off.mean(axis=0), len(off)
        values = [float(model.plant.parameters[n]) for n in known.names]
        usual = np.array([usual_spread(value, 0.0) for value in values])
        sums = np.sum((off - mean_off) ** 2, axis=0) + V.sum(axis=0)
        squares = _pooled(model, known.names, sums)
        spread = np.sqrt((squares + usual**2) / (count + 1) * (1 + 1 / count))
        new = _pooled(model, known.names, _within(batch, own, V)) / spread**2
        told = noise._replace(spread=spread, shift=mean_off, renewed=np.clip(new, 0.0, 1.0))
        after, mean, P, *_ = batch.run(model, [told])
        if after[0] > cost[0] + len(usual):  # what a prior may take: here the filter is lost
            break
        noise, cost = told, after
    return noise


def _within(
    batch: Likelihood,
    own: Float[np.ndarray, "stretches constants"],
    V: Float[np.ndarray, "stretches constants"],
) -> Float[np.ndarray, "constants"]:
    """Variance of the constants between the stretches of one run, beyond what is not known of them;
    0 where no run has two."""
    found = []
    for run in np.unique(batch.runs):
        parts = np.unique(batch.parts[batch.runs == run])
        if len(parts) > 1:
            means, unsure = (
                np.stack([a[batch.parts == part].mean(axis=0) for part in parts]) for a in (own, V)
            )
            found.append(np.var(means, axis=0, ddof=1) - unsure.mean(axis=0))
    return np.maximum(np.mean(found, axis=0), 0.0) if found else np.zeros(own.shape[1])


def _pooled(
    model: Model, names: Sequence[str], sums: Float[np.ndarray, "constants"]
) -> Float[np.ndarray, "constants"]:
    """`sums` as their mean over the constants of one unit and order of magnitude."""
    parameters = {p.name: p for p in model.plant.spec.parameters}
    usual = np.array([usual_spread(float(model.plant.parameters[n]), 0.0) for n in names])
    units = [parameters[n].unit or n for n in names]
    found = np.array(sums, float)
    for unit in set(units):
        own = sorted((k for k, each in enumerate(units) if each == unit), key=lambda k: usual[k])
        apart = [i for i, (a, b) in enumerate(pairwise(own), 1) if usual[b] > ALIKE * usual[a]]
        for alike in np.split(np.array(own), apart):
            found[alike] = np.mean(found[alike])
    return found
