"""The square root of plant files, with an end to its slope at 0."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

__all__ = ["square_root"]


@jax.custom_jvp
def square_root(x: Float[Array, "*_"]) -> Float[Array, "*_"]:
    """`jnp.sqrt`, whose slope at 0 is taken as 0.

    The true slope has no end there, and times the 0 of max(x, 0) is no number: a tank that begins
    empty, `sqrt(max(x, 0))`, would leave every gradient through it without one.
    """
    return jnp.sqrt(x)


@square_root.defjvp
def _slope(x: tuple[Array], dx: tuple[Array]) -> tuple[Array, Array]:
    y = square_root(*x)
    above = y > 0
    return y, dx[0] * jnp.where(above, 0.5 / jnp.where(above, y, 1.0), 0.0)
