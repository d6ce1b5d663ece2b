"""What the equation error says about the parameters that it fitted.

With r_k the residuals of sample k, each over its target's spread, J_k their Jacobian and P the
prior of the refinement, a sample moves the unknowns by

    z_k = H^-1 J_k' r_k,   H = sum_k J_k' J_k + s^2 P

and their scatter is the sandwich (H. White, Econometrica 48, 1980)

    cov(theta) = V + d d' + s^2 H^-1 P H^-1,   V = sum_kl E z_k z_l',   d = sum_k z_k

d is the step that is left to the least squares' own minimum: none, but for networks, whose training
stops early, and then of the size by which that shifts the parameters from one log to the next.
Residuals of a wrong or disturbed model last, and those of noisy sensors, being derivatives of
noise, take back in the next samples what they did in the last. Either way V is B times the mean
power of z at its B slowest cosines along the log of N samples, k being a sample's place there:

    V = 2 / B sum_j c_j c_j',   c_j = sum_k cos(pi j (k + 1/2) / N) z_k,   j = 1 ... B

(U. K. Muller, J. Econometrics 141, 2007; E. Lazarus, D. J. Lewis, J. H. Stock and M. W. Watson,
J. Business and Economic Statistics 36, 2018). Runs follow each other as if they were one: the
cosines are slow beside what a residual remembers, so the joints do not matter.

Groups of equations share no unknowns: H falls into blocks, each with the samples and residuals of
the form, filtered or weak, that its group was fitted in. V does not, as groups read the same noise,
at their own places along the same log.

Two-stage least squares has slopes G_k at the projected samples in the place of the first J_k:
z_k = (sum_k G_k' J_k + s^2 P)^-1 G_k' r_k.

Beside that stands how far the constants are off where the plant is not its model (`model_error`).
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from faultgauge.identification.constants import (
    ConstantsInformation,
    at_bound,
    constants,
    imitated,
    shifted,
)
from faultgauge.identification.equation.fit import GroupReport, Material
from faultgauge.identification.equation.groups import Group, equation_errors, target_scales
from faultgauge.identification.equation.model_error import off_by_model, residuals_at
from faultgauge.identification.equation.noise_bias import noise_left, shift_by_noise
from faultgauge.identification.equation.simulated_instruments import Freed
from faultgauge.identification.equation.weak_form import WeakErrors, weak_states
from faultgauge.identification.samples import Channels, Samples
from faultgauge.identification.unknowns import Unknowns, unknowns_of
from faultgauge.plants.gray_box import GrayBoxPlant

__all__ = ["equation_information", "scatter"]

COSINES = 24  # a standard error is known to 1 / sqrt(2 * 24) = 14 %; more would be less slow


class _Linearised(NamedTuple):
    """A group's residuals, their Jacobian J and the slopes G (J in least squares) at its samples,
    and the samples' places along the log."""

    r: Float[np.ndarray, "samples equations"]
    J: Float[np.ndarray, "samples equations unknowns"]
    G: Float[np.ndarray, "samples equations unknowns"]
    places: Int[np.ndarray, "samples"]


