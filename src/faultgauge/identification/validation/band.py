"""The 95 % band of the free-run error, and whether it keeps its promise on other data."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

__all__ = ["Band", "free_run_band", "given_band"]

LEVEL = 0.95  # of samples that a band should hold
FEWEST_STRETCHES = 3  # for a band that depends on time
PER_BIN = 40.0  # independent samples: leaving one of three stretches out still leaves 19 / 0.95
MOST_BINS = 12  # of the time since a start

Parts = Sequence[Float[np.ndarray, "_"]]


@dataclass(frozen=True)
class Band:
    """|error| of a new free run stays below `half_width` for a share `level` of its samples.

    Attributes:
        edges_s: ends of the time bins, s since the start of a run.
        half_width: of each bin, the output's unit.
        independent: samples that they are worth, by the memory of |error|.
        level: 95 %, or what so few independent samples can promise at most, n / (n + 1).
        share_inside: of samples that had no part in the band that they are held against.
        low: lower end of the 95 % interval of that share (Wilson, independent samples).
        high: its upper end.
        worst: the share inside in the worst stretch (or half).
        held_against: where the bands came from that the samples were held against.
        holds: whether `level` is not above that interval.
    """

    edges_s: Float[np.ndarray, "edges"]
    half_width: Float[np.ndarray, "bins"]
    independent: float
    level: float
    share_inside: float
    low: float
    high: float
    worst: float
    held_against: str
    holds: bool


def free_run_band(times: Parts, errors: Parts, time: float) -> Band:
    """The band of these free runs, each stretch held against the band of all others.

    The half width is the conformal quantile of |e|: the ceil(0.95 (n + 1))-th of n independent
    samples (Vovk et al. 2005). One stretch alone is cut into two halves. `times` are seconds since
    the start of the run, `time` the integrated autocorrelation time of |e| in samples.
    """
    whole, alone = np.concatenate(times), len(errors) == 1
    bins = 1
    if len(errors) >= FEWEST_STRETCHES:
        bins = int(np.clip(len(whole) / time // PER_BIN, 1, MOST_BINS))
    edges = np.unique(np.quantile(whole, np.linspace(0.0, 1.0, bins + 1)))
    if len(edges) < 2:
        edges = np.array([edges[0], edges[0]])
    if alone:
        half = len(whole) // 2
        times = [whole[:half], whole[half:]]
        errors = [errors[0][:half], errors[0][half:]]
    inside = []
    for k, (t, e) in enumerate(zip(times, errors, strict=True)):
        rest = [i for i in range(len(errors)) if i != k]
        others = np.concatenate([times[i] for i in rest])
        width = _widths(edges, others, np.concatenate([errors[i] for i in rest]), time)[0]
        limit = width[_bin(edges, t)]
        inside.append((np.abs(e) <= limit)[np.isfinite(limit)])
    width, level = _widths(edges, whole, np.concatenate(errors), time)
    source = "the other half of the run" if alone else "the other runs"
    return _held(edges, width, level, inside, time, source)


def given_band(times: Parts, errors: Parts, time: float, half_width: float) -> Band:
    """A band from other data, such as the runs held out of a fit, and how it does on these."""
    edges = np.array([0.0, max(float(t[-1]) for t in times)])
    inside = [np.abs(e) <= half_width for e in errors]
    return _held(edges, np.array([half_width]), LEVEL, inside, time, "other data")


def _bin(edges: Float[np.ndarray, "edges"], t: Float[np.ndarray, "_"]) -> Int[np.ndarray, "_"]:
    return np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(edges) - 2)


def _widths(
    edges: Float[np.ndarray, "edges"],
    t: Float[np.ndarray, "samples"],
    e: Float[np.ndarray, "samples"],
    time: float,
) -> tuple[Float[np.ndarray, "bins"], float]:
    """Half width per bin (NaN for a bin without samples), and the level that all can promise."""
    width, level, place = np.full(len(edges) - 1, np.nan), LEVEL, _bin(edges, t)
    for k in range(len(width)):
        here = np.abs(e[place == k])
        if here.size:
            count = max(len(here) / time, 1.0)
            share = min(np.ceil((count + 1.0) * LEVEL) / count, 1.0)
            width[k] = np.quantile(here, share, method="inverted_cdf")
            level = min(level, count / (count + 1.0))
    return width, level


def _held(
    edges: Float[np.ndarray, "edges"],
    width: Float[np.ndarray, "bins"],
    level: float,
    inside: Sequence[np.ndarray],
    time: float,
    source: str,
) -> Band:
    """The band with its coverage: whether each sample of every stretch lies `inside`."""
    from scipy.stats import binomtest  # a third of a second to load, which few commands need

    judged = [each for each in inside if each.size]
    whole = np.concatenate(judged)
    share, independent = float(np.mean(whole)), max(len(whole) / time, 1.0)
    count = round(independent)
    ends = binomtest(round(share * count), count).proportion_ci(method="wilson")
    low, high = float(ends.low), float(ends.high)
    worst = min(float(np.mean(each)) for each in judged)
    holds = high >= level
    return Band(edges, width, independent, level, share, low, high, worst, source, holds)
