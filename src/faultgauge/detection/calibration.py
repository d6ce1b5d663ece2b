"""`calibrate`: what healthy runs say of the bank, or of one observer under one limit.

An observer's score of a sample is the largest |estimate| over all channels, each in units of its
own healthy RMS. Healthy runs are cut into blocks of at least ten correlation times of the
observer's innovation; the limit follows from the blocks' peaks.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank import evaluated_faults
from faultgauge.detection.bank_calibration import calibrate_bank, without_calibration
from faultgauge.detection.blocks import (
    BLOCK_TIMES,
    CONFIDENCE,
    FEWEST_BLOCKS,
    MARGIN,
    SUSPECT,
    Block,
    allowed_peaks,
    correlation_time,
    merged,
)
from faultgauge.detection.equal_faults import equal_faults
from faultgauge.detection.flat_line import longest_repeats
from faultgauge.detection.judged import Bank, Estimates, build_bank, estimate_run
from faultgauge.detection.misfit import not_followed
from faultgauge.detection.noise import Noise
from faultgauge.detection.noise_estimation import estimate_noise
from faultgauge.detection.residual import residuals
from faultgauge.errors import InputError
from faultgauge.identification.command_checks import command_warnings
from faultgauge.identification.log_checks import other_units
from faultgauge.plants.disturbed import dynamic_states
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run

__all__ = ["Calibration", "calibrate", "channels_of", "score"]


@dataclass(frozen=True)
class Calibration:
    """What `calibrate` found: the model with its calibration block, and the blocks behind it."""

    model: Model
    blocks: list[Block]
    suspects: list[Block]
    warnings: list[str]


def channels_of(bank: Bank, estimates: Estimates) -> dict[str, Float[np.ndarray, "samples"]]:
    """The channels that are judged: fault estimates, or the observer's residuals without any."""
    if estimates.f:
        return estimates.f
    found = residuals(bank.model, estimates.run, "observer")
    return {name: _held(estimates.run, name, r) for name, r in found.items()}


def _held(run: Run, name: str, r: Float[np.ndarray, "samples"]) -> Float[np.ndarray, "samples"]:
    """A slow sensor's residual as it stands until its next sample, like an estimate."""
    if name not in run.sampled:
        return r
    last = np.maximum.accumulate(np.where(np.isfinite(r), np.arange(len(r)), 0))
    return np.where(np.isfinite(run.columns[name]), r[last], np.nan)


def score(
    channels: dict[str, Float[np.ndarray, "samples"]], scales: dict[str, float]
) -> Float[np.ndarray, "samples"]:
    """max over channels of |value| / healthy RMS; NaN where no channel has a value."""
    stacked = np.stack([np.abs(channels[name]) / scales[name] for name in scales])
    return np.where(
        np.isnan(stacked).all(axis=0), np.nan, np.nanmax(np.nan_to_num(stacked), axis=0)
    )


def calibrate(
    model: Model,
    runs: Sequence[Run],
    *,
    mtbfa: float | None = None,
    observer: str = "bank",
    discrepancy: bool = True,
    progress: Callable[[str], None] = lambda text: None,
) -> Calibration:
    """What `model` makes of healthy `runs`; weights and evaluation do not change.

    The bank's noise, discrepancy and alarm level; with another `observer`, or where the plant
    declares no fault, the limit of that observer's estimates (or of residuals). `mtbfa` [s] is the
    requested mean time between false alarms; by default the longest that the data support: no alarm
    in T seconds proves only a rate below 3/T (at 95 %). Without `discrepancy` all that the model
    errs is taken for noise. Raises `InputError` where more is asked for than the data support, or
    where they are too short. The rate that runs
    were resampled to becomes that of a model that has none.
    """
    warnings, model = [], without_calibration(model)
    rates = {run.resampled for run in runs if run.resampled is not None}
    if model.resample is None and rates:
        model = model.with_resample(max(rates))
    fitted = set(model.record["data"]["fit"])
    doubled = [run.name for run in runs if run.content_hash in fitted]
    if doubled:
        warnings.append(
            f"{', '.join(doubled)}: also used in fit, where the model looks better than it is; "
            "the limit may be too low. Calibrate on other runs if you can"
        )
    warnings += other_units(runs)
    warnings += command_warnings(model.plant, runs)
    warnings += not_followed(model, runs)
    known = {
        "data": sorted(run.content_hash for run in runs),
        "repeats": longest_repeats(model, runs),
    }
    if observer == "bank" and model.plant.signals.faults:
        return _by_bank(model, runs, mtbfa, discrepancy, known, warnings, progress)
    return _by_observer(model, runs, mtbfa, observer, known, warnings, progress)


