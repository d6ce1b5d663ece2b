"""PNN and SPNN: one network of delayed inputs and outputs, trained in parallel or series-parallel.

    y(k) = V tanh(W [u(k) .. u(k-n_u), y(k-1) .. y(k-n_y)] + b) + c

In parallel the outputs fed back are the network's own, in series-parallel the plant's (K. S.
Narendra and K. Parthasarathy, IEEE Trans. Neural Networks 1, 1990).
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge_studies.baselines.baseline import Baseline, Scaling, Weights
from faultgauge_studies.baselines.static_network import layers, output_layer

__all__ = ["Narx", "narx"]


class Past(NamedTuple):
    """Newest first: u(k-1) .. u(k-n_u) and y(k-2) .. y(k-n_y)."""

    u: Float[Array, "input_delays inputs"]
    y: Float[Array, "output_delays 1"]


class Narx(Baseline):
    """`input_delays` besides u(k) itself, `output_delays` from y(k-1) on."""

    weights: Weights
    scaling: Scaling
    input_delays: int = eqx.field(static=True)
    output_delays: int = eqx.field(static=True)

    def begin(self, u: Float[Array, "inputs"], y: Float[Array, "1"]) -> Past:
        return Past(
            jnp.broadcast_to(u, (self.input_delays, u.size)),
            jnp.broadcast_to(y, (self.output_delays - 1, 1)),
        )

    def step(
        self, carry: Past, u: Float[Array, "inputs"], y: Float[Array, "1"]
    ) -> tuple[Past, Float[Array, "1"]]:
        inputs = jnp.concatenate([u[None], carry.u])
        outputs = jnp.concatenate([y[None], carry.y])
        regressors = jnp.concatenate([inputs.reshape(-1), outputs.reshape(-1)])
        hidden = jnp.tanh(self.weights["weights_in"] @ regressors + self.weights["bias"])
        yhat = output_layer(self.weights, hidden, "purelin")
        return Past(inputs[: self.input_delays], outputs[: self.output_delays - 1]), yhat


def narx(
    scaling: Scaling,
    hidden: int,
    rng: np.random.Generator,
    input_delays: int = 1,
    output_delays: int = 2,
) -> Narx:
    """Delays [0 1] and [1 2] are those of Table 2."""
    arity = (input_delays + 1) * len(scaling.u_center) + output_delays
    return Narx(layers(hidden, arity, rng), scaling, input_delays, output_delays)
