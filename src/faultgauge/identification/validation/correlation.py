"""What is left in a residual: its correlation with itself and with the inputs.

Tests of Ljung, System Identification (2nd ed., 1999), section 16.6, over several stretches; no
pair of samples spans a gap. Signals come as one array per stretch, and their common mean is
removed. NaN stands for "not sampled": it is in no pair and counts for no sample, so that var(mean)
= var(e) tau / N holds for the samples that are there (Parzen, Sankhya A 25, 1963: sums over the
pairs at hand).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy.fft import irfft, rfft
from scipy.fft import next_fast_len
from scipy.special import ndtri

__all__ = [
    "InputTest",
    "ResidualTest",
    "correlation",
    "input_test",
    "integrated_time",
    "residual_test",
    "spread_of_cross_correlation",
]

LEVEL = 0.95  # of one lag
LEVEL_OF_ALL = 0.99  # a report makes many tests
FEWEST_LAGS, MOST_LAGS = 25, 200  # 25: usual for a residual without memory
BARTLETT_SHARE = 0.2  # of the longest stretch, of lags in Bartlett's sum (Pyper, Peterman 1998)
ROUNDING = 1e-12  # of a signal's size: a smaller spread is none

Signal = Sequence[Float[np.ndarray, "_"]]


@dataclass(frozen=True)
class ResidualTest:
    """Autocorrelation of a residual at positive lags.

    Attributes:
        lags_s: lags, s.
        correlation: rho_e at each; less by the share q of pairs that empty cells leave of it.
        bound: 95 % of the lags of a white residual stay below it, 1.96 sqrt(q / N).
        limit: all lags of a white residual stay below it with 99 % (Bonferroni).
        share_outside: of the lags, beyond `bound`; 5 % by chance.
        white: whether all lags stay below `limit`.
    """

    lags_s: Float[np.ndarray, "lags"]
    correlation: Float[np.ndarray, "lags"]
    bound: float
    limit: float
    share_outside: float
    white: bool


@dataclass(frozen=True)
class InputTest:
    """Correlation of a residual with an input, r(k) between e(t + k) and u(t).

    At lags from 0 on the residual follows the input: dynamics that the model lacks. At negative
    lags the input follows the residual: feedback while the log was taken, no fault of the model.
    An input with memory smears either to both sides; the larger side is the cause.

    Attributes:
        name: the input.
        lags_s: lags k, s, negative ones first.
        correlation: r at each.
        bound: 95 % of the lags of independent signals stay below it (Bartlett).
        limit: all lags of one side stay below it with 99 % (Bonferroni over those that differ).
        share_outside: of the lags from 0 on, beyond `bound`.
        share_outside_feedback: of the negative lags, beyond `bound`.
        peak: the largest correlation at lags from 0 on, either sign.
        peak_lag_s: its lag, s.
        dependent: whether `peak` is beyond `limit`: the residual holds what the input caused.
        feedback: whether a negative lag is beyond `limit` and beyond `peak`.
    """

    name: str
    lags_s: Float[np.ndarray, "lags"]
    correlation: Float[np.ndarray, "lags"]
    bound: float
    limit: float
    share_outside: float
    share_outside_feedback: float
    peak: float
    peak_lag_s: float
    dependent: bool
    feedback: bool


def correlation(a: Signal, b: Signal) -> Float[np.ndarray, "lags"] | None:
    """r(k) = sum_t a(t + k) b(t) / (N s_a s_b), k = 1 - n ... n - 1, n the longest stretch.

    Sums are over the pairs that were sampled; N counts those of the signal with fewer samples.
    None where a signal does not change.
    """
    count = min(_sampled(a), _sampled(b))
    centred, size = [], 1.0
    for signal in (a, b):
        whole = np.concatenate(signal)
        whole = whole[np.isfinite(whole)]
        spread = float(np.std(whole)) if whole.size else 0.0
        if spread <= ROUNDING * float(np.max(np.abs(whole), initial=0.0)):
            return None
        mean = np.mean(whole)
        centred.append([np.where(np.isfinite(each), each - mean, 0.0) for each in signal])
        size *= spread
    longest = max(len(each) for each in a)
    total = np.zeros(2 * longest - 1)
    for left, right in zip(*centred, strict=True):
        n = len(left)
        length = next_fast_len(2 * n - 1, real=True)
        lagged = irfft(rfft(left, length) * rfft(right, length).conj(), length)
        total[longest - n : longest + n - 1] += np.roll(lagged, n - 1)[: 2 * n - 1]
    return total / (count * size)


def integrated_time(rho: Float[np.ndarray, "lags"]) -> float:
    """Samples per independent one: tau = 1 + 2 sum_k rho(k), of rho from lag 0 on; at least 1.

    The sum ends before the first pair rho(2k) + rho(2k + 1) that is not positive (initial positive
    sequence, Geyer, Statistical Science 7, 1992): it finds a weak slow part under strong noise, and
    does not let a swinging residual cancel itself.
    """
    pairs = rho[: len(rho) // 2 * 2].reshape(-1, 2).sum(axis=1)
    ends = np.flatnonzero(pairs <= 0.0)
    return max(2.0 * float(np.sum(pairs[: ends[0] if ends.size else None])) - 1.0, 1.0)


def spread_of_cross_correlation(
    rho_e: Float[np.ndarray, "lags"], rho_u: Float[np.ndarray, "lags"], count: int
) -> float:
    """Standard deviation of r(k) of independent signals with these autocorrelations (lag 0 on):

        var r = 1/N sum_j rho_e(j) rho_u(j),  j = -L ... L

    (Bartlett 1935). Never below that of white signals, 1 / sqrt(N).
    """
    last = int(BARTLETT_SHARE * len(rho_e))
    total = 1.0 + 2.0 * float(np.sum(rho_e[1 : last + 1] * rho_u[1 : last + 1]))
    return float(np.sqrt(max(total, 1.0) / count))


def residual_test(e: Signal, step: float) -> tuple[ResidualTest | None, float]:
    """The whiteness test and the residual's integrated autocorrelation time, in samples.

    None where the residual does not change or is too short to have a lag.
    """
    rho = _positive(correlation(e, e))
    if rho is None:
        return None, 1.0
    time = integrated_time(rho)
    chosen = _lags(len(rho), time)
    if not chosen.size:
        return None, time
    found, count = rho[chosen], _sampled(e)
    bound, limit = _limits(1.0 / np.sqrt(count / _paired(e, chosen)), len(chosen))
    share = float(np.mean(np.abs(found) > bound))
    white = bool(np.max(np.abs(found)) <= limit)
    return ResidualTest(chosen * step, found, bound, limit, share, white), time


def input_test(name: str, e: Signal, u: Signal, step: float, time: float) -> InputTest | None:
    """The test of residual `e` against input `u`; `time` is the residual's integrated time.

    None where one of them does not change or all stretches are too short.
    """
    both, rho_e, rho_u = correlation(e, u), correlation(e, e), correlation(u, u)
    if both is None or rho_e is None or rho_u is None:
        return None
    middle = len(both) // 2
    chosen = np.concatenate([[0], _lags(middle + 1, time)])
    if len(chosen) < 2:
        return None
    count = _sampled(e)
    spread = spread_of_cross_correlation(rho_e[middle:], rho_u[middle:], count)
    # neighbouring lags of a coloured residual move together: two of them count per integrated time
    bound, limit = _limits(spread, min(len(chosen), 1 + int(np.ceil(2.0 * chosen[-1] / time))))
    after, before = both[middle + chosen], both[middle - chosen[:0:-1]]
    peak = int(np.argmax(np.abs(after)))
    return InputTest(
        name,
        np.concatenate([-chosen[:0:-1], chosen]) * step,
        np.concatenate([before, after]),
        bound,
        limit,
        share_outside=float(np.mean(np.abs(after) > bound)),
        share_outside_feedback=float(np.mean(np.abs(before) > bound)),
        peak=float(after[peak]),
        peak_lag_s=float(chosen[peak] * step),
        dependent=bool(abs(after[peak]) > limit),
        feedback=bool(np.max(np.abs(before)) > max(limit, abs(after[peak]))),
    )


def _sampled(signal: Signal) -> int:
    return sum(int(np.sum(np.isfinite(each))) for each in signal)


def _paired(signal: Signal, lags: Int[np.ndarray, "lags"]) -> float:
    """Of the samples that are there, the share that has a partner `lags` later; 1 without gaps."""
    there = [np.isfinite(each).astype(float) for each in signal]
    if all(each.all() for each in there):
        return 1.0
    pairs = sum(float(each[k:] @ each[: max(len(each) - k, 0)]) for each in there for k in lags)
    places = sum(max(len(each) - k, 0) for each in there for k in lags)
    return max(pairs, 1.0) / places * sum(map(len, there)) / _sampled(signal)


def _positive(r: Float[np.ndarray, "lags"] | None) -> Float[np.ndarray, "half"] | None:
    return None if r is None else r[len(r) // 2 :]


def _lags(longest: int, time: float) -> Int[np.ndarray, "lags"]:
    """Lags to look at, in samples: three integrated times, a quarter of a stretch at most."""
    last = min(longest // 4, max(FEWEST_LAGS, int(np.ceil(3.0 * time))))
    if last < 1:
        return np.zeros(0, int)
    return np.unique(np.linspace(1, last, min(last, MOST_LAGS)).round().astype(int))


def _limits(spread: float, lags: int) -> tuple[float, float]:
    """What one lag stays below with 95 %, and what all of them stay below with 99 %."""
    one, every = -ndtri((1.0 - LEVEL) / 2.0), -ndtri((1.0 - LEVEL_OF_ALL) / 2.0 / lags)
    return float(one * spread), float(every * spread)