def _by_bank(
    model: Model,
    runs: Sequence[Run],
    mtbfa: float | None,
    discrepancy: bool,
    known: dict[str, Any],
    warnings: list[str],
    progress: Callable[[str], None],
) -> Calibration:
    evaluated_faults(model.plant.signals)
    warnings += equal_faults(model, runs)
    progress("finding noise and model error")
    noise = estimate_noise(model, runs, discrepancy)
    warnings += lasting_warnings(model, runs, noise)
    progress("finding the alarm level")
    found = calibrate_bank(model, runs, noise, mtbfa)
    block = known | {"observer": "bank", "noise": found.noise.as_dict(model), "bank": found.block}
    calibrated = model.with_calibration(block)
    return Calibration(calibrated, found.blocks, found.suspects, [*warnings, *found.warnings])


def _by_observer(
    model: Model,
    runs: Sequence[Run],
    mtbfa: float | None,
    observer: str,
    known: dict[str, Any],
    warnings: list[str],
    progress: Callable[[str], None],
) -> Calibration:
    """One limit of an observer's estimates."""
    bank = build_bank(model, runs, "eso" if observer == "bank" else observer)
    progress("running the observers over the healthy logs")
    estimated = [estimate_run(bank, run) for run in runs]
    channels = [channels_of(bank, each) for each in estimated]
    scales = _scales(estimated, channels)
    blocks = _blocks(bank, estimated, channels, scales)
    blocks, suspects = _without_suspects(blocks, runs)
    warnings += [
        f"run {b.run}, {b.start:.6g} s to {b.end:.6g} s: looks faulty and is left out"
        for b in suspects
    ]
    judged = sum(b.end - b.start for b in blocks)
    peaks = np.sort([b.peak for b in blocks])[::-1]
    allowed, supported = allowed_peaks(judged, mtbfa, len(peaks))
    limit = float(peaks[allowed] + MARGIN * np.std(peaks, ddof=1))
    good = [_inside(e, c, blocks) for e, c in zip(estimated, channels, strict=True)]
    block = known | {
        "observer": observer,
        "bandwidth": bank.bandwidth,
        "limit": limit,
        "mtbfa_s": supported,
        "confidence": CONFIDENCE,
        "judged_s": judged,
        "blocks": len(blocks),
        "block_s": float(np.median([b.end - b.start for b in blocks])),
        "suspects": [[b.run, b.start, b.end] for b in suspects],
        "channels": {
            name: {
                "scale": scales[name],
                "limit": limit * scales[name],
                "interval": float(
                    np.quantile(np.abs(np.concatenate([part[name] for part in good])), CONFIDENCE)
                ),
            }
            for name in scales
        },
    }
    return Calibration(model.with_calibration(block), blocks, suspects, warnings)


def lasting_warnings(model: Model, runs: Sequence[Run], noise: Noise) -> list[str]:
    """What the healthy logs are too short, or too few, to tell."""
    found = []
    longest = max(float(run.t[-1] - run.t[0]) for run in runs)
    names = [model.plant.signals.state_names[k] for k in dynamic_states(model.plant)]
    slow = [n for n, tau in zip(names, noise.lasting, strict=True) if tau > longest]
    if slow:
        found.append(
            f"the model's own error in {', '.join(slow)} lasts longer than the longest healthy log "
            f"({longest:.3g} s), so these logs cannot tell how long, nor a fault that began before "
            "a log from that error; give longer healthy logs if you have them"
        )
    if len(runs) == 1 and len(noise.spread):
        found.append(
            "one healthy run cannot tell by how much the plant differs from run to run; give "
            "several"
        )
    return found


