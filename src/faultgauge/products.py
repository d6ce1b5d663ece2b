"""Products of small matrices, as a compiler of loops takes them best.

XLA leaves a product of matrices to a library, at some microseconds a call, and makes one kernel of
a whole loop where there is none. Sums of products it puts into what is around them.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

__all__ = ["contract"]


def contract(
    form: str, left: Float[Array | np.ndarray, "..."], right: Float[Array | np.ndarray, "..."]
) -> Float[Array, "..."]:
    """The sums of products of two arrays that `form` names as in `einsum`: "ij,j->i" is A x."""
    inputs, kept = form.split("->")
    names = inputs.split(",")
    order = kept + "".join(dict.fromkeys(k for k in inputs if k not in kept + ","))

    def spread(a: Array | np.ndarray, its: str) -> Array:
        turned = jnp.transpose(a, [its.index(k) for k in order if k in its])
        return jnp.expand_dims(turned, [n for n, k in enumerate(order) if k not in its])

    both = spread(left, names[0]) * spread(right, names[1])
    return jnp.sum(both, axis=tuple(range(len(kept), len(order))))
