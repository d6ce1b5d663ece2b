"""What the data say about the unknowns: standard errors, what stands for what, what is not seen.

With J the sensitivities of the weighted outputs over all windows, starts included, and P the prior,

    cov(theta) = s^2 tau (J J' + sigma^2 P + C C')^-1,

C what networks leave to the physics (see `claims`), s^2 the mean square residual. Residuals of a
simulation are not white: tau, their integrated autocorrelation time, is the number of samples that
count as one.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.constants import Information, constants, imitated
from faultgauge.identification.normal_equations import bordered_equations
from faultgauge.identification.refinement.claims import Claims
from faultgauge.identification.refinement.simulation_error import (
    Fitted,
    Ridge,
    SimulationResidual,
    Window,
    beside_of,
    simulated,
)
from faultgauge.identification.refinement.unknowns import Unknowns
from faultgauge.identification.validation.correlation import correlation, integrated_time
from faultgauge.plants.gray_box import GrayBoxPlant

__all__ = ["Curvature", "curvature", "information"]

UNSEEN = 1e-10  # of the information on a state that stands alone


class Curvature(NamedTuple):
    """H = J J' over all windows, starts included; that with the priors and what networks leave to
    the physics; tau, samples."""

    hessian: Float[np.ndarray, "n n"]
    precision: Float[np.ndarray, "n n"]
    residual_time: float


def curvature(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    fitted: Fitted,
    windows: Window,
    substeps: int,
    ridge: Ridge,
    claims: Claims | None = None,
) -> Curvature:
    """The curvature of the cost at a fit over `windows`, its networks' prior being `ridge`."""
    silent = SimulationResidual(plant, jnp.asarray(0.0), unknowns, substeps)
    local = silent.local(windows)
    theta = jnp.concatenate([jnp.asarray(fitted.theta), jnp.asarray(fitted.z).ravel()])
    found = _normal_equations(silent, theta, jax.tree.map(jnp.asarray, windows), local)
    hessian = np.asarray(found[1])
    prior = np.ones(len(hessian))
    prior[: unknowns.weights(plant)] = ridge
    s2 = max(fitted.mse, 1e-300)
    precision = hessian + np.diag(s2 * prior)
    if claims is not None:
        beside = beside_of(plant, claims, unknowns, windows, float(np.sqrt(s2)))
        rows = np.asarray(jax.jacrev(beside)(theta))
        precision += rows.T @ rows
    return Curvature(hessian, precision, _residual_time(plant, unknowns, fitted, windows, substeps))


def information(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    fitted: Fitted,
    windows: Window,
    substeps: int,
    ridge: Ridge,
    claims: Claims | None = None,
) -> Information:
    """Standard errors and warnings at a fit over `windows`, its networks' prior being `ridge` and
    what they leave to the physics `claims`."""
    hessian, precision, tau = curvature(plant, unknowns, fitted, windows, substeps, ridge, claims)
    size, weights = fitted.theta.size, unknowns.weights(plant)
    s2 = max(fitted.mse, 1e-300)
    covariance = s2 * tau * np.linalg.pinv(precision, hermitian=True)
    covariance = covariance[weights:size, weights:size]
    found = constants(plant, unknowns, fitted.theta, covariance, imitated(plant, unknowns, hessian))
    unseen = _unseen(plant, hessian, size, windows)
    return Information(*found, unseen, tau, claims is not None)


@eqx.filter_jit
def _normal_equations(
    residual: SimulationResidual, theta: Array, windows: Window, local: int
) -> tuple[Array, Array, Array]:
    return bordered_equations(residual.linearised, theta, windows, local)[:3]


def _residual_time(
    plant: GrayBoxPlant, unknowns: Unknowns, fitted: Fitted, windows: Window, substeps: int
) -> float:
    """The longest integrated autocorrelation time over the outputs, samples."""
    errors = simulated(plant, unknowns, fitted.theta, fitted.z, windows, substeps)[1]
    times = [1.0]
    for j in range(errors.shape[-1]):
        parts = [e[w > 0] for e, w in zip(errors[..., j], windows.weight[..., j], strict=True)]
        parts = [part for part in parts if len(part) > 20]
        if parts:
            rho = correlation(parts, parts)
            if rho is not None:
                times.append(integrated_time(rho[len(rho) // 2 :]))
    return float(max(times))


def _factor(share: float) -> str:
    return f"{share:+.2g} ".removesuffix("1 ") if abs(share) == 1 else f"{share:+.2g} "


def _unseen(
    plant: GrayBoxPlant, hessian: Float[np.ndarray, "n n"], shared: int, windows: Window
) -> tuple[str, ...]:
    """Combinations of states that change no output, whatever the window."""
    count, states = windows.center.shape
    local = (len(hessian) - shared) // count
    total = np.zeros((states, states))
    for k in range(count):
        start = shared + k * local
        total += hessian[start : start + states, start : start + states]
    if not np.all(np.isfinite(total)) or np.trace(total) <= 0:
        return ()
    size = np.sqrt(np.diag(total))
    size = np.where(size > 0, size, np.inf)  # a state that changes nothing: a zero row stays zero
    values, vectors = np.linalg.eigh(total / np.outer(size, size))
    reach = np.mean(np.asarray(windows.sd), axis=0) / np.where(np.isfinite(size), size, 1.0)
    names = plant.signals.state_names
    directions = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value > UNSEEN:
            continue
        parts = vector * reach
        parts = parts / parts[np.argmax(np.abs(parts))]
        terms = [f"{_factor(p)}{n}" for p, n in zip(parts, names, strict=True) if abs(p) > 0.01]
        directions.append(" ".join(terms).removeprefix("+"))
    return tuple(directions)