def _scales(
    estimated: list[Estimates], channels: list[dict[str, Float[np.ndarray, "samples"]]]
) -> dict[str, float]:
    """Healthy RMS of every channel, by medians, so that a faulty stretch hardly counts."""
    scales = {}
    for name in channels[0]:
        values = np.concatenate(
            [c[name][e.settled] for e, c in zip(estimated, channels, strict=True)]
        )
        values = np.abs(values[np.isfinite(values)])
        if len(values) == 0:
            raise InputError(
                f"{estimated[0].run.source}: too short to judge anything after the observer has "
                "settled; give a longer log, or a higher [observer] bandwidth."
            )
        scales[name] = float(max(1.4826 * np.median(values), 1e-12 * max(values.max(), 1e-300)))
    return scales


def _blocks(
    bank: Bank,
    estimated: list[Estimates],
    channels: list[dict[str, Float[np.ndarray, "samples"]]],
    scales: dict[str, float],
) -> list[Block]:
    stretches = []
    for each, values in zip(estimated, channels, strict=True):
        edges = np.flatnonzero(np.diff(each.settled, prepend=False, append=False))
        stretches += [(each, values, slice(a, b)) for a, b in edges.reshape(-1, 2)]
    tau = _usual_correlation(bank, stretches)
    length = max(int(np.ceil(BLOCK_TIMES * tau / bank.step)), 10)
    blocks = []
    for each, values, part in stretches:
        s = score({name: values[name][part] for name in scales}, scales)
        t = each.run.t[part]
        for k in range(len(s) // length):
            piece = slice(k * length, (k + 1) * length)
            blocks.append(
                Block(
                    each.run.name,
                    float(t[piece.start]),
                    float(t[piece.stop - 1]) + bank.step,
                    float(np.nanmax(s[piece])),
                )
            )
    if len(blocks) < FEWEST_BLOCKS:
        have = sum(p.stop - p.start for *_, p in stretches) * bank.step
        raise InputError(
            f"{estimated[0].run.source}: calibration needs at least {FEWEST_BLOCKS} blocks of ten "
            f"correlation times ({FEWEST_BLOCKS * length * bank.step:.3g} s of healthy data), but "
            f"there are {have:.3g} s after settling; give more healthy runs."
        )
    return blocks


def _usual_correlation(
    bank: Bank,
    stretches: Sequence[tuple[Estimates, dict[str, Float[np.ndarray, "samples"]], slice]],
) -> float:
    """Correlation time [s] of the slowest signal, in the median over stretches by their length: a
    fault in one of them correlates for as long as it lasts."""
    lengths = np.array([part.stop - part.start for *_, part in stretches])
    taus = np.array(
        [
            [_correlation(x[part], bank.step) for x in (each.innovation or values).values()]
            for each, values, part in stretches
        ]
    )
    found = []
    for column in taus.T:
        order = np.argsort(column, kind="stable")
        half = np.searchsorted(np.cumsum(lengths[order]), lengths.sum() / 2)
        found.append(column[order][half])
    return float(max(found))


def _correlation(x: Float[np.ndarray, "samples"], step: float) -> float:
    """Correlation time [s] of what was sampled: a slow sensor has lags of its own step."""
    own = x[np.isfinite(x)]
    return correlation_time(own, step * (len(x) / max(len(own), 1)))


def _without_suspects(blocks: list[Block], runs: Sequence[Run]) -> tuple[list[Block], list[Block]]:
    """Blocks whose peak stands far above the others are taken for faulty."""
    peaks = np.array([b.peak for b in blocks])
    middle = float(np.median(peaks))
    spread = float(max(1.4826 * np.median(np.abs(peaks - middle)), 0.1 * middle))
    keep = [b for b in blocks if b.peak <= middle + SUSPECT * spread]
    suspects = [b for b in blocks if b.peak > middle + SUSPECT * spread]
    if len(keep) < FEWEST_BLOCKS:
        raise InputError(
            f"{runs[0].source}: {len(suspects)} of {len(blocks)} blocks look faulty and no "
            f"{FEWEST_BLOCKS} healthy ones remain; give healthy logs."
        )
    return keep, merged(suspects)


def _inside(
    estimates: Estimates,
    channels: dict[str, Float[np.ndarray, "samples"]],
    blocks: list[Block],
) -> dict[str, Float[np.ndarray, "kept"]]:
    """The channels' values in the blocks that count as healthy."""
    t = estimates.run.t
    keep = np.zeros(len(t), bool)
    for b in blocks:
        if b.run == estimates.run.name:
            keep |= (t >= b.start) & (t < b.end)
    return {name: values[keep & np.isfinite(values)] for name, values in channels.items()}
