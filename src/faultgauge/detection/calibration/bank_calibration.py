"""`calibrate` for the bank: how far its evidence can be believed, and its alarm level.

Were the model right in all, odds of L for a fault would be reached by chance once in L times
(J. Ville's inequality: a likelihood ratio is a martingale), so healthy logs, in which E faults are
expected before any data, would show odds of E / 0.05 once in 20 times. Where they show more, or
even odds, what the model errs is none of the kinds that noise and discrepancy can be, and all
evidence is too strong. It is then believed by so much less that they do not (`trust`): its
logarithm is divided by s^2 where noise and discrepancy are s times as large, which changes no gain
(P. Grunwald, "Safe learning", COLT 2011), or what looks like some faults is taken for mimicked.

The score of a healthy sample is the log-odds of a declared fault, or of any as low as they were for
as long as something undeclared has to outlast the model's own error; as low as it was within
`persistence`.
Healthy runs are cut into blocks of several memories of the bank, and the level follows from the
blocks' peaks. Were the model right in all, odds of L would be reached by chance once in L times
(J. Ville's inequality), so the peaks have an exponential tail. The mean excess beta of the upper
half of them over their median tells the tail as it is, whatever the many peaks are that lie far
below nothing; the highest of as many further blocks lies within 3 beta of the highest seen with
95 % probability, and there the level stands, never below odds of 19. With `--mtbfa` as many peaks
may lie above it as the rate allows. No alarm in T seconds proves only a rate below 3/T at 95 %
confidence.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import count
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank.bank import CERTAIN, FaultBank, build_fault_bank
from faultgauge.detection.bank.fidelity import gain_error, largest_changes, shape_error
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.bank.priors import AT_START, RARE
from faultgauge.detection.calibration.blocks import (
    CONFIDENCE,
    FEWEST_BLOCKS,
    Block,
    allowed_peaks,
    merged,
)
from faultgauge.detection.calibration.trust import LOWEST, SHORTEST, Scored, Trust, in_full, trusted
from faultgauge.detection.posterior.consistency import limit_of
from faultgauge.detection.posterior.mimicked import Mimicked, least_real
from faultgauge.detection.posterior.verdicts import log_odds
from faultgauge.detection.rows.prepared import prepared
from faultgauge.detection.watch import Watch
from faultgauge.detection.words import TOLD_ODDS, UNDECLARED, duration, listed, moment, number
from faultgauge.errors import InputError
from faultgauge.identification.optimise.cores import side_by_side
from faultgauge.plants.model import Model
from faultgauge.plants.record import BankLevel, CalibrationRecord, NoiseLevels
from faultgauge.plants.signals import spoken
from faultgauge.telemetry import Run, cut
from faultgauge.telemetry.clock import Clock

__all__ = ["BankCalibration", "calibrate_bank", "calibrated", "level_of", "without_calibration"]

SAMPLES = 100_000  # that tell the level, but for as many as --mtbfa needs
MEMORIES = 4.0  # of the bank in a block
BY_CHANCE = 0.05  # how often healthy logs may show more
TRIES = 6  # of how far the evidence can be believed, usually at most
NEVER = (
    "the healthy logs look faulty however large noise is taken, most of all {where}; leave out "
    "what was not healthy there with --where, or add to the plant file what the plant does there."
)
MOST_NAMED = 3  # stretches that look faulty
MUCH = 0.25  # of the healthy logs: nobody gave so much that was not healthy
MARGIN = 3.0  # mean excesses: -ln(0.05)


class BankCalibration(NamedTuple):
    """The bank's alarm level, the noise as large as the evidence can be believed, what is to be
    said of both, and how much is `lost` by it (`trust`)."""

    level: BankLevel
    noise: Noise
    blocks: list[Block]
    suspects: list[Block]
    warnings: list[str]
    lost: float


def calibrate_bank(
    model: Model,
    runs: Sequence[Run],
    noise: Noise,
    mtbfa: float | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> BankCalibration:
    """Alarm level on healthy `runs`.

    `mtbfa` [s] is the requested mean time between false alarms; by default the longest that the
    data support; `progress` is told the share that is done, were all tries needed. Runs in which
    the bank is sure of a fault are named, and kept: they are said to be healthy. Raises
    `InputError` where they are too short.
    """
    healthy = float(sum(run.t[-1] - run.t[0] for run in runs))
    step = float(np.median([run.step for run in runs]))
    most = SAMPLES if mtbfa is None else int(1.1 * 3 * mtbfa / step) + SAMPLES // 100
    taken, plain, walks = _first_samples(runs, most), without_calibration(model), count(1)
    clocks = {run.name: run.clock for run in runs}

    def stepped() -> None:
        progress(min(next(walks) / (2 * len(taken) + TRIES), 1.0))

    def tried(trust: Trust, some: Sequence[int]) -> tuple[FaultBank, list[list[Scored]]]:
        bank = build_fault_bank(plain, runs, noise.widened(trust.widened), healthy)
        bank = replace(bank, mimicked=trust.mimicked)
        return bank, _walked(bank, [taken[k] for k in some], stepped)

    bank, scores = tried(in_full(model.plant.signals), range(len(taken)))
    blocks = _blocks(bank, scores, taken[0].source)
    suspects, asked, never = _looking_faulty(blocks, clocks)
    most = _allowed(bank, healthy, len(runs))
    trust, bank, scores, lost = trusted(bank, scores, most, tried, never)
    blocks = _blocks(bank, scores, taken[0].source)
    judged = sum(each.end - each.start for each in blocks)
    peaks = np.sort([b.peak for b in blocks])[::-1]
    allowed, mtbfa = allowed_peaks(judged, mtbfa, len(peaks))
    level = level_of(peaks, allowed)
    found = BankLevel(
        level=level,
        widened=trust.widened,
        mtbfa_s=mtbfa,
        confidence=CONFIDENCE,
        alarms=int(np.sum(peaks >= level)),
        judged_s=judged,
        healthy_s=healthy,
        memory_s=bank.knowledge.memory,
        blocks=len(blocks),
        block_s=float(np.median([b.end - b.start for b in blocks])),
        samples=sum(len(run.t) for run in taken),
        suspects=[(b.run, b.start, b.end) for b in suspects],
        size=dict(zip(model.plant.signals.fault_names, bank.size.tolist(), strict=True)),
        shape=shape_error(model, runs, noise),
        gain=gain_error(model, runs),
        changes=largest_changes(model, runs),
        nis=_limits(scores),
        mimicked=_by_name(model, trust.mimicked),
    )
    warnings = _believed_less(replace(bank, level=level), trust.widened, asked, judged, clocks)
    return BankCalibration(found, noise.widened(trust.widened), blocks, suspects, warnings, lost)


def _looking_faulty(
    blocks: Sequence[Block], clocks: Mapping[str, Clock | None]
) -> tuple[list[Block], list[Block], str]:
    """(where the bank is sure of a fault; that, or where it is surest; what is said where however
    large noise is no remedy)."""
    suspects = merged([b for b in blocks if b.peak >= CERTAIN])
    asked = suspects or [max(blocks, key=lambda each: each.peak)]
    return suspects, asked, NEVER.format(where=_most_of_all(asked, clocks))


def _allowed(bank: FaultBank, healthy: float, runs: int) -> float:
    """Log-odds that so many healthy runs of so long [s] may show, by the faults that a bank expects
    in as much."""
    expected = bank.onset.sum() * healthy + AT_START * len(bank.onset) * runs
    return min(float(np.log(expected / BY_CHANCE)), 0.0)


def _by_name(model: Model, mimicked: Float[np.ndarray, "faults ages"]) -> dict[str, list[float]]:
    """Of the faults that healthy logs mimic."""
    names = model.plant.signals.fault_names
    return {name: own.tolist() for name, own in zip(names, mimicked, strict=True) if own.any()}


def _limits(scores: Sequence[Sequence[Scored]]) -> list[float]:
    """How badly an explanation may fit, by healthy logs."""
    return limit_of(np.concatenate([each.nis for run in scores for each in run])).tolist()


def _walked(
    bank: FaultBank, runs: Sequence[Run], stepped: Callable[[], None]
) -> list[list[Scored]]:
    """The scores of each of `runs`, several at once; after each it is `stepped`."""

    def walked(run: Run) -> list[Scored]:
        found = _scores(bank, run)
        stepped()
        return found

    first, *others = runs  # the first compiles what all go through
    return [walked(first), *side_by_side(walked, others)]


def _believed_less(
    bank: FaultBank,
    widened: float,
    asked: Sequence[Block],
    judged: float,
    clocks: Mapping[str, Clock | None],
) -> list[str]:
    """What is told only from a larger size on, where the healthy logs, of which so much was
    `judged` [s], `asked` for it most, and what to do: where they do for long, the fault is the
    model's."""
    mimics, times = _mimics(bank), f"{widened:.2g}"
    if float(times) == 1.0 and not mimics:
        return []
    advice = (
        "that is much of the logs, so rather the plant file lacks something that the plant does"
        if sum(each.end - each.start for each in asked) > MUCH * judged
        else "if some of that was not healthy, leave it out with --where; if it was, the plant "
        "file lacks something that the plant does there"
    )
    larger = [f"what looks like a fault there counts for none: {mimics}"] if mimics else []
    if float(times) != 1.0:
        a_fault = "any other fault" if mimics else "a fault"
        larger += [
            f"all intervals are made {times} times as wide, and {a_fault} must be {times} times as "
            "large to be told"
        ]
    return [
        "the model errs in ways that its noise does not cover, and healthy logs would look faulty, "
        f"most of all {_most_of_all(asked, clocks)}: {'; '.join([*larger, advice])}"
    ]


