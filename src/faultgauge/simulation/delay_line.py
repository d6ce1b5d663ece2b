"""Dead time of inputs in a sampled simulation: each integration step looks its command up."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

__all__ = ["Taps", "acting", "taps"]


class Taps(NamedTuple):
    """The command that acts in each integration step of a sample: the one so many samples `back`,
    from its share `begin` to its share `end`."""

    back: Int[np.ndarray, "substeps inputs"]
    begin: Float[np.ndarray, "substeps inputs"]
    end: Float[np.ndarray, "substeps inputs"]

    @property
    def depth(self) -> int:
        """Samples whose commands are still needed, the present one included."""
        return int(self.back.max(initial=0)) + 1


def taps(delays: Sequence[float], dt: float, substeps: int) -> Taps:
    """Delays [s] as taps, to the nearest integration step dt / substeps."""
    steps = np.round(np.array(delays) * substeps / dt).astype(int)
    sample, k = np.divmod(np.arange(substeps)[:, None] - steps, substeps)
    return Taps(-sample, k / substeps, (k + 1) / substeps)


def acting(
    taps: Taps, past: Float[Array, "depth 2 inputs"]
) -> tuple[Float[Array, "substeps inputs"], Float[Array, "substeps inputs"]]:
    """Inputs at the beginning and at the end of every integration step of the newest sample.

    `past` holds where the command of each sample began and ended, the newest first.
    """
    # an input takes part in two neighbouring samples at most: slices, as a gather takes longer
    newer = taps.back[-1]
    older = np.minimum(newer + 1, taps.depth - 1)
    early = taps.back > newer

    def ends(back: Int[np.ndarray, "inputs"], end: int) -> Float[Array, "inputs"]:
        return jnp.array([past[b, end, j] for j, b in enumerate(back)], float)

    first, last = (jnp.where(early, ends(older, end), ends(newer, end)) for end in (0, 1))
    return first + taps.begin * (last - first), first + taps.end * (last - first)
