"""Next to nothing of every lag and curve: one compiled program for all that are tried."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration.innovation_likelihood import Likelihood
from faultgauge.detection.calibration.noise_levels import LAG, Spans
from faultgauge.plants.disturbed import deriving_outputs, following_inputs
from faultgauge.plants.model import Model

__all__ = ["trailing_outputs", "with_traces"]

LITTLE = 1e-6  # of an input's change, or of the shortest time: as good as no lag
STRAIGHT = 1e-9  # of an input's range: as good as no curve


def trailing_outputs(model: Model, batch: Likelihood) -> Bool[np.ndarray, "outputs"]:
    """The measured outputs that read no derivative: their sensors may lag."""
    measured = np.array([bool(jnp.isfinite(y).any()) for y in jnp.moveaxis(batch.y, 2, 0)])
    return measured & ~np.isin(np.arange(len(measured)), deriving_outputs(model.plant))


def with_traces(model: Model, batch: Likelihood, noise: Noise, spans: Spans) -> Noise:
    """`noise` with next to nothing of each lag and curve that it does not have."""
    inputs = np.isin(np.arange(len(noise.lean)), following_inputs(model.plant))
    outputs = trailing_outputs(model, batch)
    late, slow, bent = (a == 0 for a in (noise.lean, noise.trail, noise.bend))
    return noise._replace(
        lean=np.where(inputs & late, LITTLE * LAG, noise.lean),
        leaning=np.where(inputs & late, spans.shortest, noise.leaning),
        trail=np.where(outputs & slow, LITTLE * spans.shortest, noise.trail),
        bend=np.where(inputs & bent, STRAIGHT, noise.bend),
    )
