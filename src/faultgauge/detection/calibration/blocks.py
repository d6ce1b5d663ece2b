"""Healthy data cut into blocks, and the false-alarm rate that their peaks support."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import chdtri

from faultgauge.detection.words import number
from faultgauge.errors import InputError

__all__ = [
    "CONFIDENCE",
    "FEWEST_BLOCKS",
    "Block",
    "allowed_peaks",
    "check_mtbfa",
    "correlation_time",
    "merged",
    "supported",
]

FEWEST_BLOCKS = 3  # healthy blocks that prove anything
CONFIDENCE = 0.95  # of what a number of alarms proves


@dataclass(frozen=True)
class Block:
    """A stretch of a healthy run, its highest score, and which cause is likeliest there."""

    run: str
    start: float
    end: float
    peak: float
    cause: str = ""


def merged(blocks: Sequence[Block]) -> list[Block]:
    """Blocks that follow on each other in a run as one."""
    found: list[Block] = []
    for each in sorted(blocks, key=lambda block: (block.run, block.start)):
        last = found[-1] if found else None
        if last and last.run == each.run and each.start <= last.end + 1e-9 * abs(last.end):
            most = max(last, each, key=lambda block: block.peak)
            found[-1] = replace(most, start=last.start, end=each.end)
        else:
            found.append(each)
    return found


def correlation_time(x: Float[np.ndarray, "samples"], step: float) -> float:
    """Integrated autocorrelation time [s] up to the first zero crossing.

    tau = step (1 + 2 sum_k rho_k)
    """
    x = x - x.mean()
    if len(x) < 4 or not np.any(x):
        return step
    spectrum = np.abs(np.fft.rfft(x, 2 * len(x))) ** 2
    rho = np.fft.irfft(spectrum)[: len(x)]
    rho = rho / rho[0]
    below = np.flatnonzero(rho <= 0)
    last = below[0] if len(below) else len(rho)
    return float(step * (1 + 2 * rho[1:last].sum()))


def supported(judged: float, alarms: int) -> float:
    """Mean time between false alarms [s] that `alarms` in `judged` [s] prove at 95 % confidence.

    With k alarms in T the rate is below chi2(0.95, 2k + 2) / (2T).
    """
    return float(2 * judged / chdtri(2 * alarms + 2, 1 - CONFIDENCE))


def check_mtbfa(mtbfa: float) -> None:
    """Raises `InputError` where `mtbfa` [s] is no time."""
    if not 0 < mtbfa < np.inf:
        raise InputError(f"--mtbfa {mtbfa:g}: give a positive time in seconds.")


def allowed_peaks(judged: float, mtbfa: float | None, blocks: int) -> tuple[int, float]:
    """(healthy block peaks that may lie above the limit, mean time between false alarms)."""
    longest = supported(judged, 0)
    if mtbfa is None:
        return 0, longest
    check_mtbfa(mtbfa)
    if mtbfa > longest:
        raise InputError(
            f"--mtbfa {mtbfa:g}: {number(judged, 4)} s of healthy data without an alarm support "
            f"at most {number(longest, 4)} s (95 % confidence); ask for less, or give "
            f"{number(3 * mtbfa, 4)} s of healthy data."
        )
    allowed = 0
    while allowed + 1 < blocks and supported(judged, allowed + 1) >= mtbfa:
        allowed += 1
    return allowed, mtbfa
