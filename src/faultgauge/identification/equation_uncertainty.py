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

Two-stage least squares has slopes G_k at the projected samples in the place of the first J_k:
z_k = (sum_k G_k' J_k + s^2 P)^-1 G_k' r_k.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from faultgauge.identification.constants import Information, at_bound, constants, imitated
from faultgauge.identification.equation_error import Group, equation_errors, target_scales
from faultgauge.identification.equation_fit import GroupReport, Material
from faultgauge.identification.refinement.unknowns import Unknowns, unknowns_of
from faultgauge.identification.samples import Samples
from faultgauge.plants.gray_box import GrayBoxPlant

__all__ = ["equation_information", "scatter"]

COSINES = 24  # a standard error is known to 1 / sqrt(2 * 24) = 14 %; more would be less slow


def equation_information(
    plant: GrayBoxPlant, reports: Sequence[GroupReport], given: Material
) -> Information:
    """What the samples that `plant` was fitted to, its groups as in `reports`, say about its
    parameters. Those in the weak form were fitted to other samples: they get no standard errors."""
    unknowns = unknowns_of(plant)
    theta = unknowns.vector(plant)
    if not unknowns.parameters or not reports:
        return Information((), np.zeros((0, 0)), (), 1.0)
    every = _together([report.group for report in reports], unknowns)
    r, J = _linearised(plant, unknowns, every, given.training, given.training)
    G = J
    if given.exogenous is not None:
        freed = _equations(every, [report.group for report in reports if report.freed])
        _, projected = _linearised(plant, unknowns, every, given.exogenous, given.training)
        G = np.where(freed[:, None], projected, J)
    hessian = np.einsum("sei,sej->ij", J, J)
    first, s2 = unknowns.weights(plant), max(float(np.mean(r**2)), 1e-300)
    free = np.append(np.ones(first, bool), ~at_bound(plant, unknowns))  # what may move
    curvature = np.einsum("sei,sej->ij", G, J)[np.ix_(free, free)] + s2 * np.eye(free.sum())
    inverse = np.linalg.pinv(curvature)[first:]
    moved = np.einsum("sei,se->si", G[..., free], r) @ inverse.T
    found = scatter(moved, given.places, sum(len(s.t) for s in given.stretches))
    times = np.diag(found) / np.maximum(np.sum(moved**2, axis=0), 1e-300)
    covariance = np.full((len(theta) - first, len(theta) - first), np.nan)
    left = np.sum(moved, axis=0)
    own = found + np.outer(left, left) + s2 * inverse @ inverse.T
    covariance[np.ix_(free[first:], free[first:])] = own
    unknown = np.diag(hessian)[first:] == 0  # no equation that was fitted holds it
    averaged = {p for each in reports if each.form == "weak" for p in each.group.parameters}
    unknown |= np.array([name in averaged for name in unknowns.parameters])
    covariance[unknown] = covariance[:, unknown] = np.nan
    rows = constants(plant, unknowns, theta, covariance, imitated(plant, unknowns, hessian))
    return Information(*rows, (), float(np.max(times, initial=0.0)))


def scatter(
    moved: Float[np.ndarray, "samples parameters"], places: Int[np.ndarray, "samples"], count: int
) -> Float[np.ndarray, "parameters parameters"]:
    """V above: the covariance of the sum of `moved`, whose rows have `places` among `count`."""
    slow = np.arange(1, min(COSINES, count - 1) + 1)
    sums = np.cos(np.pi * np.outer(slow, places + 0.5) / count) @ moved
    return 2.0 / len(slow) * sums.T @ sums


def _together(parts: Sequence[Group], unknowns: Unknowns) -> Group:
    return Group(
        states=tuple(i for part in parts for i in part.states),
        outputs=tuple(j for part in parts for j in part.outputs),
        networks=unknowns.networks,
        parameters=unknowns.parameters,
    )


def _equations(every: Group, some: Sequence[Group]) -> Bool[np.ndarray, "equations"]:
    """Which equations of `every` are in one of the groups `some`."""
    states = {i for group in some for i in group.states}
    outputs = {j for group in some for j in group.outputs}
    return np.array([i in states for i in every.states] + [j in outputs for j in every.outputs])


def _linearised(
    plant: GrayBoxPlant, unknowns: Unknowns, every: Group, samples: Samples, training: Samples
) -> tuple[Float[np.ndarray, "samples equations"], Float[np.ndarray, "samples equations unknowns"]]:
    """(residuals at `samples`, each over its target's spread in training; Jacobian)."""
    scales = target_scales(every, training)

    @eqx.filter_jit
    def both(theta: Array, samples: Samples) -> tuple[Array, Array]:
        def error(theta: Array, sample: Samples) -> tuple[Array, Array]:
            r = equation_errors(unknowns.assemble(plant, theta), every, sample) / scales
            return r, r

        J, r = jax.vmap(jax.jacrev(error, has_aux=True), (None, 0))(theta, samples)
        return r, J

    found = both(jnp.asarray(unknowns.vector(plant)), jax.tree.map(jnp.asarray, samples))
    return np.asarray(found[0]), np.asarray(found[1])
