"""The only door to detection: what the calibrated model says of a log, and what it foretells."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from faultgauge.detection.answer.smallest import smallest_from
from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.decisions import Decision, Walk, decide
from faultgauge.detection.posterior.events import UNKNOWN, pause, stretches
from faultgauge.detection.posterior.uncalibrated import level_in, uncalibrated
from faultgauge.detection.posterior.verdicts import FAULT, NOT_JUDGED, STALE
from faultgauge.detection.watch import Watch
from faultgauge.errors import InputError
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.runs import paced

__all__ = [
    "UNKNOWN",
    "Event",
    "Judge",
    "Judgement",
    "check_calibrated",
    "false_alarm_rate",
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


class Judge:
    """A calibrated `model` before logs as `runs` are, which have one time step; `walk` is who runs
    the step."""

    def __init__(self, model: Model, runs: Sequence[Run], walk: Walk = Watch.along) -> None:
        self.model, self.walk = model, walk
        self.bank = build_fault_bank(model, runs, noise_of(model))
        self.pause = pause(self.bank)

    def decide(self, run: Run) -> Decision:
        """All that the model says of `run`; without residuals."""
        return decide(self.bank, paced(run), None, self.walk)

    def told(self, decision: Decision) -> Judgement:
        """What counts of that."""
        return _judgement(decision, self.pause)

    def __call__(self, run: Run) -> Judgement:
        return self.told(self.decide(run))

    def smallest(self, run: Run, *shares: float) -> list[dict[str, float | None]]:
        """For each declared fault the smallest size [its unit] that the model says it would name by
        the end of `run`, had it begun at each of `shares` of it; None where it says none."""
        names = self.model.plant.signals.fault_names
        sizes = smallest_from(self.bank, run, shares)
        return [dict(zip(names, each, strict=True)) for each in sizes]


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
