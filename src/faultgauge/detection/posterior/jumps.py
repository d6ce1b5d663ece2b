"""Where the size of a fault that stays jumps to another one, in the rows of the posterior.

Two rows disagree where their intervals do not meet. A jump lies between two rows that disagree and
are no more than a memory of the bank apart, where for a memory before the first and after the
second all agree: a size that grows steadily is never as quiet as that on both sides of a step.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

__all__ = ["Jump", "Sizes", "jumps"]


class Jump(NamedTuple):
    """A row that is `steady` at one size, the last row of it, the first of the next, and when that
    likely began [s]."""

    steady: int
    last: int
    first: int
    began: float


class Sizes(NamedTuple):
    """Rows in which a fault is sure: times [s], its 95 % interval, and since when it is as it is
    (mean and standard deviation [s])."""

    t: Float[np.ndarray, "rows"]
    lo: Float[np.ndarray, "rows"]
    hi: Float[np.ndarray, "rows"]
    since: Float[np.ndarray, "rows two"]

    def disagree(
        self, rows: Int[np.ndarray, "some"], others: Int[np.ndarray, "some"] | int
    ) -> Bool[np.ndarray, "some"]:
        return (self.lo[rows] > self.hi[others]) | (self.hi[rows] < self.lo[others])

    def agree(self, row: int, until: float) -> bool:
        """Whether all rows from `row` to the time `until`, forwards or backwards, agree with it,
        and reach that far."""
        if not self.t[0] <= until <= self.t[-1]:
            return False
        low, high = np.searchsorted(self.t, sorted((self.t[row], until)))
        return not self.disagree(np.arange(low, high + 1), row).any()


def jumps(sizes: Sizes, memory: float) -> list[Jump]:
    """The jumps of a fault, in the order of time; `memory` [s] of the bank."""
    t, found = sizes.t, list[Jump]()
    before = np.searchsorted(t, t - memory)
    apart = sizes.disagree(np.arange(len(t)), before)
    for start in np.flatnonzero(np.diff(apart, prepend=False) & apart):
        steady = int(before[start])
        if (found and steady < found[-1].first) or not sizes.agree(
            steady, float(t[steady] - memory)
        ):
            continue
        last = _last(sizes, steady, int(start), int(before[steady]))
        ahead = np.arange(start, np.searchsorted(t, t[last] + memory, "right"))
        for first in ahead[sizes.disagree(ahead, steady)].tolist():
            if sizes.agree(first, float(t[first] + memory)):
                found.append(Jump(steady, last, first, _began(sizes, steady, first)))
                break
    return found


def _last(sizes: Sizes, steady: int, start: int, quiet: int) -> int:
    """The last row before `start` of the size of `steady`: as sure of it as those from `quiet` on,
    as what may have jumped has a wider interval."""
    width, middle = sizes.hi - sizes.lo, (sizes.lo + sizes.hi) / 2
    rows = np.arange(steady, start)
    own = (middle[rows] >= sizes.lo[steady]) & (middle[rows] <= sizes.hi[steady])
    own &= width[rows] <= width[quiet : steady + 1].max()
    return int(rows[own][-1])


def _began(sizes: Sizes, before: int, after: int) -> float:
    """The posterior behind a jump holds that the fault is as old as before with probability 1 - w,
    or as the jump with w: with mean m and variance v of the date, and m0 before, the date of the
    jump is  c = m + v / (m - m0)."""
    (m0, _), (m, sd) = sizes.since[before], sizes.since[after]
    return float(m + sd**2 / (m - m0)) if m > m0 else float(sizes.t[after])
