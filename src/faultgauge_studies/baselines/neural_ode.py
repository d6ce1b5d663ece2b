"""A black-box neural ordinary differential equation with latent states.

    dz/dt = A z + B u + NN_f(z, u),   y = C z + D u + NN_h(z, u),   z(0) = E [u(0), y(0), 1]

One Runge-Kutta step of the fourth order per sample, trained through time. R. T. Q. Chen et al.,
"Neural ordinary differential equations", NeurIPS 2018; latent states and an encoder as in G.
Beintema et al., "Deep subspace encoders for nonlinear system identification", Automatica 156, 2023.
"""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.optimise.starts import nguyen_widrow
from faultgauge_studies.baselines.baseline import Baseline, Scaling, Weights

__all__ = ["NeuralOde", "neural_ode"]

SMALL = 0.1
SLOW = 0.02  # 1/s: size of the first guess of A


class NeuralOde(Baseline):
    """Continuous: `dt` [s] is the samples', not the model's."""

    weights: Weights
    scaling: Scaling
    dt: float = eqx.field(static=True)

    def every(self, dt: float) -> "NeuralOde":
        """The same model for samples `dt` [s] apart."""
        return replace(self, dt=dt)

    def begin(
        self, u: Float[Array, "inputs"], y: Float[Array, "outputs"]
    ) -> Float[Array, "latent"]:
        return self.weights["encoder"] @ jnp.concatenate([u, y, jnp.ones(1)])

    def step(
        self, carry: Float[Array, "latent"], u: Float[Array, "inputs"], y: Float[Array, "outputs"]
    ) -> tuple[Float[Array, "latent"], Float[Array, "outputs"]]:
        def rate(z: Array) -> Array:
            return self._part("f", z, u)

        z, dt = carry, self.dt
        k1 = rate(z)
        k2 = rate(z + dt / 2 * k1)
        k3 = rate(z + dt / 2 * k2)
        k4 = rate(z + dt * k3)
        return z + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4), self._part("h", z, u)

    def _part(self, name: str, z: Array, u: Array) -> Array:
        w, x = self.weights, jnp.concatenate([z, u])
        hidden = jnp.tanh(w[f"{name}_in"] @ x + w[f"{name}_bias"])
        return w[f"{name}_line"] @ x + w[f"{name}_out"] @ hidden + w[f"{name}_bias_out"]


def neural_ode(
    scaling: Scaling, hidden: int, latent: int, dt: float, rng: np.random.Generator
) -> NeuralOde:
    """Small random rates at first, so that no start runs away; sampled every `dt` [s]."""
    inputs, outputs = len(scaling.u_center), len(scaling.y_center)
    arity = latent + inputs
    weights: Weights = {}
    for name, rows, size in (("f", latent, SLOW), ("h", outputs, 1.0)):
        net = nguyen_widrow(hidden, arity, rng)
        weights[f"{name}_in"] = jnp.asarray(net["weights_in"])
        weights[f"{name}_bias"] = jnp.asarray(net["bias"])
        weights[f"{name}_out"] = jnp.asarray(SMALL * size * rng.uniform(-1, 1, (rows, hidden)))
        weights[f"{name}_line"] = jnp.asarray(size * rng.normal(0, 1, (rows, arity)))
        weights[f"{name}_bias_out"] = jnp.zeros(rows)
    weights["encoder"] = jnp.asarray(rng.normal(0, 0.5, (latent, inputs + outputs + 1)))
    return NeuralOde(weights, scaling, dt)
