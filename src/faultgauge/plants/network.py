"""The small network that stands for one unknown nonlinearity."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

__all__ = ["Network"]


class Network(eqx.Module):
    """One hidden layer, tansig and linear, between fixed scalings (paper, eqs 3 and 4):

        p_s = clip((p - input_center) / input_scale, -1, 1)
        NN(p) = output_center + output_scale (W1 tanh(W2 p_s + theta) + theta_out)

    tanh(z) is eq 4's 2 / (1 + exp(-2 z)) - 1. The scalings map the training range on [-1, 1];
    outside it an argument counts as the edge, because what a network makes up beyond its data
    may drive a simulation anywhere.
    """

    weights_out: Float[Array, "hidden"]
    weights_in: Float[Array, "hidden arguments"]
    bias: Float[Array, "hidden"]
    bias_out: Float[Array, ""]
    input_center: Float[Array, "arguments"]
    input_scale: Float[Array, "arguments"]
    output_center: Float[Array, ""]
    output_scale: Float[Array, ""]

    def __call__(self, *arguments: Float[Array, ""] | float) -> Float[Array, ""]:
        """Value at one point, one scalar per argument."""
        p = jnp.stack(jnp.broadcast_arrays(*arguments))
        scaled = jnp.clip((p - self.input_center) / self.input_scale, -1.0, 1.0)
        hidden = jnp.tanh(self.weights_in @ scaled + self.bias)
        return self.output_center + self.output_scale * (self.weights_out @ hidden + self.bias_out)

    @staticmethod
    def zeros(hidden: int, arity: int) -> "Network":
        """An untrained network: zero everywhere, unit scalings."""
        return Network(
            weights_out=jnp.zeros(hidden),
            weights_in=jnp.zeros((hidden, arity)),
            bias=jnp.zeros(hidden),
            bias_out=jnp.zeros(()),
            input_center=jnp.zeros(arity),
            input_scale=jnp.ones(arity),
            output_center=jnp.zeros(()),
            output_scale=jnp.ones(()),
        )