def _mimics(bank: FaultBank) -> str:
    """Below which size faults are not told that healthy logs mimic, and for how long."""
    said = []
    for k, fault in enumerate(bank.model.plant.signals.faults):
        sizes = np.array([least_real(bank, k, 0.0, bank.level, age) for age in (0.0, *bank.until)])
        late, longer = sizes[-1], np.flatnonzero(sizes > sizes[-1])
        parts = []
        if len(longer):
            lasts = duration(float(bank.until[longer[-1]]))
            parts = [f"{_amount(sizes[0], fault.unit)} in its first {lasts}"]
        if late:
            parts += [_amount(late, fault.unit) + (" later" if parts else "")]
        said += [f"{fault.name} below {' and '.join(parts)}"] if parts else []
    return listed(said) if said else ""


def _amount(size: float, unit: str) -> str:
    return f"{number(float(size), 2)} {spoken(unit)}".rstrip()


def _most_of_all(asked: Sequence[Block], clocks: Mapping[str, Clock | None]) -> str:
    """Where healthy logs look faulty, as what, and how clearly."""
    return "; ".join(
        f"run {b.run} from {_at(b, b.start, clocks)} to {_at(b, b.end, clocks)} "
        f"({b.cause}, {_odds(b.peak)})"
        for b in sorted(asked, key=lambda each: -each.peak)[:MOST_NAMED]
    )


