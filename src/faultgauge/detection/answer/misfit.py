"""Logs that the model does not follow: a fault all over them, or the model of another plant.

An alarm level that is found on such logs hides faults, and an alarm over such a log says little of
which fault it is; both answers look sound.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from faultgauge.detection.answer.pieces import typical_errors
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.posterior import Posterior
from faultgauge.detection.posterior.verdicts import QUIET
from faultgauge.detection.words import number
from faultgauge.identification.validation.evaluation import POOR_FREE_RUN
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run

__all__ = ["FEWEST_JUDGED", "Alarmed", "Misfit", "alarmed_throughout", "not_followed", "quiet"]

WORSE = 10.0  # times the free run's error on the data that the fit was validated on
NOTABLE = 0.1  # of an output's standard deviation
ALMOST_ALL = 0.8  # of the judged samples of a run
AT_ONCE = 0.05  # of them, within which the alarm begins
FEWEST_JUDGED = 20  # judged samples before which a stream says nothing: AT_ONCE is one of them


def not_followed(model: Model, runs: Sequence[Run]) -> list[str]:
    """A sentence for every one of the healthy `runs` that the model's free run does not follow as
    it followed the data it was validated on; of a plant that it cannot follow there, as of one that
    runs away without its loop, a free run tells nothing."""
    usual = model.record.metrics.validation_free_run_nrmse
    if usual is None or usual >= POOR_FREE_RUN:
        return []
    return [
        f"run {run.name}: the model's free run errs by {number(error, 2)} times the standard "
        f"deviation of {name}, and by {number(usual, 2)} times where it was validated: a fault all "
        "over this log, or the model of another plant; smaller faults than this error will not be "
        "told"
        for run in runs
        for name, error in typical_errors(model, run).items()
        if error > max(WORSE * usual, NOTABLE)
    ]


def quiet(found: Posterior) -> Bool[np.ndarray, "samples"]:
    """Rows that speak of no fault, also where none would show: an alarm was not on before them."""
    heard = np.isfinite(found.healthy) & ~found.held & found.inside
    return heard & (np.nan_to_num(found.calm) > QUIET)


def alarmed_throughout(decisions: Sequence[Decision]) -> list[str]:
    """A sentence for every run whose status is FAULT from its beginning on and nearly always."""
    found = []
    for each in decisions:
        alarmed = Alarmed(each.run.name)
        alarmed.add(each.status, quiet(each.posterior))
        if alarmed.throughout:
            found.append(alarmed.sentence())
    return found


@dataclass(frozen=True)
class Misfit:
    """The same of a stream, said at `t` [s], once: as soon as it is true of the rows so far, and
    these are as many judged ones as a block of the calibration has; at the latest, as of a file,
    when the stream ends."""

    run: str
    t: float
    text: str


@dataclass
class Alarmed:
    """How much of one run is under alarm, in judged samples and those that are quiet; `calm` of
    them before the first."""

    run: str
    judged: int = 0
    alarms: int = 0
    calm: int = 0

    def add(self, status: Sequence[str], quiet: Bool[np.ndarray, "_"]) -> None:
        """The next samples."""
        for each, calm in zip(status, quiet, strict=True):
            if calm or each in ("HEALTHY", "FAULT"):
                self.judged += 1
                self.alarms += each == "FAULT"
                self.calm += self.alarms == 0

    @property
    def throughout(self) -> bool:
        """From the beginning on and nearly always."""
        often = self.alarms >= ALMOST_ALL * self.judged
        return self.alarms > 0 and often and self.calm <= AT_ONCE * self.judged

    def sentence(self) -> str:
        return (
            f"run {self.run}: alarm in {100 * self.alarms / self.judged:.0f} % of what could be "
            "judged, from the beginning on: a fault already there when the log begins, or the "
            "model of another plant; where `faultgauge estimate` says the same of a healthy log, "
            "it is the model"
        )
