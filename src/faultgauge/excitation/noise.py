"""Band-limited Gaussian noise: the exciting input of the paper, section 3.3."""

import math

import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.excitation.band import MOST_SAMPLES, check_band

__all__ = ["band_limited_noise"]

FEWEST_LINES = 16  # in the band: its edges are sharp to a sixteenth of its width


def band_limited_noise(
    rng: np.random.Generator, samples: int, dt: float, low: float, high: float, sigma: float
) -> Float[np.ndarray, "samples"]:
    """Stationary Gaussian noise, flat from `low` to `high` [Hz] and nothing outside.

        x_n  =  2/N Re sum_k X_k exp(2 pi i k n/N),    Re X_k, Im X_k ~ N(0, sigma^2 N^2/(4 M))

    over the M lines k/(N dt) inside the band. Every sample has variance sigma^2 exactly, in
    expectation. N is at least twice `samples`, so that the record is no whole period of it.

    Args:
        samples: how many; `dt` [s] apart.
        sigma: standard deviation, in any unit.

    Raises:
        InputError: the band does not fit the sampling, or is too narrow to be computed.
    """
    check_band(samples, dt, low, high, sigma)
    resolved = math.ceil(FEWEST_LINES / ((high - low) * dt))
    if resolved > 2 * MOST_SAMPLES:
        raise InputError(
            f"The band {low:g} to {high:g} Hz is too narrow for noise sampled every {dt:g} s; make "
            f"it at least {FEWEST_LINES / (2 * MOST_SAMPLES * dt):.3g} Hz wide."
        )
    length = 1 << (max(2 * samples, resolved) - 1).bit_length()  # a power of 2
    frequencies = np.fft.rfftfreq(length, dt)
    band = (frequencies >= low) & (frequencies <= high)
    band[0] = band[-1] = False  # real lines, whose variance would be another than the rest's
    lines = int(band.sum())
    spectrum = np.zeros(len(frequencies), complex)
    real, imaginary = rng.standard_normal((2, lines))
    spectrum[band] = sigma * length / (2 * np.sqrt(lines)) * (real + 1j * imaginary)
    return np.fft.irfft(spectrum, length)[:samples]
