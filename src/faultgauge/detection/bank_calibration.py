"""`calibrate` for the bank: its alarm level, and the model's own error in each estimate.

**Model error.** In a healthy run every fault is 0. The filter of each set of faults runs by itself,
as if they were there: its estimates e with claimed variance v then tell by what variance q the
model errs,

    maximise  sum_k ln N(e_k; 0, v_k + q)   over   q >= 0

(the random effects of DerSimonian and Laird (1986), by likelihood). n correlation times of e tell q
only so well: its root is widened by Student's t_0.975(n) over 1.96.

**Alarm level.** The score of a healthy sample is the log-odds of a fault beyond the model's error,
as low as it was within `persistence`. Healthy runs are cut into blocks of at least 100 samples and
ten correlation times of the residual; the level stands three standard deviations of the blocks'
peaks above the highest one (or above as many as the requested rate allows), and never below odds of
19. No alarm in T seconds proves only a rate below 3/T at 95 % confidence.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq
from scipy.stats import t as student

from faultgauge.detection.bank import CERTAIN, FaultBank, build_fault_bank, set_names
from faultgauge.detection.blocks import (
    CONFIDENCE,
    FEWEST_BLOCKS,
    MARGIN,
    SUSPECT,
    Block,
    allowed_peaks,
    correlation_time,
    merged,
    supported,
)
from faultgauge.detection.course import run_over
from faultgauge.detection.levels import MEMORY
from faultgauge.detection.noise import Noise
from faultgauge.detection.posterior import WIDE, calm_of
from faultgauge.detection.verdicts import log_odds
from faultgauge.errors import InputError
from faultgauge.observers.modes import with_unknown
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run, cut

__all__ = ["BankCalibration", "calibrate_bank", "model_error", "without_calibration"]

SAMPLES = 100_000  # that tell the level, but for as many as --mtbfa needs
FOR_ERROR = 20_000  # that tell the model error
NATURAL = 1.0  # of log-odds: blocks that differ by less are alike
CEILING = 20.0  # log-odds that a probability kept above 1e-12 must still be able to reach


class BankCalibration(NamedTuple):
    """The `bank` part of a calibration block, and what is to be said of it."""

    block: dict[str, Any]
    warnings: list[str]


def calibrate_bank(
    model: Model,
    runs: Sequence[Run],
    noise: Noise,
    mtbfa: float | None = None,
    block: float = 0.0,
    faulty: Sequence[Block] = (),
) -> BankCalibration:
    """Alarm level and model error on healthy `runs`, in blocks of `block` [s] or more, `faulty`
    ones left out.

    `mtbfa` [s] is the requested mean time between false alarms; by default the longest that the
    data support. Raises `InputError` where they are too short, or where the bank finds faults all
    over them.
    """
    bank = build_fault_bank(without_calibration(model), runs, noise)
    most = SAMPLES if mtbfa is None else int(1.1 * 3 * mtbfa / bank.step) + SAMPLES // 100
    taken = _first_samples(runs, most)
    error = _errors(bank, _first_samples(taken, FOR_ERROR), faulty)
    for row, each in zip(bank.error, error, strict=True):
        row[: len(each)] = each
    blocks = [each for each in _blocks(bank, taken, block) if not _overlaps(each, faulty)]
    blocks, suspects = _without_suspects(blocks, runs)
    found, warnings = _rated(blocks, mtbfa, runs[0].source)
    warnings += [
        f"run {b.run}, {b.start:.6g} s to {b.end:.6g} s: holds a fault to the bank, which leaves "
        "it out"
        for b in suspects
    ]
    found["samples"] = sum(len(run.t) for run in taken)
    found["suspects"] = [[b.run, b.start, b.end] for b in suspects]
    names = zip(set_names(model, bank.sets), error, strict=True)
    found["error"] = {name: each.tolist() for name, each in names if len(each)}
    return BankCalibration(found, warnings)


def _rated(
    blocks: Sequence[Block], mtbfa: float | None, source: str
) -> tuple[dict[str, Any], list[str]]:
    """(alarm level and the rate that healthy `blocks` prove of it, what is to be said)."""
    warnings = []
    judged = sum(each.end - each.start for each in blocks)
    longest = supported(judged, 0)
    if mtbfa is not None and mtbfa > longest:
        warnings.append(
            f"the bank: {judged:.4g} s of blocks of its own support a mean time between "
            f"false alarms of {longest:.4g} s only, to which its alarm level is set"
        )
        mtbfa = longest
    peaks = np.sort([b.peak for b in blocks])[::-1]
    allowed, mtbfa = allowed_peaks(judged, mtbfa, len(peaks))
    level = float(max(peaks[allowed] + MARGIN * np.std(peaks, ddof=1), CERTAIN))
    if level > CEILING:
        raise InputError(
            f"{source}: healthy logs reach log-odds of {peaks[allowed]:.3g} for a fault, "
            "so no alarm of the bank would mean anything; look at `faultgauge evaluate`, or leave "
            "faulty logs out."
        )
    found = {
        "level": level,
        "mtbfa_s": mtbfa,
        "confidence": CONFIDENCE,
        "alarms": int(np.sum(peaks >= level)),
        "judged_s": judged,
        "blocks": len(blocks),
        "block_s": float(np.median([b.end - b.start for b in blocks])),
    }
    return found, warnings


def without_calibration(model: Model) -> Model:
    """`model` without what an earlier calibration says."""
    record = {key: value for key, value in model.record.items() if key != "calibration"}
    return replace(model, record=record)


def _first_samples(runs: Sequence[Run], most: int) -> list[Run]:
    """The first of `runs`, `most` samples in all."""
    found = []
    for run in runs:
        count = min(len(run.t), most - sum(len(each.t) for each in found))
        if count >= 2:
            found.append(cut(run, slice(0, count)))
    return found


def _blocks(bank: FaultBank, runs: Sequence[Run], least: float) -> list[Block]:
    """Every run's score in blocks of `least` [s] or more."""
    stretches = [each for run in runs for each in _scores(bank, run)]
    length = max(int(np.ceil(least / bank.step)), MEMORY)
    blocks = []
    for name, t, score in stretches:
        for k in range(len(score) // length):
            piece = slice(k * length, (k + 1) * length)
            end = float(t[piece.stop - 1]) + bank.step
            blocks.append(Block(name, float(t[piece.start]), end, float(score[piece].max())))
    if len(blocks) < FEWEST_BLOCKS:
        have = sum(len(t) for _, t, _ in stretches) * bank.step
        raise InputError(
            f"{runs[0].source}: the bank's alarm level needs at least {FEWEST_BLOCKS} blocks, "
            f"({FEWEST_BLOCKS * length * bank.step:.3g} s of healthy data), "
            f"but there are {have:.3g} s after the hold-off; give more healthy runs."
        )
    return blocks


def _overlaps(block: Block, others: Sequence[Block]) -> bool:
    return any(
        each.run == block.run and each.start < block.end and block.start < each.end
        for each in others
    )


def _scores(
    bank: FaultBank, run: Run
) -> list[tuple[str, Float[np.ndarray, "samples"], Float[np.ndarray, "samples"]]]:
    """(run, t, score) of every stretch of `run` behind its hold-off."""
    score = np.full(len(run.t), np.nan)
    for rows in run_over(bank, run):
        odds = np.maximum(log_odds(calm_of(bank, rows)), -CEILING)
        score[rows.part] = np.where(rows.held, np.nan, np.where(rows.outside > 0, -CEILING, odds))
    count = 1 + int(np.ceil(bank.model.plant.signals.detection.persistence / bank.step))
    edges = np.flatnonzero(np.diff(np.isfinite(score), prepend=False, append=False))
    found = []
    for a, b in edges.reshape(-1, 2):
        if b - a >= count:
            lasting = np.lib.stride_tricks.sliding_window_view(score[a:b], count).min(axis=1)
            found.append((run.name, run.t[a + count - 1 : b], lasting))
    return found


def _without_suspects(blocks: list[Block], runs: Sequence[Run]) -> tuple[list[Block], list[Block]]:
    """Blocks in which the bank is sure of a fault, where most others are far from one."""
    peaks = np.array([b.peak for b in blocks])
    middle = float(np.median(peaks))
    spread = max(1.4826 * float(np.median(np.abs(peaks - middle))), NATURAL)
    limit = max(middle + SUSPECT * spread, CERTAIN)
    keep = [b for b in blocks if b.peak <= limit]
    if len(keep) < FEWEST_BLOCKS:
        raise InputError(
            f"{runs[0].source}: the bank finds faults in {len(blocks) - len(keep)} of "
            f"{len(blocks)} blocks and no {FEWEST_BLOCKS} healthy ones remain; give healthy logs."
        )
    return keep, merged([b for b in blocks if b.peak > limit])


def _errors(
    bank: FaultBank, runs: Sequence[Run], faulty: Sequence[Block]
) -> list[Float[np.ndarray, "slots"]]:
    """The model's own error in every fault of every set, and in what drives the states undeclared,
    as a standard deviation."""
    links = bank.modes.links
    alone = links._replace(rate=jnp.zeros_like(links.rate), leaving=jnp.zeros_like(links.leaving))
    forced = replace(bank, modes=eqx.tree_at(lambda each: each.links, bank.modes, alone))
    e, v = [], []
    for run in runs:
        healthy = np.arange(len(run.t)) >= MEMORY
        for block in faulty:
            if block.run == run.name:
                healthy &= (run.t < block.start) | (run.t >= block.end)
        for rows in run_over(forced, run):
            kept = healthy[rows.part] & (rows.outside == 0)
            e.append(rows.f[kept])
            v.append(rows.sd[kept] ** 2)
    estimates, variances = np.concatenate(e), np.concatenate(v)
    return [
        np.array(
            [model_error(estimates[:, m, slot], variances[:, m, slot]) for slot in range(len(each))]
        )
        for m, each in enumerate(with_unknown(bank.sets, bank.levels)[: len(bank.error)])
    ]


def model_error(e: Float[np.ndarray, "samples"], v: Float[np.ndarray, "samples"]) -> float:
    """sqrt(q) for estimates `e` of 0 with claimed variances `v`, widened for what `e` leaves open
    of q; 0 where the claim accounts for them."""
    if len(e) < 2:
        return 0.0

    def slope(q: float) -> float:
        return float(np.sum(e**2 / (v + q) ** 2 - 1 / (v + q)))

    if slope(0.0) <= 0:
        return 0.0
    q: Any = brentq(slope, 0.0, float(np.max(e**2)), xtol=1e-300)
    count = max(len(e) / max(correlation_time(e / np.sqrt(v), 1.0), 1.0), 1.0)
    return float(np.sqrt(q) * student.ppf(0.975, count) / WIDE)
