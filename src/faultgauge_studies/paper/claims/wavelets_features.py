"""What is read off a residual, in time and over time and frequency, and how it is classified."""

from typing import NamedTuple

import numpy as np
import pywt
from jaxtyping import Float, Int

__all__ = [
    "BANDS",
    "FEATURES",
    "PARTS",
    "SETS",
    "Classes",
    "classify",
    "confusion",
    "energy_map",
    "fourier_map",
    "learn_classes",
    "map_features",
    "time_features",
    "wilson",
]

WAVELET, LEVELS = "db4", 6
BANDS = LEVELS + 1  # halves of the band from the Nyquist frequency down, and what is left
PARTS = 8  # of the record, for how the energy evolves
Z95 = 1.959964  # of the normal distribution, 95 %


def time_features(r: Float[np.ndarray, "runs samples"]) -> Float[np.ndarray, "runs 6"]:
    """|mean|, crest and |slope| per RMS, kurtosis, and the logarithms of RMS and peak [N*m].

    The slope is the line's rise over the record. Sizes are absolute: a fault has either sign.
    """
    mean, size = r.mean(axis=1), np.sqrt(np.mean(r**2, axis=1))
    off = r - mean[:, None]
    t = np.linspace(-0.5, 0.5, r.shape[1])
    slope = off @ t / (t @ t)
    peak = np.abs(r).max(axis=1)
    kurtosis = np.mean(off**4, axis=1) / np.mean(off**2, axis=1) ** 2
    shape = [np.abs(mean) / size, peak / size, kurtosis, np.abs(slope) / size]
    return np.stack([np.log(size), np.log(peak), *shape], axis=1)


def energy_map(r: Float[np.ndarray, "runs samples"]) -> Float[np.ndarray, "runs bands parts"]:
    """Energy of the discrete wavelet transform by level, finest first, and eighth of the record.

    The transform is orthonormal and periodic, so that the energies sum to that of the record.
    """
    found = pywt.wavedec(r, WAVELET, mode="periodization", level=LEVELS, axis=1)
    return np.stack([_parts(level**2) for level in reversed(found)], axis=1)


def _parts(energy: Float[np.ndarray, "runs coefficients"]) -> Float[np.ndarray, "runs parts"]:
    return energy.reshape(len(energy), PARTS, -1).sum(axis=2)


def fourier_map(
    r: Float[np.ndarray, "runs samples"], parts: int
) -> Float[np.ndarray, "runs bands parts"]:
    """The same map by Fourier transforms of each of `parts` stretches, without wavelets."""
    pieces = r.reshape(len(r), parts, -1)
    samples = pieces.shape[2]
    power = np.abs(np.fft.rfft(pieces, axis=2)) ** 2 / samples
    power[..., 1 : (samples + 1) // 2] *= 2  # and as much at the negative frequencies
    share = np.fft.rfftfreq(samples) / 0.5  # of the Nyquist frequency
    edges = 0.5 ** np.arange(BANDS)
    band = np.sum(share[:, None] <= edges[1:], axis=1)  # 0: the upper half
    return np.stack([power[..., band == k].sum(axis=2) for k in range(BANDS)], axis=1)


def map_features(
    energy: Float[np.ndarray, "runs bands parts"],
) -> Float[np.ndarray, "runs features"]:
    """Logarithm of each band's share of the energy; of several parts also when and how evenly the
    energy came: centre of its shares in time, and logarithm of the sum of their squares."""
    total = energy.sum(axis=(1, 2))
    bands = np.log(energy.sum(axis=2) / total[:, None])
    if energy.shape[2] == 1:
        return bands
    share = energy.sum(axis=1) / total[:, None]
    centre = share @ np.linspace(-0.5, 0.5, energy.shape[2])
    return np.column_stack([bands, centre, np.log(np.sum(share**2, axis=1))])


FEATURES = {
    "time": time_features,
    "spectrum": lambda r: map_features(fourier_map(r, 1)),
    "windowed": lambda r: map_features(fourier_map(r, PARTS)),
    "wavelet": lambda r: map_features(energy_map(r)),
}

SETS = {
    "time": "time domain",
    "spectrum": "Fourier, whole record",
    "windowed": "Fourier in windows",
    "wavelet": "wavelets",
}


class Classes(NamedTuple):
    """Mean of each class, and the inverse of the covariance common to all."""

    means: Float[np.ndarray, "classes features"]
    precision: Float[np.ndarray, "features features"]


def learn_classes(x: Float[np.ndarray, "runs features"], k: Int[np.ndarray, "runs"]) -> Classes:
    """Linear discriminant analysis; features that repeat others are left out (pseudo-inverse)."""
    means = np.stack([x[k == each].mean(axis=0) for each in range(int(k.max()) + 1)])
    off = x - means[k]
    return Classes(means, np.linalg.pinv(off.T @ off / (len(x) - len(means)), hermitian=True))


def classify(classes: Classes, x: Float[np.ndarray, "runs features"]) -> Int[np.ndarray, "runs"]:
    """The class whose mean is nearest by Mahalanobis' distance."""
    off = x[:, None, :] - classes.means
    return np.einsum("rcf,fg,rcg->rc", off, classes.precision, off).argmin(axis=1)


def confusion(
    true: Int[np.ndarray, "runs"], found: Int[np.ndarray, "runs"], classes: int
) -> Int[np.ndarray, "classes classes"]:
    """How many of each true class (rows) were found as which (columns)."""
    counts = np.zeros((classes, classes), int)
    np.add.at(counts, (true, found), 1)
    return counts


def wilson(right: int, runs: int) -> tuple[float, float]:
    """95 % interval of a share by Wilson's score, for `right` of `runs`."""
    share, z2 = right / runs, Z95**2
    centre = (share + z2 / (2 * runs)) / (1 + z2 / runs)
    half = Z95 * np.sqrt(share * (1 - share) / runs + z2 / (4 * runs**2)) / (1 + z2 / runs)
    return float(centre - half), float(centre + half)
