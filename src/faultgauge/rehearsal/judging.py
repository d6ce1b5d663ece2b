"""The only door to detection: what the calibrated model says of a log, and what it foretells."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from faultgauge.detection.answer import least_told
from faultgauge.detection.bank import build_fault_bank
from faultgauge.detection.decisions import Decision, decide_runs
from faultgauge.detection.events import UNKNOWN, pause, stretches
from faultgauge.detection.noise import noise_of
from faultgauge.detection.uncalibrated import level_in, uncalibrated
from faultgauge.detection.verdicts import FAULT, NOT_JUDGED, STALE
from faultgauge.errors import InputError
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run

__all__ = [
    "UNKNOWN",
    "Event",
    "Judgement",
    "check_calibrated",
    "false_alarm_rate",
    "judge",
    "predicted_smallest",
]


class Event(NamedTuple):
    """A fault that was named: `told` at, with its onset and size, each in its 95 % interval; s and
    the fault's unit, no size for an undeclared one. It lasted until `end`."""

    fault: str
    told: float
    end: float
    size: float | None
    lo: float | None
    hi: float | None
    onset: float
    onset_lo: float
    onset_hi: float


class Judgement(NamedTuple):
    """What was said of one log: events, alarms as (first, last sample) [s], the hours that were
    judged, and the share of rows that were not."""

    events: tuple[Event, ...]
    alarms: tuple[tuple[float, float], ...]
    hours: float
    not_judged: float


def check_calibrated(model: Model) -> None:
    """Raises `InputError` where `model` was not calibrated for the bank."""
    if lacking := uncalibrated(model):
        raise InputError(
            f"the model is {lacking}, so it cannot tell faults; run `faultgauge calibrate` on "
            "healthy logs, other ones than those of the rehearsal, first."
        )


def judge(model: Model, runs: Sequence[Run]) -> list[Judgement]:
    """What `model` says of each of `runs`, which have one time step."""
    decisions, bank = decide_runs(model, runs)
    return [_judgement(each, pause(bank) if bank else 1) for each in decisions]


def predicted_smallest(model: Model, run: Run, fault: str) -> float | None:
    """The smallest size [the fault's unit] that the model says it would name, had it begun in the
    middle of `run`; None where it says none."""
    bank = build_fault_bank(model, [run], noise_of(model))
    return least_told(bank, run, model.plant.signals.fault_names.index(fault))


def false_alarm_rate(model: Model) -> float:
    """False alarms per hour that calibration allows at most (95 % confidence)."""
    return 3600 / level_in(model).mtbfa_s


def _judgement(decision: Decision, longest: int) -> Judgement:
    status = np.array(decision.status)
    alarm = stretches(status == FAULT, np.isfinite(decision.posterior.healthy), longest)
    silent = np.isin(status, [NOT_JUDGED, STALE])
    found = tuple(
        Event(e.fault, e.start, e.end, e.size, e.lo, e.hi, e.onset, e.onset_lo, e.onset_hi)
        for e in decision.events
    )
    hours = float(np.sum(~silent)) * decision.run.step / 3600
    t = decision.run.t
    alarms = tuple((float(t[start]), float(t[stop - 1])) for start, stop in alarm)
    return Judgement(found, alarms, hours, float(np.mean(silent)))
