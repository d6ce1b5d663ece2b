"""What a plant that is not its model does to the constants of the fit.

A standard error knows chance alone: how far constants scatter from log to log. What the file
lacks (a lag, a loss, noise in what an equation reads) moves them in every log alike. It shows in
two ways.

Slow and fast motion ask for other constants (band spectrum regression: R. F. Engle, International
Economic Review 15, 1974). With the cosine transforms r_k, J_k of residuals and their Jacobian along
the log, H = sum J_k' J_k, the constants of band b alone are off those of all by

    delta_b = -H_b^-1 sum_b g_k,   g_k = J_k' r_k,   var_b = H_b^-1 (sum_b g_k g_k') H_b^-1

B bands of equal information contradict each other where Cochran's Q (Biometrics 10, 1954), the sum
of (delta_b - mean)^2 / var_b about their mean by 1 / var_b, is beyond chance. Then their scatter
about the fit is what the constants are off by:

    off^2 = sum_b w_b delta_b^2,   w_b as the information of the band

What slow and fast motion ask for are delta_b of the slower and of the faster half of all bands,
where these two alone contradict each other, too.

And a signal that comes later than the file has it leaves what shifting its column takes away: with
C the slopes of r to a shift of every column, [J C] fits constants and delays together. That no
column is late is one delay in common, which a plant does not show: the weighted median is 0.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.fft import dct
from scipy.special import chdtri, ndtri

__all__ = ["MOST_ALONG", "BandScatter", "Delays", "InOrder", "agreed", "band_scatter", "delays"]

BANDS = 8  # of frequencies, of equal information each
MOST_ALONG = 50_000  # samples of the logs that are looked at
FEWEST = 24  # frequencies of a band: their sum of squares is known to 30 %
CHANCE = 1e-3  # that bands or delays of a plant that is its model seem to contradict it
DEGENERATE = 1e-6  # of the information: a combination with less is not shown


class InOrder(NamedTuple):
    """Residuals of a stretch in the order of the log, `step` seconds apart, their Jacobian, and
    their slopes to shifts of the columns, 1/s."""

    r: Float[np.ndarray, "samples equations"]
    J: Float[np.ndarray, "samples equations unknowns"]
    C: Float[np.ndarray, "samples equations columns"]
    step: float


class BandScatter(NamedTuple):
    """By how much bands scatter about the unknowns of all motion, 0 where they agree within chance;
    and by how much slow and fast motion alone are off these, 0 where these two agree."""

    off: Float[np.ndarray, "unknowns"]
    slow: Float[np.ndarray, "unknowns"]
    fast: Float[np.ndarray, "unknowns"]


def agreed(count: int) -> BandScatter:
    """Of `count` unknowns on which nothing disagrees."""
    return BandScatter(*np.zeros((3, count)))


class Delays(NamedTuple):
    """By how much each column is late [s], the standard error of that, whether it is beyond
    chance, and how far the unknowns move when columns may be late; 0 where none is."""

    seconds: Float[np.ndarray, "columns"]
    errors: Float[np.ndarray, "columns"]
    sure: np.ndarray
    moved: Float[np.ndarray, "unknowns"]


def band_scatter(parts: Sequence[InOrder]) -> BandScatter:
    """The above, 0 where bands agree within chance."""
    hessian, rest = _normal([(each.r, each.J) for each in parts])
    count = len(rest)
    left = [each.r - each.J @ (_inverse(hessian) @ rest) for each in parts]
    r, J = (
        np.concatenate([_spectrum(each) for each in every])
        for every in (left, [each.J for each in parts])
    )
    pitch = [np.arange(len(each.r)) / (len(each.r) * each.step) for each in parts]
    order = np.argsort(np.concatenate(pitch), kind="stable")
    r, J = r[order], J[order]
    told = np.cumsum(np.einsum("kei,kej,ij->k", J, J, _inverse(hessian)))
    delta, variance, weight = (
        np.array(each) for each in zip(*(_alone(r[b], J[b]) for b in _bands(told)), strict=True)
    )
    mean = np.sum(delta / variance, axis=0) / np.sum(1 / variance, axis=0)
    Q = np.sum((delta - mean) ** 2 / variance, axis=0)
    if len(delta) < 2 or Q.max(initial=0.0) < chdtri(len(delta) - 1, CHANCE / count):
        return agreed(count)
    off = np.sqrt(np.sum(weight * delta**2, axis=0) / weight.sum(axis=0))
    middle = _bands(told)[len(delta) // 2].start
    slow, fast = (_alone(r[half], J[half]) for half in (slice(middle), slice(middle, None)))
    far = (slow[0] - fast[0]) ** 2 > (slow[1] + fast[1]) * chdtri(1, CHANCE / count)
    return BandScatter(off, slow[0] * far, fast[0] * far)


def _alone(
    r: Float[np.ndarray, "frequencies equations"],
    J: Float[np.ndarray, "frequencies equations unknowns"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(delta of a band, its variance, its information), unknown by unknown."""
    inverse = _inverse(_normal([(r, J)])[0])
    g = np.einsum("kei,ke->ki", J, r) @ inverse
    known = np.maximum(np.diag(inverse), 1e-300)
    return -g.sum(axis=0), np.maximum(np.sum(g**2, axis=0), 1e-300), 1 / known


