"""Whether a log is sampled far faster than what it measures moves, and what is then enough."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy.fft import rfft, rfftfreq
from numpy.lib.stride_tricks import sliding_window_view

from faultgauge.telemetry.resampling import on_grid
from faultgauge.telemetry.runs import Run, segments

__all__ = ["block_means", "oversampled"]

FASTER = 100.0  # times the highest frequency of the motion: a rate worth a remark
KEPT = 20.0  # times that frequency: a rate that loses nothing, 0.3 of it being passed
LEAST_GAIN = 4.0  # of the rate, for a remark
MOTION = 0.99  # of the variance of the steps, less noise
NOISE = 4.0  # times the floor: a mean over seven periodograms or more is that far off in none
LEAST = 1000  # samples that a spectrum needs
PARTS = 8  # of a stretch, each with a periodogram
SHORTEST = 512  # samples of a periodogram, which must resolve a hundredth of the rate


def oversampled(runs: Sequence[Run], names: Iterable[str]) -> list[str]:
    """A sentence with the rate to use instead where the fastest of columns `names` of `runs` moves
    a hundred times more slowly than it is sampled.

    How fast a column moves is the frequency below which 99 % of the variance of its steps lie, in
    its power spectrum less the white floor that sensor noise and resolution make.
    """
    found = [(run, _fastest(run, names)) for run in runs]
    told = [(run, fastest) for run, fastest in found if fastest is not None]
    if not told:
        return []
    run, _ = min(told, key=lambda each: each[0].step)
    fastest = max(fastest for _, fastest in told)
    rate, wanted = 1 / run.step, _rounded(KEPT * fastest)
    if fastest * FASTER > rate or wanted * LEAST_GAIN > rate:
        return []
    return [
        f"run {run.name!r} is sampled at {rate:.4g} Hz, and what it measures moves below "
        f"{fastest:.2g} Hz: most of its samples tell little that is new, so fit it with "
        f"--resample {wanted:g}, which is faster and no less exact"
    ]


def block_means(
    runs: Sequence[Run], names: Sequence[str], most: float
) -> tuple[list[Run], dict[str, float]]:
    """(`runs` as means over at most `most` samples in a row, as few as lose nothing of how fast the
    outputs `names` move; how many samples of each output are in a mean).

    An output stands at the middle of its block, an input is its mean from there to the next.
    """
    fastest = [_fastest(run, names) for run in runs]
    told = [each for each in fastest if each]
    step = min(run.step for run in runs)
    most = min(most, 1 / (step * KEPT * max(told))) if len(told) == len(runs) else 1.0
    if most < 2 or any(run.sampled for run in runs):
        return list(runs), dict.fromkeys(names, 1.0)
    found, counts = [], {name: list[float]() for name in names}
    for run in runs:
        count = int(most * step / run.step)
        blocks = len(run.t) // max(count, 1)
        if count < 2 or blocks < 2:
            found.append(run)
            continue
        columns = dict[str, Float[np.ndarray, "blocks"]]()
        for name, x in run.columns.items():
            first = 0 if name in names else count // 2
            part = x[first : first + (len(x) - first) // count * count].reshape(-1, count)[:blocks]
            part = np.concatenate([part, np.repeat(part[-1:], blocks - len(part), axis=0)])
            there = np.isfinite(part)
            columns[name] = np.where(
                there.any(axis=1) if name in names else there.all(axis=1),
                np.nansum(part, axis=1) / np.maximum(there.sum(axis=1), 1),
                np.nan,
            )
            if name in names:
                counts[name] += there.sum(axis=1)[there.any(axis=1)].tolist()
        t = run.t[: blocks * count].reshape(blocks, count)
        whole = np.diff(t[:, [0, -1]], axis=1)[:, 0] < (count + 0.5) * run.step
        columns = {name: np.where(whole, x, np.nan) for name, x in columns.items()}
        found.append(replace(run, t=t.mean(axis=1), columns=columns, pace=None))
    return found, {name: float(np.mean(each)) if each else 1.0 for name, each in counts.items()}


def _fastest(run: Run, names: Iterable[str]) -> float | None:
    """The highest frequency [Hz] at which one of the columns moves; None if that cannot be told."""
    found = []
    for name in names:
        if name not in run.columns or name in run.sampled:
            continue
        part = max(segments(run, [name]), key=lambda part: part.stop - part.start, default=slice(0))
        if part.stop - (part.start or 0) < LEAST:
            return None
        step, _, on = on_grid(run.t[part], {name: run.columns[name][part]}, set())
        found.append(_moves_below(on[name], 1 / step))
    return max(found, default=None)


def _moves_below(x: Float[np.ndarray, "samples"], rate: float) -> float:
    """The frequency [Hz] of one signal; 0 for one that stands still."""
    length = max(SHORTEST, len(x) // PARTS)
    frequency, power = rfftfreq(length, 1 / rate), _power(x, length)
    floor = float(np.median(power[len(power) // 2 :]))
    motion = np.where(power > NOISE * floor, power - floor, 0.0)
    steps = np.cumsum(np.sin(np.pi * frequency / rate) ** 2 * motion)
    if steps[-1] <= 0:
        return 0.0
    return float(frequency[np.searchsorted(steps, MOTION * steps[-1])])


def _power(x: Float[np.ndarray, "samples"], length: int) -> Float[np.ndarray, "frequencies"]:
    """The mean of periodograms of `length` samples, each less its straight line, under Hann windows
    that overlap by half (P. D. Welch, IEEE Trans. Audio and Electroacoustics 15, 1967)."""
    parts = sliding_window_view(x, length)[:: length - length // 2]
    line = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, length), 2))[0]
    window = np.sin(np.pi * np.arange(length) / length) ** 2
    return np.mean(np.abs(rfft((parts - parts @ line @ line.T) * window)) ** 2, axis=0)


def _rounded(rate: float) -> float:
    """The next number up of 1, 2 and 5 times a power of ten."""
    if rate <= 0:
        return 0.0
    power = 10.0 ** math.floor(math.log10(rate))
    return next(k * power for k in (1, 2, 5, 10) if k * power >= rate * (1 - 1e-9))
