"""Running a pure step along samples: a file 256 at a time, a stream one by one, the same bits.

Two compiled programs of one formula may round differently. So there is one program, whose count
of samples is an argument: what it answers to a sample depends on the samples before it and not on
how many came at once.
"""

from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from faultgauge.programs import program

__all__ = ["CHUNK", "Stepping", "follow"]

CHUNK = 256  # rows that one compiled walk takes

S = TypeVar("S")


@runtime_checkable
class Stepping(Protocol):
    """Whatever answers a sample with a row: observers, references, and what combines them."""

    @property
    def step(self) -> Callable[..., tuple[Any, Any]]:
        """(state, sample...) -> (state, answer)."""
        ...


def follow(
    judge: Stepping, state: S, samples: Sequence[Float[np.ndarray, "samples ..."]]
) -> tuple[S, Any]:
    """(state after the last sample, what `judge.step` says of each; NumPy arrays).

    `samples` are the arguments of `step` after the state, the samples first.
    """
    total = len(samples[0])
    # a first state of Python's numbers would be compiled for, and then that of the arrays after it
    state = jax.tree.map(lambda a: np.asarray(a) if getattr(a, "weak_type", False) else a, state)
    said = []
    for first in range(0, total, CHUNK):
        parts = [each[first : first + CHUNK] for each in samples]
        count = len(parts[0])
        chunk = tuple(np.concatenate([p, np.zeros((CHUNK - count, *p.shape[1:]))]) for p in parts)
        state, infos = _follow(judge, state, chunk, np.asarray(count))
        said.append(jax.tree.map(lambda a, n=count: np.asarray(a)[:n], infos))
    return state, jax.tree.map(lambda *pieces: np.concatenate(pieces), *said)


@program
def _follow(
    judge: Any,
    state: Any,
    chunk: tuple[Float[Array | np.ndarray, "chunk ..."], ...],
    count: Int[Array | np.ndarray, ""],
) -> tuple[Any, Any]:
    once = eqx.filter_jit(lambda s, x: judge.step(s, *x))  # traced once for shapes and answers
    _, shapes = eqx.filter_eval_shape(once, state, tuple(each[0] for each in chunk))
    blank = jax.tree.map(lambda a: jnp.zeros((CHUNK, *a.shape), a.dtype), shapes)

    def body(k: Array, carried: tuple[Any, Any]) -> tuple[Any, Any]:
        state, infos = carried
        state, info = once(state, tuple(each[k] for each in chunk))
        return state, jax.tree.map(lambda whole, one: whole.at[k].set(one), infos, info)

    return jax.lax.fori_loop(0, count, body, (state, blank))
