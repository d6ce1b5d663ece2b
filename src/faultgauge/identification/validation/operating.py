"""The free-run error against the operating point: where the model is wrong."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.special import chdtri

__all__ = ["Profile", "profile", "quantile_bins"]

MOST_BINS = 10  # of one quantity
PER_BIN = 10  # samples


@dataclass(frozen=True)
class Profile:
    """Error in bins of one state or input that hold about as many samples each.

    Attributes:
        name: the state or input.
        unit: its unit as declared.
        low: smallest value in each bin.
        high: largest value in each bin.
        samples: in each bin.
        rms: of the error, the output's unit.
        mean: of the error, the output's unit.
        mean_sd: standard deviation of that mean, from independent samples.
        explained: share of the error's variance that the bins' means make up.
        by_chance: an error that does not depend on the quantity stays below it with 95 %:
            chi-square of bins - 1 degrees of freedom over the independent samples.
    """

    name: str
    unit: str
    low: Float[np.ndarray, "bins"]
    high: Float[np.ndarray, "bins"]
    samples: Int[np.ndarray, "bins"]
    rms: Float[np.ndarray, "bins"]
    mean: Float[np.ndarray, "bins"]
    mean_sd: Float[np.ndarray, "bins"]
    explained: float
    by_chance: float


def quantile_bins(x: Float[np.ndarray, "samples"], bins: int) -> Int[np.ndarray, "samples"]:
    """The bin of each sample: `bins` between quantiles, or one per value where values are few."""
    values = np.unique(x)
    if len(values) <= bins:
        return np.searchsorted(values, x)
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, bins + 1)))
    return np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)


def profile(
    name: str,
    unit: str,
    x: Float[np.ndarray, "samples"],
    e: Float[np.ndarray, "samples"],
    time: float,
) -> Profile:
    """Error `e` against `x`; `time` is the error's integrated autocorrelation time in samples."""
    index = quantile_bins(x, int(np.clip(len(e) // PER_BIN, 1, MOST_BINS)))
    members = [np.flatnonzero(index == k) for k in np.unique(index)]
    count = np.array([len(each) for each in members])
    mean = np.array([np.mean(e[each]) for each in members])
    scatter = np.array([np.std(e[each]) for each in members])
    variance = float(np.var(e))
    between = float(np.sum(count * (mean - np.mean(e)) ** 2)) / len(e)
    return Profile(
        name,
        unit,
        low=np.array([np.min(x[each]) for each in members]),
        high=np.array([np.max(x[each]) for each in members]),
        samples=count,
        rms=np.sqrt(mean**2 + scatter**2),
        mean=mean,
        mean_sd=scatter * np.sqrt(np.minimum(time / count, 1.0)),
        explained=between / variance if variance > 0 else 0.0,
        by_chance=min(float(chdtri(len(members) - 1, 0.05)) * time / len(e), 1.0)
        if len(members) > 1
        else 0.0,
    )
