"""Products and parts of small matrices, as a compiler of loops takes them best.

XLA leaves a product of matrices to a library, at some microseconds a call, and makes one kernel of
a whole loop where there is none. Sums of products it puts into what is around them. Of many units,
which stand last (`lanes_last`), it would lay all products down before and add number by number:
there the sums are written out, and each term is vector code.
"""

from functools import reduce
from threading import local

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

__all__ = ["among", "contract", "taken", "written_out"]

TERMS = 128  # of a sum that is written out, at most


class _WrittenOut(local):
    """Sums of products are written out while a thread is in it."""

    depth = 0

    def __enter__(self) -> None:
        self.depth += 1

    def __exit__(self, *_: object) -> None:
        self.depth -= 1


written_out = _WrittenOut()


def contract(
    form: str, left: Float[Array | np.ndarray, "..."], right: Float[Array | np.ndarray, "..."]
) -> Float[Array, "..."]:
    """The sums of products of two arrays that `form` names as in `einsum`: "ij,j->i" is A x."""
    inputs, kept = form.split("->")
    names = inputs.split(",")
    order = kept + "".join(dict.fromkeys(k for k in inputs if k not in kept + ","))
    length = dict(zip("".join(names), (*left.shape, *right.shape), strict=True))
    summed = order[len(kept) :]
    if written_out.depth and len(summed) == 1 and 0 < length[summed] <= TERMS:
        both = [(a, its.index(summed)) for a, its in zip((left, right), names, strict=True)]
        terms = ([jax.lax.index_in_dim(a, k, axis, keepdims=False) for a, axis in both]
                 for k in range(length[summed]))  # fmt: skip
        return reduce(jnp.add, (contract(form.replace(summed, ""), *each) for each in terms))

    def spread(a: Array | np.ndarray, its: str) -> Array:
        turned = jax.lax.transpose(a, [its.index(k) for k in order if k in its])
        at = [n for n, k in enumerate(order) if k in its]
        return jax.lax.broadcast_in_dim(turned, [length[k] for k in order], at)

    both = spread(left, names[0]) * spread(right, names[1])
    return jnp.sum(both, axis=tuple(range(len(kept), len(order)))) if summed else both


def taken(
    array: Float[Array, "..."], places: Int[np.ndarray, "some"], axis: int = 0
) -> Float[Array, "..."]:
    """What stands at the `places` along the `axis`, by slices, which cost less than a gather."""
    pieces = np.split(places, np.flatnonzero(np.diff(places) != 1) + 1) if len(places) else []
    if not pieces:
        return jax.lax.slice_in_dim(array, 0, 0, axis=axis)
    cut = [jax.lax.slice_in_dim(array, int(p[0]), int(p[-1]) + 1, axis=axis) for p in pieces]
    return cut[0] if len(cut) == 1 else jnp.concatenate(cut, axis)


def among(
    array: Float[Array, "m some"], places: Int[np.ndarray, "some"], count: int
) -> Float[Array, "m count"]:
    """`array` as those of `count` columns that stand at the `places`, which ascend; 0 elsewhere."""
    pieces, at = [], 0
    for which in np.split(np.arange(len(places)), np.flatnonzero(np.diff(places) != 1) + 1):
        if not len(which):
            continue
        begin, end = int(places[which[0]]), int(places[which[-1]]) + 1
        pieces += [
            jnp.zeros((len(array), begin - at)),
            array[:, int(which[0]) : int(which[-1]) + 1],
        ]
        at = end
    pieces.append(jnp.zeros((len(array), count - at)))
    return jnp.concatenate([each for each in pieces if each.shape[1]], axis=1)
