"""What every signal in a frequency band asks of its band and its record."""

import math

from faultgauge.errors import InputError

__all__ = ["MOST_SAMPLES", "check_band"]

MOST_SAMPLES = 10_000_000  # of a signal: 80 MB


def check_band(samples: int, dt: float, low: float, high: float, sigma: float) -> None:
    """Raise `InputError` unless 0 <= low < high <= 1/(2 dt) [Hz] and the rest makes sense."""
    if not (0 < dt < math.inf):
        raise InputError(f"The sampling time is {dt:g} s; it must be a positive number of seconds.")
    if not (1 <= samples <= MOST_SAMPLES):
        raise InputError(
            f"The signal would have {samples} samples, but 1 to {MOST_SAMPLES} are possible; change"
            " its length or its sampling time."
        )
    nyquist = 0.5 / dt
    if not (0 <= low < high <= nyquist * (1 + 1e-9)):  # 0.5/dt is rounded
        raise InputError(
            f"The band {low:g} to {high:g} Hz must rise from 0 Hz at the lowest to {nyquist:g} Hz "
            f"at the highest, half the sampling rate at {dt:g} s; change low, high or dt."
        )
    if not (0 < sigma < math.inf):
        raise InputError(f"The standard deviation is {sigma:g}; it must be a positive number.")
