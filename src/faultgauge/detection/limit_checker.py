"""When an alarm begins and ends: persistence, hysteresis, latching (NASA cFS Limit Checker, LC)."""

import numpy as np
from jaxtyping import Bool, Float

__all__ = ["LimitChecker"]

ROUNDING = 1e-9  # of a persistence


class LimitChecker:
    """One watch point: engaged once `over` has held for `persistence` [s] on end, until `under`,
    or for good where it latches. Carries its state from call to call."""

    def __init__(self, persistence: float, latch: bool) -> None:
        self.persistence, self.latch = persistence, latch
        self.since = np.nan  # since when it has been over [s]
        self.engaged = False

    def judge(
        self,
        t: Float[np.ndarray, "samples"],
        over: Bool[np.ndarray, "samples"],
        under: Bool[np.ndarray, "samples"],
    ) -> Bool[np.ndarray, "samples"]:
        """Whether it is engaged at each sample; where a sample is neither over nor under, it stays
        what it was, but does not persist."""
        before = np.concatenate([[np.isfinite(self.since)], over[:-1]])
        begins = np.where(over & ~before, t, -np.inf)
        carried = self.since if before[0] else -np.inf
        since = np.maximum(np.maximum.accumulate(begins), carried)
        holds = over & (t - since >= self.persistence * (1 - ROUNDING))
        turns = np.where(holds, 1, np.where(under & (not self.latch), -1, 0))
        last = np.maximum.accumulate(np.where(turns != 0, np.arange(len(t)), -1))
        engaged = np.where(last >= 0, turns[last] > 0, self.engaged)
        if len(t):
            self.since = float(since[-1]) if over[-1] else np.nan
            self.engaged = bool(engaged[-1])
        return engaged