def _at(block: Block, t: float, clocks: Mapping[str, Clock | None]) -> str:
    """A time of `block`, at the second or finer where it is short."""
    return moment(clocks[block.run], t, min(1.0, (block.end - block.start) / 10))


def level_of(peaks: Float[np.ndarray, "blocks"], allowed: int) -> float:
    """The level that `allowed` of the `peaks`, highest first, may lie above."""
    upper = peaks[: max((len(peaks) + 1) // 2, 1)]
    excess = float(np.mean(upper - np.median(peaks)))
    return float(
        max(peaks[allowed] + MARGIN * min(excess, 1.0 + max(peaks[allowed], 0.0)), CERTAIN)
    )


def _odds(peak: float) -> str:
    odds = float(np.exp(min(peak, 100.0)))
    return (
        f"odds of more than {TOLD_ODDS:.0f} to 1"
        if odds >= TOLD_ODDS
        else f"odds of {number(odds, 2)} to 1"
    )


def calibrated(model: Model, found: BankCalibration, **beside: Any) -> Model:
    """`model` with what was `found`, and what is told `beside` it: `data`, `repeats`."""
    levels = NoiseLevels.model_validate(found.noise.as_dict(model))
    told = {"observer": "bank", "data": [], "repeats": {}} | beside
    return model.with_calibration(CalibrationRecord(**told, noise=levels, bank=found.level))


def without_calibration(model: Model) -> Model:
    """`model` without what an earlier calibration says."""
    return model.with_calibration(None)


def _first_samples(runs: Sequence[Run], most: int) -> list[Run]:
    """As much of every one of `runs`, `most` samples in all."""
    share = min(1.0, most / sum(len(run.t) for run in runs))
    return [cut(run, slice(0, max(2, int(share * len(run.t))))) for run in runs]


def _blocks(bank: FaultBank, scores: Sequence[Sequence[Scored]], source: str) -> list[Block]:
    """Every run's `scores` in blocks."""
    stretches = [each for run in scores for each in run]
    length = max(int(np.ceil(MEMORIES * bank.knowledge.memory / bank.step)), SHORTEST)
    total = sum(len(each.score) for each in stretches)
    length = max(min(length, total // (2 * FEWEST_BLOCKS)), SHORTEST)
    blocks = []
    for name, t, score, likeliest, size, *_ in stretches:
        count = max(len(score) // length, 1 if len(score) >= SHORTEST else 0)
        for piece in np.array_split(np.arange(len(score)), count) if count else ():
            end = float(t[piece[-1]]) + bank.step
            top = piece[np.argmax(score[piece])]
            cause = _cause(bank, int(likeliest[top]), float(size[top]))
            blocks.append(Block(name, float(t[piece[0]]), end, float(score[top]), cause))
    if len(blocks) < FEWEST_BLOCKS:
        have = total * bank.step
        raise InputError(
            f"{source}: calibration needs at least {FEWEST_BLOCKS} blocks "
            f"({FEWEST_BLOCKS * length * bank.step:.3g} s of healthy data), "
            f"but there are {have:.3g} s after the hold-off; give more healthy runs."
        )
    return blocks


def _cause(bank: FaultBank, which: int, size: float) -> str:
    """The fault `which` of `size`; one behind the last is something undeclared."""
    faults = bank.model.plant.signals.faults
    if which == len(faults):
        return UNDECLARED
    sign = "+" if size > 0 else ""
    return f"{faults[which].name} of {sign}{number(size, 2)} {spoken(faults[which].unit)}".rstrip()


def _scores(bank: FaultBank, run: Run) -> list[Scored]:
    """Every stretch of `run` behind its hold-off."""
    watch = Watch(bank.model, tuple(run.columns), run.step, bank=bank)
    rows = prepared(watch.signals, run)
    row = watch.along(watch.init(averaged=run.resampled is not None), rows)[1]
    found, nis = row.posterior, np.asarray(row.nis)
    calm, unknown = np.asarray(found.calm), np.nan_to_num(found.unknown)
    active = np.nan_to_num(found.p) * bank.with_monitor("active")
    likeliest = np.argmax(np.column_stack([active, unknown]), axis=1)
    none, age = np.full(len(calm), np.nan), np.asarray(found.onset)[..., 0]
    mimicked = np.asarray(Mimicked.of(bank).at(age))
    own = found.f / np.maximum(found.p, RARE), np.square(found.sd) - mimicked**2, age
    told = [
        np.take_along_axis(np.column_stack([each, none]), likeliest[:, None], axis=1)[:, 0]
        for each in own
    ]
    there = ~found.held & np.isfinite(calm)
    declared, either = (
        np.where(there, np.where(found.inside, np.maximum(log_odds(p), LOWEST), LOWEST), np.nan)
        for p in (calm + unknown, calm)
    )
    outlasts, persists = bank.outlasts, bank.model.plant.signals.detection.persistence
    edges = np.flatnonzero(np.diff(there, prepend=False, append=False))
    stretches = []
    for a, b in edges.reshape(-1, 2):
        lasting = _lowest(either[a:b], outlasts / bank.step)
        score = _lowest(np.maximum(declared[a:b], lasting), persists / bank.step)
        first = int(np.ceil(persists / bank.step))  # before, no alarm can be
        if len(score) > first:
            part = slice(a + first, b)
            own = (each[part] for each in (likeliest, *told, nis))
            stretches.append(Scored(run.name, run.t[part], score[first:], *own))
    return stretches


def _lowest(score: Float[np.ndarray, "samples"], samples: float) -> Float[np.ndarray, "samples"]:
    """The least that each was since so many `samples` before; `LOWEST` where it has not been for as
    long."""
    count = int(np.ceil(samples))
    before = np.concatenate([np.full(count, LOWEST), score])
    return np.lib.stride_tricks.sliding_window_view(before, count + 1).min(axis=1)
