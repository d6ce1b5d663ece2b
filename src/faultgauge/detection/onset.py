"""When a fault began, from when it was told: the delay that its size takes against the noise.

A fault of size f leaves f^2 / (2 sd(n)^2) of log-likelihood after n samples, with a standard
deviation of the root of twice that (a Gaussian mean shift). It is told when this outweighs the
prior odds, -ln(onset rate x step), up to the alarm's log-odds, and what the unknown size costs,
ln(prior size / sd(n)). What the model errs by adds to the variance sd(n)^2.
"""

import numpy as np

from faultgauge.detection.bank import FaultBank

__all__ = ["onset_of"]

WIDE = 1.959964


def onset_of(bank: FaultBank, fault: int, size: float) -> tuple[float, float, float]:
    """(likely, longest, shortest) delay [s] between onset and alarm of a fault of this `size`."""
    known = np.hypot(bank.known[:, fault], bank.error[bank.sets.index((fault,)), 0])
    needed = -np.log(bank.levels.onset[fault] * bank.step) + bank.level
    unsure = np.log(np.maximum(bank.levels.size[fault] / known, 1.0))
    spread = WIDE * np.sqrt(2.0)
    longest = ((spread + np.sqrt(spread**2 + 4 * needed)) / 2) ** 2
    shortest = ((-spread + np.sqrt(spread**2 + 4 * needed)) / 2) ** 2

    def delay(wanted: float) -> float:
        told = np.flatnonzero(size**2 / (2 * known**2) >= wanted + unsure)
        return float(bank.step * (told[0] if len(told) else len(known)))

    return delay(needed), delay(longest) + bank.step, max(delay(shortest) - bank.step, 0.0)
