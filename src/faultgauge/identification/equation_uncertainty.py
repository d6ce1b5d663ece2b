"""What the equation error says about the parameters that it fitted.

With r_k the residuals of sample k, each over its target's spread, J_k their Jacobian and P the
prior of the refinement, a sample moves the unknowns by

    z_k = H^-1 J_k' r_k,   H = sum_k J_k' J_k + s^2 P

and the sandwich (H. White, Econometrica 48, 1980) adds up what they moved:

    cov(theta) = D (sum_k z_k z_k') D + s^2 H^-1 P H^-1,   D_ii^2 = tau_i

Neighbours share most of the smoothing kernel: tau_i, the integrated autocorrelation time of z_i, is
the number of samples that count as one.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.constants import Information, constants, imitated
from faultgauge.identification.equation_error import (
    Group,
    equation_errors,
    groups,
    target_scales,
)
from faultgauge.identification.equation_fit import Material
from faultgauge.identification.refinement.unknowns import Unknowns, unknowns_of
from faultgauge.identification.samples import Samples
from faultgauge.identification.validation.correlation import correlation, integrated_time
from faultgauge.plants.gray_box import GrayBoxPlant

__all__ = ["equation_information"]


def equation_information(
    plant: GrayBoxPlant, outputs: Sequence[str], given: Material, weak: Sequence[str] = ()
) -> Information:
    """What the samples that `plant` was fitted to, `outputs` with telemetry among them, say about
    its parameters. Those of `weak` were fitted in the weak form, to other samples: they get no
    standard errors."""
    unknowns = unknowns_of(plant)
    theta = unknowns.vector(plant)
    parts = groups(plant.spec, outputs)
    if not unknowns.parameters or not parts:
        return Information((), np.zeros((0, 0)), (), 1.0)
    r, J = _linearised(plant, unknowns, parts, given.training)
    hessian = np.einsum("sei,sej->ij", J, J)
    first, s2 = unknowns.weights(plant), max(float(np.mean(r**2)), 1e-300)
    inverse = np.linalg.pinv(hessian + s2 * np.eye(len(theta)), hermitian=True)[first:]
    moved = np.einsum("sei,se->si", J, r) @ inverse.T
    times = _times(moved, given)
    wide = np.sqrt(times)
    covariance = np.outer(wide, wide) * (moved.T @ moved) + s2 * inverse @ inverse.T
    # nothing is known of what no equation holds, nor of the scatter of another estimator
    unknown = (np.diag(hessian)[first:] == 0) | (given.exogenous is not None)
    unknown |= np.array([name in weak for name in unknowns.parameters])
    covariance[unknown] = covariance[:, unknown] = np.nan
    found = constants(plant, unknowns, theta, covariance, imitated(plant, unknowns, hessian))
    return Information(*found, (), float(np.max(times)))


def _times(
    moved: Float[np.ndarray, "training parameters"], given: Material
) -> Float[np.ndarray, "parameters"]:
    """Integrated autocorrelation times; samples that were not fitted moved nothing."""
    lengths = [len(s.t) for s in given.stretches]
    whole = np.zeros((sum(lengths), moved.shape[1]))
    whole[given.places] = moved
    parts = np.split(whole, np.cumsum(lengths)[:-1])
    found = []
    for k in range(moved.shape[1]):
        rho = correlation([part[:, k] for part in parts], [part[:, k] for part in parts])
        found.append(1.0 if rho is None else integrated_time(rho[len(rho) // 2 :]))
    return np.array(found)


def _linearised(
    plant: GrayBoxPlant, unknowns: Unknowns, parts: Sequence[Group], samples: Samples
) -> tuple[Float[np.ndarray, "samples equations"], Float[np.ndarray, "samples equations unknowns"]]:
    """(residuals of all equations that were fitted, each over its target's spread; Jacobian)."""
    every = Group(
        states=tuple(i for part in parts for i in part.states),
        outputs=tuple(j for part in parts for j in part.outputs),
        networks=unknowns.networks,
        parameters=unknowns.parameters,
    )
    scales = target_scales(every, samples)

    @eqx.filter_jit
    def both(theta: Array, samples: Samples) -> tuple[Array, Array]:
        def error(theta: Array, sample: Samples) -> tuple[Array, Array]:
            r = equation_errors(unknowns.assemble(plant, theta), every, sample) / scales
            return r, r

        J, r = jax.vmap(jax.jacrev(error, has_aux=True), (None, 0))(theta, samples)
        return r, J

    found = both(jnp.asarray(unknowns.vector(plant)), jax.tree.map(jnp.asarray, samples))
    return np.asarray(found[0]), np.asarray(found[1])
