"""`check`: fit, calibrate and estimate in one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

from faultgauge.detection import decisions
from faultgauge.detection.answer import misfit
from faultgauge.detection.answer.swapped import swapped_in
from faultgauge.detection.posterior.events import BankEvent
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.reporting.words import answer, reliance
from faultgauge.telemetry import check_same_units
from faultgauge.telemetry.other_range import other_range
from faultgauge.verbs import checkup
from faultgauge.verbs.estimate import Answer, glitched
from faultgauge.verbs.how import How, Reading, reads
from faultgauge.verbs.plants import plant as as_plant
from faultgauge.verbs.reading import runs_alone, runs_for_plant
from faultgauge.verbs.result import Columns, Result

__all__ = ["Check", "check", "guessed"]


@dataclass(frozen=True, eq=False, repr=False)
class Check(Result):
    """Whether a log is like a healthy one.

    **Fields**

    - `events`: every fault that was told; `rows` and `sentences` as those of an `Answer`.
    - `model`: fitted and calibrated on the healthy log, for more logs.
    - `answer`: the same as `estimate` gives it, with `hindsight()` and `evidence(event)`.
    - `found`: everything behind it; `warnings` are about the logs, the fit and the calibration.
    """

    found: checkup.Checkup
    warnings: Sequence[str]

    @property
    def model(self) -> Model:
        """The model that judged, fitted and calibrated on the healthy logs."""
        return self.found.model

    @property
    def answer(self) -> Answer:
        """The same as `estimate` gives it."""
        return Answer(self.found.model, self.found.decisions, self.found.bank, [], self.warnings)

    @property
    def events(self) -> list[BankEvent]:
        """What happened in the suspect logs."""
        return [event for each in self.found.decisions for event in each.events]

    @property
    def rows(self) -> Columns:
        """The decisions, a row per sample."""
        return decisions.table(self.found.decisions, self.model.plant.signals.fault_names)

    @property
    def sentences(self) -> list[str]:
        return self.found.sentences

    @property
    def lines(self) -> list[str]:
        return self.found.first_screen

    def as_dict(self) -> dict[str, Any]:
        found = self.found
        names = found.model.plant.signals.fault_names
        return {
            "events": answer.as_dicts(found.bank, found.decisions) if found.bank else [],
            "sentences": found.sentences,
            "doubt": reliance.doubt(found.model),
            "runs": answer.runs_as_dicts(found.bank, found.decisions, names),
        }

    def columns(self) -> Columns:
        return self.rows

    def page(self) -> Any:
        from faultgauge.verbs.checkup_report import checkup_report

        return checkup_report(self.found)

    def figures(self) -> Any:
        return self.answer.figures()


@reads
def check(
    healthy: Any,
    suspect: Any,
    plant: Any = None,
    *,
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
    **reading: Unpack[Reading],
) -> Check:
    """Fit, calibrate, estimate in one: is `suspect` like `healthy`, and if not, how much?

    **Arguments**

    - `healthy`, `suspect`: logs: paths, data frames, dicts of arrays, runs, or lists of them
      (`read`, which also says what `time`, `time_format`, `map`, `where` and `resample` mean).
    - `plant`: a plant, a plant file, a preset, the text of a plant file, or a dict; by default a
      black box, guessed from the healthy log.
    - `seed` of the starts; `progress` is told what is being done.

    Returns a `Check`. Raises `InputError` as `fit`, `calibrate` and `estimate` do.
    """
    how = How(**reading)
    body = guessed(healthy, how) if plant is None else as_plant(plant)
    good = runs_for_plant(body.spec, healthy, how, fitting=True)
    doubtful = runs_for_plant(body.spec, suspect, how)
    check_same_units([*good, *doubtful], good.how.maps)
    found = checkup.check(body, good, doubtful, seed=seed, progress=progress)
    found = replace(found, model=found.model.with_reading(good.how.said))
    throughout = misfit.alarmed_throughout(found.decisions)
    unlike = other_range(found.model, doubtful)
    exchanged = [] if found.bank is None else swapped_in(found.model, found.decisions)
    odd = [*throughout, *exchanged, *glitched(found.decisions)]
    warnings = [*unlike, *found.account.warnings, *found.calibration.warnings, *odd]
    return Check(found, warnings)


def guessed(healthy: Any, how: How) -> GrayBoxPlant:
    """A black box for what is in the log: a network per state."""
    return checkup.black_box(runs_alone(healthy, how), "log")
