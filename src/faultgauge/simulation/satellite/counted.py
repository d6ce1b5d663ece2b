"""Random numbers by counting: what is drawn is a function of the seed and of the place it is for.

Threefry-2x32 with 20 rounds (J. K. Salmon, M. A. Moraes, R. O. Dror and D. E. Shaw, "Parallel
random numbers: as easy as 1, 2, 3", SC 2011), whose integers come out the same on every device.
Written out here because JAX's own is a loop, or a call, in the middle of what is one kernel.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt32

__all__ = ["normal", "threefry", "uniform"]

ROTATIONS = ((13, 15, 26, 6), (17, 29, 16, 24))  # bits by which a word turns, of the paper
PARITY = 0x1BD11BDA  # the paper's, so that a key of zeros is none


def threefry(
    key: tuple[UInt32[Array, ""], UInt32[Array, ""]],
    counter: tuple[UInt32[Array, "*n"], UInt32[Array, "*n"]],
) -> tuple[UInt32[Array, "*n"], UInt32[Array, "*n"]]:
    """The two words of a `counter` under a `key`."""
    keys = (*key, key[0] ^ key[1] ^ jnp.uint32(PARITY))
    a, b = counter[0] + keys[0], counter[1] + keys[1]
    for block in range(5):
        for by in ROTATIONS[block % 2]:
            a = a + b
            b = ((b << jnp.uint32(by)) | (b >> jnp.uint32(32 - by))) ^ a
        a = a + keys[(block + 1) % 3]
        b = b + keys[(block + 2) % 3] + jnp.uint32(block + 1)
    return a, b


def uniform(
    seed: UInt32[Array, ""], place: Int[Array, ""] | np.uint32, count: int
) -> Float[Array, "count"]:
    """`count` numbers in (0, 1) for a `place` in what is drawn from `seed` (both below 2^32)."""
    key = seed, jnp.uint32(0)
    pairs = jnp.arange((count + 1) // 2, dtype=jnp.uint32)
    words = threefry(key, (jnp.full_like(pairs, jnp.asarray(place).astype(jnp.uint32)), pairs))
    bits = jnp.concatenate(words)[:count]
    return (bits.astype(float) + 0.5) / 2.0**32


def normal(
    seed: UInt32[Array, ""], place: Int[Array, ""] | np.uint32, count: int
) -> Float[Array, "count"]:
    """The same, of the standard normal distribution."""
    centred = 2.0 * uniform(seed, place, count) - 1.0
    edge = 1.0 - jnp.finfo(centred.dtype).eps  # in single precision a number may round to 1
    return jnp.sqrt(2.0) * jax.lax.erf_inv(jnp.clip(centred, -edge, edge))
