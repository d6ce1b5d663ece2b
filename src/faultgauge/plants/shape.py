"""What a plant file may demand of an unknown function beside its arguments."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

__all__ = ["FREE", "Monotone", "Shape"]

Monotone = Literal["increasing", "decreasing"]


@dataclass(frozen=True)
class Shape:
    """Constraints that a network satisfies with any weights.

    `odd`: NN(-p) = -NN(p). `zero_at_zero`: NN(0) = 0. `positive`: NN(p) > 0. `monotone`: in every
    argument. All are meant for arguments and values as they stand, before any scaling.
    """

    odd: bool = False
    zero_at_zero: bool = False
    positive: bool = False
    monotone: Monotone | None = None

    def scalings(
        self, low: Float[np.ndarray, "arguments"], high: Float[np.ndarray, "arguments"]
    ) -> tuple[Float[np.ndarray, "arguments"], Float[np.ndarray, "arguments"]]:
        """(center, scale) that map arguments in [low, high] into [-1, 1].

        What an odd function does at p it does at -p: its range is centered at 0. One that has to
        be 0 at 0 has 0 in its range, or the edge nearest to 0 would be held at 0 instead.
        """
        if self.odd:
            scale = np.maximum(np.abs(low), np.abs(high))
            return np.zeros_like(scale), scale
        if self.zero_at_zero:
            low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
        return (low + high) / 2, (high - low) / 2


FREE = Shape()
