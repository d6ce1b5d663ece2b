"""What a few trials prove of a share, a rate and a smallest size."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import isotonic_regression
from scipy.stats import chi2

__all__ = [
    "FOUND",
    "Rate",
    "Share",
    "Smallest",
    "over_runs",
    "poisson",
    "smallest_found",
    "wilson",
]

Z = 1.959963984540054  # of a normal distribution, 95 % lie within
DRAWS = 500  # of runs, for the interval of what no formula has one for
FOUND = 0.9  # share of faults that makes a size count as found


@dataclass(frozen=True)
class Share:
    """`count` of `total`, and the 95 % interval of the share behind them."""

    count: int
    total: int
    lo: float
    hi: float

    @property
    def value(self) -> float:
        return self.count / self.total if self.total else float("nan")


@dataclass(frozen=True)
class Rate:
    """`count` in `hours`, and the 95 % interval of the rate behind them, 1/h."""

    count: int
    hours: float
    lo: float
    hi: float

    @property
    def value(self) -> float:
        return self.count / self.hours if self.hours else float("nan")


class Smallest(NamedTuple):
    """A size that is found 90 % of the time; `at_most`: as the smallest one tried is."""

    size: float
    at_most: bool


def wilson(count: int, total: int) -> Share:
    """The score interval of Wilson (1927), with p = count / total and n = total,

        (p + z^2 / 2n +- z sqrt(p (1 - p) / n + z^2 / 4n^2)) / (1 + z^2 / n)

    [0, 1] where there was no trial.
    """
    if total == 0:
        return Share(0, 0, 0.0, 1.0)
    p, n = count / total, total
    middle = p + Z**2 / (2 * n)
    half = Z * np.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2))
    lo, hi = (middle - half) / (1 + Z**2 / n), (middle + half) / (1 + Z**2 / n)
    # exact at the ends, where rounding leaves 1e-17
    return Share(count, total, 0.0 if count == 0 else float(lo), 1.0 if count == n else float(hi))


def poisson(count: int, hours: float) -> Rate:
    """The exact interval of Garwood (1936): the chi-square quantiles 0.025 with 2n and 0.975 with
    2n + 2 degrees of freedom, over 2 T."""
    if hours <= 0:
        return Rate(count, 0.0, 0.0, float("inf"))
    lo = float(chi2.ppf(0.025, 2 * count)) if count else 0.0
    hi = float(chi2.ppf(0.975, 2 * count + 2))
    return Rate(count, hours, lo / (2 * hours), hi / (2 * hours))


def smallest_found(
    sizes: Sequence[float], found: Sequence[int], trials: Sequence[int]
) -> Smallest | None:
    """The size that is found 90 % of the time: shares made to grow with size (isotonic regression,
    weighed by trials), and a straight line over the logarithm of the size between two of them.

    `sizes` grow, all with trials. None where 90 % are never reached.
    """
    if not sizes:
        return None
    share = isotonic_regression(np.divide(found, trials), weights=np.array(trials, float)).x
    reached = np.flatnonzero(share >= FOUND - 1e-12)  # 9 of 10 are 90 %
    if len(reached) == 0:
        return None
    k = int(reached[0])
    if k == 0:
        return Smallest(float(sizes[0]), at_most=True)
    part = (FOUND - share[k - 1]) / (share[k] - share[k - 1])
    low, high = np.log(sizes[k - 1]), np.log(sizes[k])
    return Smallest(float(np.exp(low + part * (high - low))), at_most=False)


def over_runs(
    count: int, figure: Callable[[Int[np.ndarray, "draws runs"]], Float[np.ndarray, "draws"]]
) -> tuple[float, float]:
    """The 95 % interval of a `figure` of `count` runs by the percentile bootstrap, which draws
    whole runs with replacement (Efron, Ann. Statist. 7 (1979)): the figure of each draw, given the
    places of its runs. NaN for no run."""
    if count == 0:
        return np.nan, np.nan
    drawn = figure(np.random.default_rng(0).integers(count, size=(DRAWS, count)))
    # inf stands for "never", of which no mean may be taken
    lo, hi = np.quantile(drawn, [0.025, 0.975], method="closest_observation")
    return float(lo), float(hi)
