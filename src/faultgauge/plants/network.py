"""The small network that stands for one unknown nonlinearity."""

import dataclasses
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from faultgauge.plants.plant import ValueChange
from faultgauge.plants.shape import FREE, Shape
from faultgauge.products import contract

__all__ = ["Network"]

LEAST = 1e-12  # softplus underflows to 0 far below it; a division by the network stays finite


class Network(eqx.Module):
    """One hidden layer, tansig and linear, between fixed scalings (paper, eqs 3 and 4):

        p_s = clip((p - input_center) / input_scale, -1, 1)
        NN(p) = output_center + output_scale (W1 tanh(W2 p_s + theta) + theta_out)

    tanh(z) is eq 4's 2 / (1 + exp(-2 z)) - 1. The scalings map the training range on [-1, 1];
    outside it an argument counts as the edge, because what a network makes up beyond its data
    may drive a simulation anywhere.

    A `shape` changes the parenthesis N(p_s), so that every weight vector satisfies it and a fit
    needs no constraints:

        odd           W1 (tanh(W2 p_s + theta) + tanh(W2 p_s - theta)) / 2, which is
                      (N(p_s) - N(-p_s)) / 2
        zero_at_zero  N(p_s) - N(p_s at p = 0)
        monotone      W1 and W2 squared, W1 negative where decreasing: the products that decide
                      have one sign. A square is smooth and reaches 0, where a unit drops out;
                      an exponential would send its weight to infinity for that.
        positive      softplus(N(p_s))

    For these the scalings are those of `Shape.scalings`, and output_center is 0.
    """

    weights_out: Float[Array, "hidden"]
    weights_in: Float[Array, "hidden arguments"]
    bias: Float[Array, "hidden"]
    bias_out: Float[Array, ""]
    input_center: Float[Array, "arguments"]
    input_scale: Float[Array, "arguments"]
    output_center: Float[Array, ""]
    output_scale: Float[Array, ""]
    shape: Shape = eqx.field(static=True, default=FREE)

    def __call__(self, *arguments: Float[Array, ""] | float) -> Float[Array, ""]:
        """Value at one point, one scalar per argument."""
        p = jnp.stack(jnp.broadcast_arrays(*arguments))
        value = self._inside(p)
        if self.shape.positive:
            value = jax.nn.softplus(value) + LEAST
        return self.output_center + self.output_scale * value

    def _scaled(self, p: Float[Array, "*points arguments"]) -> Float[Array, "*points arguments"]:
        return jnp.clip((p - self.input_center) / self.input_scale, -1.0, 1.0)

    def _inside(self, p: Float[Array, "arguments"]) -> Float[Array, ""]:
        """N(p_s), before it is made positive."""
        shape, outer, inner = self.shape, self.weights_out, self.weights_in
        if shape.monotone:
            inner = inner**2
            outer = outer**2 if shape.monotone == "increasing" else -(outer**2)
        into, out = partial(contract, "hi,i->h", inner), partial(contract, "h,h->", outer)
        if shape.odd:
            z = into(self._scaled(p))
            return out(jnp.tanh(z + self.bias) + jnp.tanh(z - self.bias)) / 2
        if shape.zero_at_zero:
            # scaled together, or compilers may round the two differently
            scaled, zero = self._scaled(jnp.stack([p, jnp.zeros_like(p)]))
            start, step = into(zero) + self.bias, into(scaled - zero)
            # tanh(a + d) - tanh(a) as a product, which is exactly 0 at d = 0
            rest = 1 - jnp.tanh(start) * jnp.tanh(start + step)
            return out(jnp.tanh(step) * rest)
        return out(jnp.tanh(into(self._scaled(p)) + self.bias)) + self.bias_out

    def arrays(self) -> dict[str, Float[Array, "..."]]:
        """Weights and scalings by name."""
        return {name: value for name, value in vars(self).items() if name != "shape"}

    def altered(self, change: ValueChange) -> "Network":
        """The network whose value is factor NN(p) + shift everywhere, at no cost in evaluation."""
        return dataclasses.replace(
            self,
            output_center=change.of(self.output_center),
            output_scale=change.factor * self.output_scale,
        )

    @staticmethod
    def zeros(hidden: int, arity: int, shape: Shape = FREE) -> "Network":
        """An untrained network: zero everywhere (log 2 where positive), unit scalings."""
        return Network(
            weights_out=jnp.zeros(hidden),
            weights_in=jnp.zeros((hidden, arity)),
            bias=jnp.zeros(hidden),
            bias_out=jnp.zeros(()),
            input_center=jnp.zeros(arity),
            input_scale=jnp.ones(arity),
            output_center=jnp.zeros(()),
            output_scale=jnp.ones(()),
            shape=shape,
        )
