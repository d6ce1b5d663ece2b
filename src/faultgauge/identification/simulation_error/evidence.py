"""How strong the prior of each network should be, from what the data say about its weights.

With a the precision of a network's W weights theta, N(0, 1 / a) each, and S the posterior
covariance, the evidence of the data is greatest where

    a = gamma / |theta|^2,   gamma = W - a tr S,

gamma being the number of them that the data determine (D. J. C. MacKay, "Bayesian interpolation",
Neural Computation 4, 1992). Residuals of a simulation are not white: tau of them count as one (see
`uncertainty`), so that with s the fit's error

    S = s^2 tau (J J' + s^2 P)^-1,   P = ridge = tau a for weights.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from faultgauge.identification.simulation_error.candidate import Candidate, fitted_again, validated
from faultgauge.identification.simulation_error.data import Data
from faultgauge.identification.simulation_error.uncertainty import curvature
from faultgauge.identification.unknowns import WEIGHTS

__all__ = ["by_evidence", "drift_by_evidence", "updated"]

ROUNDS, TRIALS = 3, 8  # updates, and Levenberg-Marquardt trials after each
LEAST, MOST = 1e-6, 1e6  # prior weights


def by_evidence(data: Data, candidate: Candidate) -> Candidate:
    """`candidate` fitted anew with prior weights by evidence, updated while that wins on unseen
    samples."""
    name = f"{candidate.origin}, by evidence"
    best = now = replace(candidate, origin=name, validation=np.inf)
    for _ in range(ROUNDS):
        now = validated(data, fitted_again(data, now, _by_evidence(data, now), TRIALS))
        if not now.validation < best.validation:
            break
        best = now
    return best


def _by_evidence(data: Data, candidate: Candidate) -> Float[np.ndarray, "weights"]:
    """The prior weight of every weight, the same for all of a network."""
    plant, unknowns, fitted = candidate.plant, candidate.unknowns, candidate.fitted
    windows = data.windows(data.pieces)
    found = curvature(
        plant, unknowns, fitted, windows, data.substeps, candidate.ridge, candidate.claims
    )
    sizes = [
        sum(getattr(plant.networks[name], field).size for field in WEIGHTS)
        for name in unknowns.networks
    ]
    inverse = np.linalg.pinv(found.precision, hermitian=True)
    covariance = max(fitted.mse, 1e-300) * found.residual_time * inverse
    weights = sum(sizes)
    ridge = np.broadcast_to(candidate.ridge, weights)
    return updated(
        fitted.theta[:weights], np.diag(covariance)[:weights], ridge, found.residual_time, sizes
    )


def drift_by_evidence(data: Data, candidate: Candidate) -> Float[np.ndarray, "slow"]:
    """How many times as far as `data.drift` has it each parameter walks, at `candidate`.

    The increments' prior is N(0, tau), or a = 1 / tau; with tau a by evidence they are
    sqrt(1 / (tau a)) times as large.
    """
    plant, unknowns, fitted = candidate.plant, candidate.unknowns, candidate.fitted
    windows = data.windows(data.pieces)
    found = curvature(
        plant, unknowns, fitted, windows, data.substeps, candidate.ridge, candidate.claims
    )
    inverse = np.linalg.pinv(found.precision, hermitian=True)
    variance = max(fitted.mse, 1e-300) * found.residual_time * np.diag(inverse)
    count, increments, slow = len(fitted.z), windows.walk.shape[-2], windows.walk.shape[-1]

    def by_parameter(local: Float[np.ndarray, "windows local"]) -> Float[np.ndarray, "increments"]:
        walked = local[:, local.shape[1] - increments * slow :].reshape(count, increments, slow)
        return np.moveaxis(walked, 2, 0).ravel()

    tau_a = updated(
        by_parameter(fitted.z),
        by_parameter(variance[fitted.theta.size :].reshape(count, -1)),
        np.ones(count * increments * slow),
        found.residual_time,
        [count * increments] * slow,
    )
    return 1 / np.sqrt(tau_a[:: count * increments])


def updated(
    theta: Float[np.ndarray, "weights"],
    variance: Float[np.ndarray, "weights"],
    ridge: Float[np.ndarray, "weights"],
    tau: float,
    sizes: Sequence[int],
) -> Float[np.ndarray, "weights"]:
    """One update of `ridge`: `sizes` of the networks, which follow each other in `theta`;
    `variance` is that of its elements."""
    ends = np.cumsum(sizes)
    found = []
    for first, last in zip(ends - sizes, ends, strict=True):
        own = slice(first, last)
        gamma = last - first - np.sum(ridge[own] / tau * variance[own])
        a = max(float(gamma), 0.0) / max(float(theta[own] @ theta[own]), 1e-300)
        found.append(np.full(last - first, np.clip(tau * a, LEAST, MOST)))
    return np.concatenate(found)
