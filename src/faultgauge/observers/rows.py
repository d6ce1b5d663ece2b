"""One function of many rows, of which some need no answer.

What computes with many vectors takes all rows at once and leaves out what nobody needs; a processor
and C, which take one after the other, do not even begin with those.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

__all__ = ["where_needed"]


def where_needed(
    of: Callable[[Any, Any], tuple[Any, Any]],
    needed: Bool[Array, "rows"],
    state: Any,
    given: Any,
) -> tuple[Any, Any]:
    """`of(state, given) -> (state, answer)` of every row that is `needed`; others keep their state
    and answer 0. All are pytrees of arrays along whose first axis the rows are, of which `of` takes
    any number, each row for itself."""
    once = jax.jit(lambda state, given: of(state, given))  # traced once for shapes and answers

    def at_once(needed: Array, state: Any, given: Any) -> tuple[Any, Any]:
        new = of(state, given)
        old = state, jax.tree.map(jnp.zeros_like, new[1])

        def chosen(a: Array, b: Array) -> Array:
            return jnp.where(needed.reshape(-1, *([1] * (a.ndim - 1))), a, b)

        return jax.tree.map(chosen, new, old)

    def in_turn(needed: Array, state: Any, given: Any) -> tuple[Any, Any]:
        one_row = jax.tree.map(lambda a: a[:1], (state, given))
        shapes = jax.eval_shape(once, *one_row)[1]

        def one(carry: tuple, k: Array) -> tuple[tuple, None]:
            def row(a: Array) -> Array:
                return jax.lax.dynamic_slice_in_dim(a, k, 1)

            def put(a: Array, new: Array) -> Array:
                return jax.lax.dynamic_update_slice_in_dim(a, new, k, 0)

            def go(carry: tuple) -> tuple:
                # answers first: they may still read the state that was
                new = once(*(jax.tree.map(row, tree) for tree in (carry[1], given)))
                return jax.tree.map(put, carry, new[::-1])

            return jax.lax.cond(needed[k], go, lambda carry: carry, carry), None

        nothing = jax.tree.map(lambda a: jnp.zeros((len(needed), *a.shape[1:]), a.dtype), shapes)
        places = jnp.arange(len(needed), dtype=jnp.uint32)  # which are never negative
        said, state = jax.lax.scan(one, (nothing, state), places)[0]
        return state, said

    if jax.default_backend() == "cpu":
        return in_turn(needed, state, given)
    return jax.lax.platform_dependent(needed, state, given, c=in_turn, cpu=in_turn, default=at_once)
