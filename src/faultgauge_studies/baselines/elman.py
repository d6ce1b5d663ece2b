"""RNN: Elman's recurrent network, trained through time.

    z(k) = tanh(W u(k) + R z(k-1) + b),   y(k) = g(V z(k) + c)

J. L. Elman, "Finding structure in time", Cognitive Science 14, 1990.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge_studies.baselines.baseline import Baseline, Scaling, Weights
from faultgauge_studies.baselines.static_network import Output, layers, output_layer

__all__ = ["Elman", "elman"]

SETTLE = 50  # steps on the first input before a run, so that it starts at rest


class Elman(Baseline):
    """Tansig context units."""

    weights: Weights
    scaling: Scaling
    output: Output = eqx.field(static=True)

    def begin(self, u: Float[Array, "inputs"], y: Float[Array, "1"]) -> Float[Array, "hidden"]:
        z = jnp.zeros_like(self.weights["bias"])
        return jax.lax.fori_loop(0, SETTLE, lambda _, z: self._context(z, u), z)

    def step(
        self, carry: Float[Array, "hidden"], u: Float[Array, "inputs"], y: Float[Array, "1"]
    ) -> tuple[Float[Array, "hidden"], Float[Array, "1"]]:
        z = self._context(carry, u)
        return z, output_layer(self.weights, z, self.output)

    def _context(self, z: Array, u: Array) -> Array:
        w = self.weights
        return jnp.tanh(w["weights_in"] @ u + w["recurrent"] @ z + w["bias"])


def elman(scaling: Scaling, hidden: int, rng: np.random.Generator, output: Output) -> Elman:
    """Context weights start small: memory grows where the data ask for it."""
    weights = layers(hidden, len(scaling.u_center), rng)
    weights["recurrent"] = jnp.asarray(rng.normal(0, 0.5 / np.sqrt(hidden), (hidden, hidden)))
    return Elman(weights, scaling, output)
