"""Logs that the model does not follow: a fault all over them, or the model of another plant.

An alarm level that is found on such logs hides faults, and an alarm over such a log says little of
which fault it is; both answers look sound.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool

from faultgauge.detection.bank.fidelity import LONGEST
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.posterior import Posterior
from faultgauge.detection.posterior.verdicts import QUIET
from faultgauge.detection.words import number
from faultgauge.errors import InputError
from faultgauge.identification.evaluation import WARMUP, evaluate
from faultgauge.identification.holdout import LAST_SHARE
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run, cut

__all__ = ["FEWEST", "Alarmed", "Misfit", "alarmed_throughout", "not_followed", "quiet"]

SHORTEST = 2 * WARMUP  # samples of a piece
WORSE = 10.0  # times the free run's error on the data that the fit was validated on
NOTABLE = 0.1  # of an output's standard deviation
ALMOST_ALL = 0.8  # of the judged samples of a run
AT_ONCE = 0.05  # of them, within which the alarm begins
FEWEST = 20  # judged samples before which a stream says nothing: AT_ONCE is one of them


def not_followed(model: Model, runs: Sequence[Run]) -> list[str]:
    """A sentence for every one of the healthy `runs` that the model's free run does not follow as
    it followed the data it was validated on.

    Free runs begin anew at every piece that is as long as what a fit holds out of a run: through
    all of a log the model of a plant that integrates is carried off by errors of no account.
    """
    between, usual = model.record.between, model.record.metrics.validation_free_run_nrmse
    if usual is None:
        return []
    found = []
    for run in [cut(run, slice(0, LONGEST)) for run in runs]:
        try:
            scored, _ = evaluate(model.plant, _pieces(run), model.max_step, between=between)
        except InputError:  # nowhere two samples in a row: nothing to follow
            continue
        scores = scored["runs"]
        for name in model.plant.signals.output_names:
            parts = [each["outputs"][name]["rmse"] for each in scores if name in each["outputs"]]
            spread = float(np.nanstd(run.columns[name])) if parts else 0.0
            if not spread > 0:
                continue
            blown_up = np.inf
            typical = np.median([blown_up if each is None else each for each in parts])
            error = float(typical) / spread
            if error > max(WORSE * usual, NOTABLE):
                found.append(
                    f"run {run.name}: the model's free run errs by {number(error, 2)} times the "
                    f"standard deviation of {name}, and by {number(usual, 2)} times where it was "
                    "validated: a fault all over this log, or the model of another plant; smaller "
                    "faults than this error will not be told"
                )
    return found


def _pieces(run: Run) -> list[Run]:
    """`run` in parts as long as what a fit holds out of one, and long enough to be scored."""
    count = max(1, min(round(1 / LAST_SHARE), len(run.t) // SHORTEST))
    edges = np.linspace(0, len(run.t), count + 1).astype(int)
    return [
        replace(cut(run, slice(a, b)), name=f"{run.name}, part {k}")
        for k, (a, b) in enumerate(itertools.pairwise(edges.tolist()), 1)
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
            "model of another plant; `faultgauge evaluate` on a healthy log of this plant tells "
            "which"
        )