def delays(parts: Sequence[InOrder]) -> Delays:
    """Which columns come late, beyond chance."""
    both = [(each.r, np.concatenate([each.J, each.C], axis=-1)) for each in parts]
    hessian, pull = _normal(both)
    count = parts[0].J.shape[-1]
    inverse = _inverse(hessian)
    found = -inverse @ pull
    scatter = np.zeros_like(hessian)
    for r, J in both:
        left, J = _spectrum(r + J @ found), _spectrum(J)
        g = np.einsum("kei,ke->ki", J, left) @ inverse
        scatter += g.T @ g
    late, scatter = found[count:], scatter[count:, count:]
    shown = np.diag(scatter) > 0
    seconds, errors = np.zeros(len(late)), np.zeros(len(late))
    if shown.sum() < 2:
        return Delays(seconds, errors, seconds > 0, np.zeros(count))
    first = _median(late, np.where(shown, 1 / np.sqrt(np.maximum(np.diag(scatter), 1e-300)), 0.0))
    against = np.eye(len(late))
    against[:, first] -= 1.0
    seconds = np.where(shown, against @ late, 0.0)
    errors = np.where(shown, np.sqrt(np.diag(against @ scatter @ against.T)), 0.0)
    sure = np.abs(seconds) > errors * -ndtri(CHANCE / 2 / len(late))
    own = _inverse(hessian[:count, :count]) @ pull[:count]  # of least squares that knows no delay
    return Delays(seconds, errors, sure, (found[:count] + own) * np.any(sure))


def _spectrum(signals: Float[np.ndarray, "samples ..."]) -> Float[np.ndarray, "samples ..."]:
    """Their orthonormal cosine transforms, the slowest first."""
    return np.asarray(dct(signals, axis=0, norm="ortho"))


def _median(values: Float[np.ndarray, "columns"], weights: Float[np.ndarray, "columns"]) -> int:
    """Which of `values` is their weighted median."""
    order = np.argsort(values)
    passed = np.cumsum(weights[order])
    return int(order[np.searchsorted(passed, passed[-1] / 2)])


def _bands(told: Float[np.ndarray, "frequencies"]) -> list[slice]:
    """`BANDS` of equal information, as far as each has `FEWEST` frequencies."""
    edges = [0]
    for k in range(1, BANDS):
        edge = max(int(np.searchsorted(told, told[-1] * k / BANDS)), edges[-1] + FEWEST)
        if edge + FEWEST <= len(told):
            edges.append(edge)
    return [slice(*each) for each in zip(edges, [*edges[1:], len(told)], strict=True)]


def _normal(parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """(sum J' J, sum J' r)."""
    hessian = sum(np.einsum("sei,sej->ij", J, J) for _, J in parts)
    return np.asarray(hessian), np.asarray(sum(np.einsum("sei,se->i", J, r) for r, J in parts))


def _inverse(hessian: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """The inverse of what is shown, 0 of the rest."""
    size = np.sqrt(np.diag(hessian))
    size = np.where(size > 0, size, np.inf)
    inverse = np.linalg.pinv(hessian / np.outer(size, size), rcond=DEGENERATE, hermitian=True)
    return inverse / np.outer(size, size)
