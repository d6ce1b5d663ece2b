"""Multisines: a flat spectrum on chosen lines, without peaks in time."""

import math

import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.excitation.band import check_band

__all__ = ["multisine"]

ROUNDS = 100  # of clipping, after which phases hardly move
CLIP = 0.8  # of the peak


def multisine(
    rng: np.random.Generator,
    samples: int,
    dt: float,
    low: float,
    high: float,
    sigma: float,
    lines: int | None = None,
) -> Float[np.ndarray, "samples"]:
    """One period of equal sines from `low` to `high` [Hz] with a low crest factor.

        x_n  =  sigma sqrt(2/M) sum_k cos(2 pi k n/N + phi_k)

    over M lines k/(N dt) of the record of N samples (Pintelon and Schoukens, System
    Identification, section 5.2): rms `sigma` exactly, and no leakage over that record. Phases
    start at random and are improved by clipping the signal and keeping the phases of what
    is left (Van der Ouderaa, Schoukens and Renneboog, IEEE Trans. Instrum. Meas. 37, 1988), which
    ends below the crest of Schroeder's phases (IEEE Trans. Inf. Theory 16, 1970) and, unlike
    them, gives another signal for every seed.

    Args:
        samples: how many; `dt` [s] apart.
        sigma: rms, in any unit.
        lines: how many sines, spread evenly over the band (None: every line of the record).

    Raises:
        InputError: the band does not fit the sampling, or holds fewer lines than asked for.
    """
    check_band(samples, dt, low, high, sigma)
    length = samples * dt
    first = max(1, math.ceil(low * length - 1e-6))  # 0.4 Hz * 1000 s may be rounded upwards
    last = min((samples - 1) // 2, math.floor(high * length + 1e-6))
    possible = last - first + 1
    if possible < 1 or not (lines is None or 1 <= lines <= possible):
        raise InputError(
            f"A multisine of {length:g} s has {max(possible, 0)} lines from {low:g} to {high:g} Hz "
            f"but {lines or 1} wanted; ask for fewer lines, a longer record or a wider band."
        )
    count = possible if lines is None else lines
    k = np.round(np.linspace(first, last, count)).astype(int)
    phases = _low_crest(rng.uniform(0, 2 * np.pi, count), k, samples)
    return sigma * np.sqrt(2 / count) * _sum(phases, k, samples)


def _sum(phases: Float[np.ndarray, "lines"], k: np.ndarray, samples: int) -> np.ndarray:
    """Cosines of amplitude 1 at the lines `k`."""
    spectrum = np.zeros(samples // 2 + 1, complex)
    spectrum[k] = samples / 2 * np.exp(1j * phases)
    return np.fft.irfft(spectrum, samples)


def _low_crest(phases: Float[np.ndarray, "lines"], k: np.ndarray, samples: int) -> np.ndarray:
    """The best phases on the way: the rms is the same for all, so the lowest peak wins."""
    best, lowest = phases, math.inf
    for _ in range(ROUNDS):
        x = _sum(phases, k, samples)
        peak = float(np.abs(x).max())
        if peak < lowest:
            best, lowest = phases, peak
        clipped = np.clip(x, -CLIP * peak, CLIP * peak)
        phases = np.angle(np.fft.rfft(clipped)[k])
    return best
