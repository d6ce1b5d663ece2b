"""Bayesian regularisation: the weight of the weights' own size, from the evidence.

    minimise  beta E_D + alpha E_W,   E_D = sum r^2 over n equations, E_W = sum theta^2 over p
    gamma = p - 2 alpha tr(H^-1),     H = 2 beta J'J + 2 alpha I
    alpha = gamma/(2 E_W),            beta = (n - gamma)/(2 E_D)

D. J. C. MacKay, "Bayesian interpolation", Neural Computation 4, 1992; F. D. Foresee and M. T.
Hagan, "Gauss-Newton approximation to Bayesian learning", ICNN 1997. gamma is the number of
parameters that the data determine.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from faultgauge.identification.optimise.levenberg_marquardt import (
    Options,
    levenberg_marquardt,
)
from faultgauge.identification.optimise.normal_equations import normal_equations
from faultgauge_studies.baselines.baseline import Baseline, Record
from faultgauge_studies.baselines.training import Mode, RunResidual, with_weights

__all__ = ["Evidence", "evidence_step", "train_by_evidence"]

ROUNDS, TRIALS = 40, 8  # updates of the evidence, and LM trials between two of them
SETTLED = 1e-3  # relative change of gamma that ends it


class Evidence(NamedTuple):
    """`gamma` effective parameters of `parameters`; `ratio` = alpha/beta, the weight's weight."""

    model: Baseline
    gamma: float
    parameters: int
    ratio: float
    trials: int


@eqx.filter_jit
def evidence_step(
    residual: RunResidual,
    theta: Float[Array, "parameters"],
    samples: Record,
    ratio: Float[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """(gamma, new alpha/beta) at the minimum found with alpha/beta = `ratio`."""
    cost, hessian, _ = normal_equations(residual, theta, samples)
    # H^-1 alpha = (J'J/ratio + I)^-1 / 2: by eigenvalues, none of which is negative
    values = jnp.maximum(jnp.linalg.eigvalsh(hessian), 0.0)
    gamma = jnp.sum(values / (values + ratio))
    n = samples.y.size
    alpha, beta = gamma / (2 * theta @ theta), (n - gamma) / (2 * cost)
    return gamma, alpha / beta


def train_by_evidence(models: Sequence[Baseline], training: Record, mode: Mode) -> list[Evidence]:
    """From every one of `models`; no validation record is needed to stop."""
    training = jax.tree.map(jnp.asarray, training)
    return [_from(model, training, mode) for model in models]


def _from(model: Baseline, training: Record, mode: Mode) -> Evidence:
    residual = RunResidual(model, mode == "series_parallel")
    theta = ravel_pytree(model.weights)[0]
    free = jnp.full(theta.size, jnp.inf)
    ratio, gamma, trials = jnp.asarray(0.01 / training.y.size), jnp.asarray(np.inf), 0
    for _ in range(ROUNDS):
        found = levenberg_marquardt(
            residual,
            theta[None],
            training,
            None,
            -free,
            free,
            Options(max_trials=TRIALS),
            jnp.broadcast_to(ratio, theta.shape),
        )
        theta, trials = found.theta[0], trials + int(found.trials[0])
        before = gamma
        gamma, ratio = evidence_step(residual, theta, training, ratio)
        if abs(float(gamma - before)) < SETTLED * float(gamma):
            break
    return Evidence(with_weights(model, theta), float(gamma), int(theta.size), float(ratio), trials)