def equation_information(
    plant: GrayBoxPlant, how: Channels, reports: Sequence[GroupReport], given: Material
) -> ConstantsInformation:
    """What the samples that `plant` was fitted to, its groups as in `reports`, say about its
    parameters."""
    unknowns = unknowns_of(plant)
    theta = unknowns.vector(plant)
    if not unknowns.parameters or not reports:
        return ConstantsInformation((), np.zeros((0, 0)), (), 1.0)
    parts = [_linearised(plant, unknowns, how, report, given) for report in reports]
    hessian = np.sum([np.einsum("sei,sej->ij", part.J, part.J) for part in parts], axis=0)
    slopes = np.sum([np.einsum("sei,sej->ij", part.G, part.J) for part in parts], axis=0)
    s2 = max(float(np.mean(np.concatenate([part.r.ravel() for part in parts]) ** 2)), 1e-300)
    first = unknowns.weights(plant)
    free = np.append(np.ones(first, bool), ~at_bound(plant, unknowns))  # what may move
    inverse = np.linalg.pinv(slopes[np.ix_(free, free)] + s2 * np.eye(free.sum()))[first:]
    pulls = [np.einsum("sei,se->si", part.G[..., free], part.r) for part in parts]
    moved = np.concatenate(pulls) @ inverse.T
    places = np.concatenate([part.places for part in parts])
    found = scatter(moved, places, sum(len(s.t) for s in given.stretches))
    times = np.diag(found) / np.maximum(np.sum(moved**2, axis=0), 1e-300)
    covariance = np.full((len(theta) - first, len(theta) - first), np.nan)
    rest = np.sum(moved, axis=0)
    own = found + np.outer(rest, rest) + s2 * inverse @ inverse.T
    covariance[np.ix_(free[first:], free[first:])] = own
    unknown = np.diag(hessian)[first:] == 0  # no equation that was fitted holds it
    covariance[unknown] = covariance[:, unknown] = np.nan
    off, late = off_by_model(plant, unknowns, how, reports, given, free)
    rows, correlation = constants(
        plant, unknowns, theta, covariance, imitated(plant, unknowns, hessian), off
    )
    shift = np.zeros(len(theta))
    left = noise_left(how, plant.signals.state_names, given)
    biased = [report for report in reports if report.freed is None]
    if left is not None and biased:
        normal = partial(_normal, plant, unknowns, theta, biased, free, given)
        shift[free] = shift_by_noise(normal, given.training, left, s2)
    rows = shifted(rows, plant, unknowns.assemble(plant, jnp.asarray(theta + shift)))
    time = float(np.max(times, initial=0.0))
    return ConstantsInformation(rows, correlation, (), time, late=late)


def _normal(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    theta: Float[np.ndarray, "unknowns"],
    reports: Sequence[GroupReport],
    free: Bool[np.ndarray, "unknowns"],
    given: Material,
    samples: Samples,
) -> tuple[Float[np.ndarray, "free"], Float[np.ndarray, "free free"]]:
    """(sum J' r, sum J' J) over `samples` of all groups, in the filtered form."""
    pull, hessian = 0.0, 0.0
    for report in reports:
        scales = jnp.asarray(target_scales(report.group, given.training))
        points = jax.tree.map(jnp.asarray, samples)
        r, J = residuals_at(
            jnp.asarray(theta), points, plant, unknowns, report.group, equation_errors, scales
        )
        J = np.asarray(J)[..., free]
        pull = pull + np.einsum("sei,se->i", J, np.asarray(r))
        hessian = hessian + np.einsum("sei,sej->ij", J, J)
    return np.asarray(pull), np.asarray(hessian)


def scatter(
    moved: Float[np.ndarray, "samples parameters"], places: Int[np.ndarray, "samples"], count: int
) -> Float[np.ndarray, "parameters parameters"]:
    """V above: the covariance of the sum of `moved`, whose rows have `places` among `count`."""
    slow = np.arange(1, min(COSINES, count - 1) + 1)
    sums = np.cos(np.pi * np.outer(slow, places + 0.5) / count) @ moved
    return 2.0 / len(slow) * sums.T @ sums


def _linearised(
    plant: GrayBoxPlant, unknowns: Unknowns, how: Channels, report: GroupReport, given: Material
) -> _Linearised:
    group, samples, places = report.group, given.training, given.places
    errors: Callable[[GrayBoxPlant, Group, Any], Array] = equation_errors
    if report.form == "weak":
        assert given.weak is not None
        states, places = weak_states(plant.spec, how, group), given.weak.places
        samples, errors = given.weak.training.of_group(group, states), WeakErrors(states)
    exogenous = None
    if isinstance(report.freed, Freed):
        samples, exogenous = report.freed.training, report.freed.exogenous
    elif report.freed:
        exogenous = given.exogenous
    theta, scales = map(jnp.asarray, (unknowns.vector(plant), target_scales(group, samples)))

    def at(samples: Any) -> tuple[np.ndarray, np.ndarray]:
        samples = jax.tree.map(jnp.asarray, samples)
        r, J = residuals_at(theta, samples, plant, unknowns, group, errors, scales)
        return np.asarray(r), np.asarray(J)

    r, J = at(samples)
    return _Linearised(r, J, J if exogenous is None else at(exogenous)[1], places)
