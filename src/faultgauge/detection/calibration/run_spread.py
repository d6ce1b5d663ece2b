"""How much constants differ from run to run, and by how much the fit is off their mean.

What each stretch says of its own constants tells (the EM algorithm: Dempster, Laird and Rubin,
J. R. Statist. Soc. B 39 (1977))

    mean = (sum_r I - V_r)^-1 sum_r m_r,

    C = (sum_r (m_r + V_r mean - mean)^2 + V_r + C_0) / (R + 1),

with m_r and V_r what run r leaves of a prior N(0, I) around the last mean, so that a mean of which
each run tells little is found at once and not a little at a time. Few runs tell badly how each
constant differs, and worse how they do so together: the squares of constants of one unit are
pooled, and the correlation of R runs, R - 1 of which tell it, counts beside d, as many as there are
constants, in which these differ each in its own way. Runs at one speed tell a friction there and
not of what it is made, and the fewer they are the less it can be said that they hold to that. Where
there is one run only, the fit is another; where there are more, it tells nothing: a fit that is
biased (noise in what the equations read, disturbances that a simulation does not see) is off all
runs alike, and would be taken for a spread between them. What of it lies between the stretches of
one run, a gap makes anew: a vehicle that has landed flies on with another trim.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import eigvalsh
from scipy.stats import norm
from scipy.stats import t as student_t

from faultgauge.detection.bank.extended import directions_of
from faultgauge.detection.bank.fidelity import Following
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.bank.uncertain_constants import (
    constants_of,
    drifting_of,
    parameters_of,
    usual_spread,
)
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.plants.model import Model

__all__ = ["as_unsure_as_few_runs_tell", "constants_retold"]

WITHIN = 0.975  # of constants: below the upper end of their 95 % range
SHARES = (1.0, 0.5, 0.25, 0.1)  # of the way, as far as it can be borne
STEPS = 6  # of EM, at most
STILL = 0.02  # of the spread: a step that would move mean and spread by less is left out
UNTOLD = 0.1  # of what a run would tell at most: what the mean is held by where none tells it
ALIKE = 10.0  # times: constants of one unit that differ by more are of two kinds


def constants_retold(model: Model, batch: Likelihood, noise: Noise, follows: Following) -> Noise:
    """`noise` with the constants' mean and spread as every stretch's own say, as far as free runs
    follow the logs with that mean."""
    known, skip = constants_of(model), len(drifting_of(model))
    if not known.names:
        return noise
    fitted = known.covariance if len(np.unique(batch.runs)) == 1 else None
    cost, mean, P, *_ = batch.run([noise])
    values = [float(model.plant.values()[n]) for n in known.names]
    limits = _limits(model, known.names) - values
    usual = np.array([usual_spread(value, 0.0) for value in values])
    for _ in range(STEPS):
        W = directions_of(model, noise)[skip:, skip:]
        xi, unsure = mean[0, :, skip:], P[0][:, skip:, skip:]
        mean_off, off, V = _runs_own(W, noise.shift, xi, unsure, fitted)
        stretches = len(batch.runs)
        mean_off = np.clip(mean_off, *limits)
        C = _between(model, known.names, off - mean_off, V, usual)
        own = np.diagonal(V, axis1=1, axis2=2)
        within = _pooled(model, known.names, _within(batch, off[:stretches], own[:stretches]))
        renewed = np.clip(within / np.diag(C), 0.0, 1.0)
        many = [
            noise.with_between(noise.between + share * (C - noise.between))._replace(
                shift=noise.shift + share * (mean_off - noise.shift), renewed=renewed
            )
            for share in SHARES
        ]
        wider = 0.5 * np.log(eigvalsh(C, noise.between))  # along what changes most and least
        moved = (mean_off - noise.shift) / np.sqrt(np.diag(C))
        if max(np.max(np.abs(wider)), np.max(np.abs(moved))) < STILL:
            break
        told = batch.run(many)
        # what a prior may take; beyond, the filter is lost there
        borne = np.flatnonzero(told.cost <= cost[0] + len(usual))
        best = next((int(k) for k in borne if follows(known.names, many[k].shift)), None)
        if best is None:
            break
        noise, cost = many[best], told.cost[best : best + 1]
        mean, P = told.mean[best : best + 1], told.P[best : best + 1]
    return noise


def _between(
    model: Model,
    names: Sequence[str],
    off: Float[np.ndarray, "runs constants"],
    V: Float[np.ndarray, "runs constants constants"],
    usual: Float[np.ndarray, "constants"],
) -> Float[np.ndarray, "constants constants"]:
    """C of the docstring above."""
    runs, d = off.shape
    sums = off.T @ off + V.sum(axis=0)
    each = np.sqrt(np.diag(sums))
    known = np.where(each > 0, each, 1.0)
    together = (runs - 1) / (runs - 1 + d) * sums / np.outer(known, known)
    together[np.diag_indices(d)] = 1.0
    both = np.sqrt(_pooled(model, names, np.diag(sums)) + usual**2)
    return together * np.outer(both, both) / (runs + 1)


def _runs_own(
    W: Float[np.ndarray, "constants constants"],
    shift: Float[np.ndarray, "constants"],
    xi: Float[np.ndarray, "stretches constants"],
    unsure: Float[np.ndarray, "stretches constants constants"],
    fitted: Float[np.ndarray, "constants constants"] | None,
) -> tuple[
    Float[np.ndarray, "constants"],
    Float[np.ndarray, "runs constants"],
    Float[np.ndarray, "runs constants constants"],
]:
    """(by how much the constants' mean is off the fit, and every run's own; how unsure these are),
    of what each leaves of a prior N(0, I) around the `shift`; the fit is one more run where it is
    told how unsure it is (`fitted`)."""
    one = np.eye(len(W))
    if fitted is not None:
        K = np.linalg.solve(W, np.linalg.solve(W, fitted).T)
        left = np.linalg.inv(one + K)
        xi = np.concatenate([xi, -(left @ np.linalg.solve(W, shift))[None]])
        unsure = np.concatenate([unsure, (one - left)[None]])
    moved = np.linalg.solve((one - unsure).sum(axis=0) + UNTOLD * one, xi.sum(axis=0))
    own = shift + (xi + unsure @ moved) @ W.T
    return shift + W @ moved, own, W @ unsure @ W.T


def as_unsure_as_few_runs_tell(model: Model, batch: Likelihood, noise: Noise) -> Noise:
    """`noise` with constants spread as wide as those of the next run may lie: a normal
    distribution with the 95 % range of Student's t, since a spread that few runs told may be far
    larger, about a mean that so many tell (A. Gelman et al., Bayesian Data Analysis, section
    3.2); and as unsure as the fit has them, since what a model lacks moves its constants within a
    run, too."""
    runs, known = len(np.unique(batch.runs)), constants_of(model)
    if not known.names:
        return noise
    # of one run the fit is another; stretches of a run tell the mean as runs do
    stretches = len(batch.runs) + (runs == 1)
    wider = np.full(len(known.names), np.sqrt(1 + 1 / stretches))
    for alike in _alike(model, known.names):
        told = max(runs - 1, 1) * len(alike) + 1  # the prior: one more
        wider[alike] *= student_t.ppf(WITHIN, told) / norm.ppf(WITHIN)
    more = noise.between * (np.outer(wider, wider) - 1) + known.covariance
    many = [noise.with_between(noise.between + share * more) for share in SHARES]
    cost = batch.run([noise, *many]).cost
    # a wider prior costs as much as it is wider at most; beyond, the filter is lost there
    volumes = [np.linalg.slogdet(each.between)[1] for each in (noise, *many)]
    most = len(batch.runs) * (np.array(volumes[1:]) - volumes[0]) / 2
    borne = np.flatnonzero(cost[1:] <= cost[0] + most + 1.0)
    return many[int(borne[0])] if len(borne) else noise


def _limits(model: Model, names: Sequence[str]) -> Float[np.ndarray, "two constants"]:
    """The least and the most that constants may be by the plant file."""
    of = parameters_of(model)
    return np.array([(of[name].min, of[name].max) for name in names], float).T


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
    found = np.array(sums, float)
    for alike in _alike(model, names):
        found[alike] = np.mean(found[alike])
    return found


def _alike(model: Model, names: Sequence[str]) -> list[Int[np.ndarray, "some"]]:
    """Which constants are of one unit and order of magnitude."""
    parameters, values = parameters_of(model), model.plant.values()
    usual = np.array([usual_spread(float(values[n]), 0.0) for n in names])
    units = [parameters[n].unit or n for n in names]
    found = []
    for unit in set(units):
        own = sorted((k for k, each in enumerate(units) if each == unit), key=lambda k: usual[k])
        apart = [i for i, (a, b) in enumerate(pairwise(own), 1) if usual[b] > ALIKE * usual[a]]
        found += np.split(np.array(own), apart)
    return found
