"""How fast a plant runs away without its loop: the largest real part of the eigenvalues of dF/dx,
in the middle of what it does over the points of a fit."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.samples import Samples
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.programs import program

__all__ = ["growth"]

POINTS = 200  # that are looked at


def growth(plant: GrayBoxPlant, samples: Samples) -> float:
    """The median of it over `samples` [1/s]; negative where the plant comes back by itself."""
    chosen = np.linspace(0, len(samples.x) - 1, min(POINTS, len(samples.x))).astype(int)
    x, u = (jnp.asarray(part[chosen]) for part in (samples.x, samples.u))
    slopes = np.asarray(_slopes(plant, x, u))
    sound = np.isfinite(slopes).all(axis=(1, 2))
    if not sound.any():
        return 0.0
    return float(np.median(np.linalg.eigvals(slopes[sound]).real.max(axis=1)))


@program
def _slopes(
    plant: GrayBoxPlant, x: Float[Array, "samples states"], u: Float[Array, "samples inputs"]
) -> Float[Array, "samples states states"]:
    return jax.vmap(jax.jacfwd(plant.derivative))(x, u)
