"""Residuals of which weighted means count, as under a kernel that many samples share points of.

Every point is evaluated once, however many samples hold it: the means, of residuals and of rows of
their Jacobian alike, are linear in them.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

__all__ = ["Means", "means_of", "points_of"]


class Means(eqx.Module):
    """Samples that are means over `points`, a tree of arrays, points first: each over those from
    its `first` on, each equation by its own `weights`."""

    points: Any
    first: Int[Array | np.ndarray, "samples"]
    weights: Float[Array | np.ndarray, "equations under"]

    def of(
        self, rows: Float[Array, "*rows equations points"]
    ) -> Float[Array, "*rows equations samples"]:
        """The samples' means of what is known at every point."""
        # point by point under the weights: what all samples hold at once would leave the cache
        first, weights = jnp.asarray(self.first), jnp.asarray(self.weights)
        apart = jnp.moveaxis(rows, -1, 0)

        def add(k: Array, total: Array) -> Array:
            return total + weights[:, k] * apart[first + k]

        nothing = jnp.zeros((len(first), *apart.shape[1:]))
        return jnp.moveaxis(jax.lax.fori_loop(0, weights.shape[1], add, nothing), 0, -1)


def points_of(samples: Any) -> Any:
    """Where residuals are evaluated: the samples themselves, but for `Means`."""
    return samples.points if isinstance(samples, Means) else samples


def means_of(
    samples: Any, rows: Float[Array, "*rows equations points"]
) -> Float[Array, "*rows equations samples"]:
    """What is known at `points_of(samples)` as it counts at `samples`."""
    return samples.of(rows) if isinstance(samples, Means) else rows
