"""A low-pass filter that lets a signal be sampled more slowly.

A windowed sinc (Kaiser), evaluated where the new samples lie: one filter for any ratio of rates,
linear in phase and centred, so that nothing comes late, and of finite length, so that its ends are
known. Half of its amplitude is left at the new Nyquist frequency, as `scipy.signal.resample_poly`
has it: then white noise stays almost white, as whoever weighs residuals supposes; were nothing left
there, noise would look smaller than it is and hang together over samples. A mean over the new
interval alone would let a fifth pass at 1.4 times the new rate.
"""

import numpy as np
from jaxtyping import Float

__all__ = ["low_passed"]

CUTOFF = 0.5  # of the new rate, where half is left; the edges are 0.3 and 0.7
HALF = 5.0  # new steps either side, which 65 dB over these 0.4 of the new rate take (Kaiser)
BETA = 0.1102 * (65.0 - 8.7)  # of the window for 65 dB (Kaiser)
FINE = 4096  # points of the kernel in a new step: a line between two is good to 1e-7
BLOCK = 2_000_000  # weights at a time


def _tables() -> tuple[Float[np.ndarray, "a"], Float[np.ndarray, "b"]]:
    """The kernel from 0 on, and its mean over the new step around each of its points."""
    d = np.arange(-(HALF + 1) * FINE, (HALF + 1) * FINE + 1) / FINE
    taper = np.i0(BETA * np.sqrt(np.maximum(1 - (d / HALF) ** 2, 0.0)))
    kernel = np.where(np.abs(d) <= HALF, np.sinc(2 * CUTOFF * d) * taper, 0.0)
    area = np.append(0.0, np.cumsum((kernel[1:] + kernel[:-1]) / 2 / FINE))
    mean = area[FINE:] - area[:-FINE]  # centred half a step after d[0], d[1], ...
    return kernel[d >= 0], mean[d[:-FINE] + 0.5 >= 0]


AT, OVER = _tables()


def low_passed(
    x: Float[np.ndarray, "samples"],
    position: Float[np.ndarray, "rows"],
    ratio: float,
    *,
    mean: bool = False,
) -> Float[np.ndarray, "rows"]:
    """Even samples `x`, low-passed, at `position` [samples]; `ratio` is new rate / rate, below 1.

    y(p) = sum_j w(p - j) x(j) / sum_j w(p - j),  w(d) = sinc(2 c d) kaiser(d / h),
    c = 0.5 ratio, h = 5 / ratio                                            (J. F. Kaiser, 1974)

    Up to 0.3 of the new rate y is x within 0.1 %; at 0.5, the new Nyquist frequency, half is left,
    and from 0.7 on at most 0.1 %. With `mean`,
    x keeps its value from a sample to the next, and y is the mean of what is low-passed from p to
    the next new sample: the sum over all new samples is that over all old ones, times `ratio`.

    Beyond its ends x goes on mirrored: at the end point, so that a straight line stays straight,
    and with `mean` at the end itself, so that nothing of its sum is lost.
    """
    table = OVER if mean else AT
    reach = int(np.ceil((HALF + 0.5) / ratio))
    margin = reach + int(np.ceil(0.5 / ratio)) + 1
    if mean:
        padded = np.pad(x, margin, mode="symmetric")
        # from the beginning of a sample and of an interval to their middles
        position = position + 0.5 / ratio - 0.5
    else:
        padded = np.pad(x, margin, mode="reflect", reflect_type="odd")
    offsets = np.arange(-reach, reach + 2)
    first = np.floor(position + 1e-6).astype(int)
    found = np.empty(len(position))
    rows = max(1, BLOCK // len(offsets))
    for start in range(0, len(position), rows):
        part = slice(start, start + rows)
        # of whole ratios all rows have one set of weights, but for the rounding of their times
        shares, which = np.unique(np.round((position - first)[part], 6), return_inverse=True)
        distance = np.abs(shares[:, None] - offsets) * ratio * FINE
        weights = np.interp(distance, np.arange(len(table), dtype=float), table, right=0.0)
        weights /= weights.sum(axis=1, keepdims=True)
        cells = padded[first[part, None] + margin + offsets]
        each = weights[which] if len(weights) > 1 else np.broadcast_to(weights, cells.shape)
        found[part] = np.einsum("rk,rk->r", each, cells)
    return found
