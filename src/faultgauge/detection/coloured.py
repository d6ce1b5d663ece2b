"""Model error is not white: process noise as large as the model errs over many samples.

The likelihood of single innovations sees what changes from one sample to the next. The error of a
model lasts as long as an operating point, and so looks like a fault. The evidence for a constant
fault is a sum of whitened innovations e; over n samples of white ones

    E (e_1 + ... + e_n)^2 / n = 1,

and where it is more, at any n, that evidence is worth less by this factor. So where it is more
than by chance, the levels of states and drifting parameters are multiplied by the least c that
brings every horizon n down to 1.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

__all__ = ["Whitened", "long_run", "widening"]

FACTORS = 2.0 ** np.arange(0.5, 8.5, 0.5)
SHORTEST = 10  # samples summed; the next horizon is twice as long
FEWEST = 6  # sums that a horizon is judged by
CHANCE = 1e-4  # of white innovations to be taken for coloured ones, at one horizon

Whitened: TypeAlias = Float[np.ndarray, "samples outputs"]


def long_run(stretches: Sequence[Whitened], chance: float | None = None) -> float:
    """The largest mean square of sums over n = 10, 20, 40, ... samples, in units of what white
    ones have: 1, or what they reach with a probability of `chance` (m squares: chi-squared)."""
    worst, n = 0.0, SHORTEST
    while sum(len(e) // n for e in stretches) >= FEWEST:
        sums = []
        for e in stretches:
            blocks = e[: len(e) // n * n].reshape(-1, n, e.shape[1])
            known = np.maximum(np.isfinite(blocks).sum(axis=1), 1)
            sums.append(np.nansum(blocks, axis=1) / np.sqrt(known))
        every = np.concatenate(sums)
        m = len(every)
        usual = 1.0 if chance is None else float(chi2.isf(chance, m)) / m
        square = np.mean(every**2, axis=0) / usual
        worst = max(worst, float(square.max()))
        n *= 2
    return worst


def widening(whitened: Callable[[float], Sequence[Whitened]]) -> float:
    """The factor c, given the innovations as they are whitened with any."""
    if long_run(whitened(1.0), CHANCE) <= 1:
        return 1.0
    enough = (float(c) for c in FACTORS if long_run(whitened(float(c))) <= 1)
    return next(enough, float(FACTORS[-1]))
