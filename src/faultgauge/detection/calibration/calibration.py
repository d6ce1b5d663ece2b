"""`calibrate`: what healthy runs say of the bank, or of an observer's estimates."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from faultgauge.detection.answer.estimation import Observing
from faultgauge.detection.answer.misfit import not_followed
from faultgauge.detection.answer.swapped import swapped
from faultgauge.detection.bank.bank import evaluated_faults
from faultgauge.detection.bank.extended import retold
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration.bank_calibration import (
    calibrate_bank,
    calibrated,
    without_calibration,
)
from faultgauge.detection.calibration.blocks import CONFIDENCE, Block, check_mtbfa
from faultgauge.detection.calibration.equal_faults import equal_faults
from faultgauge.detection.calibration.noise_estimation import estimate_doubts, estimate_noise
from faultgauge.detection.calibration.trust import LEFT, WORTH
from faultgauge.detection.rows.flat_line import longest_repeats
from faultgauge.detection.rows.judged import build_bank, check_observer
from faultgauge.detection.words import duration
from faultgauge.errors import InputError
from faultgauge.identification.command_checks import command_warnings
from faultgauge.identification.log_checks import other_units
from faultgauge.plants.disturbed import dynamic_states
from faultgauge.plants.model import Model
from faultgauge.plants.record import CalibrationRecord, Interval
from faultgauge.progress import Step
from faultgauge.telemetry import Run

__all__ = ["Calibration", "calibrate"]

# of the work: noise, how far evidence is believed, and both once more where the model errs more
# somewhere
SHARES = (0.4, 0.2, 0.2, 0.2)
FEWEST = 100  # samples that tell a 95 % interval: 5 of them lie outside


@dataclass(frozen=True)
class Calibration:
    """What `calibrate` found: the model with its calibration block, and the blocks behind it."""

    model: Model
    blocks: list[Block]
    suspects: list[Block]
    warnings: list[str]


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

    The bank's noise, discrepancy and alarm level; with another `observer` the 95 % interval of
    its estimates, which decide nothing. `mtbfa` [s] is the
    requested mean time between false alarms; by default the longest that the data support: no alarm
    in T seconds proves only a rate below 3/T (at 95 %). Without `discrepancy` all that the model
    errs is taken for noise. Raises `InputError` where more is asked for than the data support,
    where they are too short, or where the plant declares no fault. The rate that runs
    were resampled to becomes that of a model that has none.
    """
    evaluated_faults(model.plant.signals)
    if observer != "bank":
        check_observer(observer)
        if mtbfa is not None:
            raise InputError(
                f"--mtbfa is about alarms, and observer {observer!r} alone raises none; leave one "
                "of the two out."
            )
    if mtbfa is not None:
        check_mtbfa(mtbfa)  # before the minutes that a calibration may take
    warnings, model = [], without_calibration(model)
    rates = {run.resampled for run in runs if run.resampled is not None}
    if model.resample is None and rates:
        model = model.with_resample(max(rates))
    fitted = set(model.record.data.fit)
    doubled = [run.name for run in runs if run.content_hash in fitted]
    if doubled:
        warnings.append(
            f"{', '.join(doubled)}: also used in fit, where the model looks better than it is; "
            "limit and interval may be too narrow. Calibrate on other runs if you can"
        )
    warnings += other_units(runs)
    warnings += command_warnings(model.plant, runs)
    warnings += not_followed(model, runs)
    warnings += swapped(model, runs)
    known = {
        "data": sorted(run.content_hash for run in runs),
        "repeats": longest_repeats(model, runs),
        "observer": observer,
    }
    if observer == "bank":
        return _by_bank(model, runs, mtbfa, discrepancy, known, warnings, progress)
    return _by_observer(model, runs, observer, known, warnings, progress)


def _by_bank(
    model: Model,
    runs: Sequence[Run],
    mtbfa: float | None,
    discrepancy: bool,
    known: dict[str, Any],
    warnings: list[str],
    progress: Callable[[str], None],
) -> Calibration:
    done = np.cumsum([0.0, *SHARES])

    def step(number: int, text: str) -> Callable[[float], None]:
        return lambda share: progress(Step(text, done[number] + SHARES[number] * share))

    searching = step(0, "finding noise and model error")
    searching(0.0)
    noise = estimate_noise(model, runs, discrepancy, searching)
    found = calibrate_bank(model, runs, noise, mtbfa, step(1, "finding the alarm level"))
    if discrepancy and found.lost > WORTH:
        where = step(2, "finding where the model errs more")
        doubted = estimate_doubts(model, runs, noise, where)
        if doubted is not None:
            level = step(3, "finding the alarm level")
            other = calibrate_bank(model, runs, doubted, mtbfa, level)
            if other.lost < LEFT * found.lost:
                noise, found = doubted, other
    equal = equal_faults(retold(model, noise), runs)
    warnings += [*equal.warnings, *lasting_warnings(model, runs, noise)]
    level = found.level.model_copy(update={"alike": equal.pairs})
    told = calibrated(model, found._replace(level=level), **known)
    return Calibration(told, found.blocks, found.suspects, [*warnings, *found.warnings])


def _by_observer(
    model: Model,
    runs: Sequence[Run],
    observer: str,
    known: dict[str, Any],
    warnings: list[str],
    progress: Callable[[str], None],
) -> Calibration:
    """How far the healthy estimates of an observer scatter."""
    bank = build_bank(model, runs, observer)
    progress("running the observers over the healthy logs")
    estimated = [Observing(bank, run, "free").push(run) for run in runs]
    judged = sum(int(each.settled.sum()) for each in estimated)
    if judged < FEWEST:
        raise InputError(
            f"{runs[0].source}: {judged} healthy samples after settling are too few for an "
            f"interval; give at least {FEWEST}."
        )
    channels = {}
    for name in bank.designs:
        size = np.concatenate([np.abs(each.f[name][each.settled]) for each in estimated])
        interval = np.quantile(size[np.isfinite(size)], CONFIDENCE)
        channels[name] = Interval(interval=float(interval))
    told = CalibrationRecord(
        **known,
        bandwidth=bank.bandwidth,
        judged_s=judged * bank.step,
        confidence=CONFIDENCE,
        channels=channels,
    )
    return Calibration(model.with_calibration(told), [], [], warnings)


def lasting_warnings(model: Model, runs: Sequence[Run], noise: Noise) -> list[str]:
    """What the healthy logs are too short, or too few, to tell."""
    found = []
    longest = max(float(run.t[-1] - run.t[0]) for run in runs)
    names = [model.plant.signals.state_names[k] for k in dynamic_states(model.plant)]
    slow = [n for n, tau in zip(names, noise.lasting, strict=True) if tau > longest]
    if slow:
        found.append(
            f"the model's own error in {', '.join(slow)} lasts longer than the longest healthy log "
            f"({duration(longest)}): these logs cannot tell how long, and a fault that began "
            "before a log looks like it; give longer healthy logs if you have them"
        )
    if len(runs) == 1 and len(noise.spread):
        found.append(
            "one healthy run cannot tell by how much the plant differs from run to run; give "
            "several"
        )
    return found
