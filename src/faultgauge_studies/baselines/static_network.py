"""SNN: a static network, y = NN(u). It has no memory (paper, Tables 1 and 2)."""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.optimise.starts import nguyen_widrow
from faultgauge_studies.baselines.baseline import Baseline, Scaling, Weights

__all__ = ["Output", "StaticNetwork", "layers", "output_layer", "static_network"]

Output = Literal["tansig", "purelin"]


def layers(hidden: int, arity: int, rng: np.random.Generator) -> Weights:
    """Weights of a hidden layer and one linear output, by Nguyen and Widrow."""
    start = nguyen_widrow(hidden, arity, rng)
    return {name: jnp.asarray(value) for name, value in start.items()}


def output_layer(
    weights: Weights, hidden: Float[Array, "hidden"], kind: Output
) -> Float[Array, "1"]:
    y = weights["weights_out"] @ hidden + weights["bias_out"]
    return jnp.atleast_1d(jnp.tanh(y) if kind == "tansig" else y)


class StaticNetwork(Baseline):
    """logsig hidden units, as Table 2 has them."""

    weights: Weights
    scaling: Scaling
    output: Output = eqx.field(static=True)

    def begin(self, u: Float[Array, "inputs"], y: Float[Array, "1"]) -> None:
        return None

    def step(
        self, carry: None, u: Float[Array, "inputs"], y: Float[Array, "1"]
    ) -> tuple[None, Float[Array, "1"]]:
        hidden = jax.nn.sigmoid(self.weights["weights_in"] @ u + self.weights["bias"])
        return None, output_layer(self.weights, hidden, self.output)


def static_network(
    scaling: Scaling, hidden: int, rng: np.random.Generator, output: Output
) -> StaticNetwork:
    return StaticNetwork(layers(hidden, len(scaling.u_center), rng), scaling, output)
