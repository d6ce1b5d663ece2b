"""Whether a calibrated model follows its own healthy logs.

Its free run alone does not tell: it is carried off where a plant integrates or is held by its loop,
and the bank judges beside the sensors all the same. So a model whose free run is far off is doubted
only if what calibration found it to err by in a derivative is more than all that it has that
derivative do. A fault is told from what stays for the bank's memory T, and an error of size s that
lasts for tau has there a mean of

    s sqrt(2 r (1 - r (1 - exp(-1/r)))),    r = tau / T

(Gauss-Markov). False alarms are as rare as calibrated then, but which fault it is, and how large,
may be the error's doing: it looks like one fault at one operating point, and like another one
elsewhere.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.posterior.uncalibrated import level_in, uncalibrated
from faultgauge.detection.remember import once
from faultgauge.detection.rows.judged import operating_points
from faultgauge.identification.validation.evaluation import POOR_FREE_RUN
from faultgauge.plants.disturbed import dynamic_states
from faultgauge.plants.model import Model

__all__ = ["errs_by", "worst_error"]

LASTING = 1e4  # memories, from which on an error does not change within one


def errs_by(model: Model) -> dict[str, float]:
    """What stays of the model's own error in the derivative of each dynamic state that it has move,
    as a share of the standard deviation that this derivative has in the model over the training
    envelope."""
    noise, names, moved = noise_of(model), model.plant.signals.state_names, _moved(model)
    r = noise.lasting / max(level_in(model).memory_s, 1e-300)
    stays = noise.size * np.sqrt(np.clip(2 * r * (1 + r * np.expm1(-1 / r)), 0.0, 1.0))
    stays = np.where(r > LASTING, noise.size, stays)
    return {
        names[state]: float(stays[k] / moved[state])
        for k, state in enumerate(dynamic_states(model.plant))
        if moved[state] > 0
    }


def worst_error(model: Model) -> tuple[str, float] | None:
    """The state whose derivative a calibrated `model` gets most wrong, and how many times what it
    explains of it that is; None where its free run followed the data that it was not fitted to, or
    it explains more than it errs by."""
    if uncalibrated(model) or not model.record.metrics.free_run_error >= POOR_FREE_RUN:
        return None
    shares = errs_by(model)
    worst = max(shares, key=lambda name: shares[name], default="")
    return (worst, shares[worst]) if worst and shares[worst] >= 1 else None


@once
def _moved(model: Model) -> Float[np.ndarray, "states"]:
    points = operating_points(model)
    moved = jax.jit(jax.vmap(model.plant.derivative))(*map(jnp.asarray, points))
    return np.nan_to_num(np.std(np.asarray(moved), axis=0))
