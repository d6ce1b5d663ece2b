"""Parameters that drift within a run: a random walk, straight between its knots.

    theta(n) = theta(0) + sum_k clip((n - k m) / m, 0, 1) r sqrt(m / N) c_k,   c_k ~ N(0, 1)

n samples after a window began, with a knot every m samples; r is how far it walks in N samples, one
standard deviation, in units of theta (see `unknowns`). How large r is the data say, where the
evidence is greatest (see `evidence`), so that a parameter that stays where it is is left there.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

__all__ = ["SlowWalk"]

SEGMENTS, SHORTEST = 16, 16  # of the longest window, at most; samples of one, at least
INCREMENTS = 1000  # of all windows together: normal equations are as large
FIRST = 0.1  # prior standard deviations of theta: positive constants move by a quarter


@dataclass(frozen=True)
class SlowWalk:
    """How far each of the slow parameters walks in `across` samples, knots `segment` apart."""

    scale: Float[np.ndarray, "slow"]
    across: int
    segment: int

    @classmethod
    def over(cls, slow: int, longest: int, windows: int) -> "SlowWalk":
        """Of `slow` parameters in so many `windows` of up to `longest` samples."""
        segments = min(SEGMENTS, max(1, INCREMENTS // (windows * max(slow, 1))))
        return cls(np.full(slow, FIRST), longest, max(SHORTEST, math.ceil(longest / segments)))

    def increments(self, length: int) -> int:
        """Of one parameter in a window of `length` samples."""
        return -(-length // self.segment) if len(self.scale) else 0

    def walk(self, length: int) -> Float[np.ndarray, "samples increments slow"]:
        """What each increment c adds to theta at each sample."""
        n, k = np.arange(length)[:, None], np.arange(self.increments(length))
        ramps = np.clip(n / self.segment - k, 0.0, 1.0)
        return ramps[..., None] * self.scale * math.sqrt(self.segment / self.across)

    def lengthened(
        self, z: Float[np.ndarray, "windows local"], length: int, longer: int
    ) -> Float[np.ndarray, "windows local_"]:
        """What is local to windows of `length` samples for such of `longer`: what is known no
        further stays where it is."""
        more = (self.increments(longer) - self.increments(length)) * len(self.scale)
        return np.pad(z, ((0, 0), (0, more)))

    def none(self) -> "SlowWalk":
        """Of no parameter."""
        return replace(self, scale=np.zeros(0))

    def rescaled(self, factor: Float[np.ndarray, "slow"]) -> "SlowWalk":
        return replace(self, scale=self.scale * factor)
