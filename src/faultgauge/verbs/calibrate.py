"""`calibrate`: noise, model error and alarm level on healthy logs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Unpack

import numpy as np

from faultgauge.detection.answer.smallest import smallest_from
from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.calibration import calibration
from faultgauge.plants.model import Model
from faultgauge.plants.record import CalibrationRecord
from faultgauge.plants.settings import with_settings
from faultgauge.reporting.words.calibration import summary, telling
from faultgauge.reporting.words.reliance import doubt
from faultgauge.verbs.how import How, Reading, reads
from faultgauge.verbs.plants import model_of
from faultgauge.verbs.reading import Runs, runs_for_model, unlike_warnings
from faultgauge.verbs.result import Columns, Result

__all__ = ["Calibrated", "calibrate"]


@dataclass(frozen=True, eq=False, repr=False)
class Calibrated(Result):
    """What a calibration found.

    **Fields**

    - `model`: the model with its calibration, for `estimate`.
    - `found`: the healthy blocks behind it (`.blocks`) and those that look faulty (`.suspects`).
    - `smallest`: for each fault the size, in its unit, that would have been named in the longest of
      the logs, had it begun in its middle; None where none that is to be expected would.
    - `warnings`: about the logs.
    """

    found: calibration.Calibration
    runs: Runs
    warnings: Sequence[str]

    @property
    def model(self) -> Model:
        """The calibrated model."""
        return self.found.model

    @property
    def _known(self) -> CalibrationRecord:
        assert self.model.calibration is not None
        return self.model.calibration

    @cached_property
    def smallest(self) -> dict[str, float | None]:
        if self._known.channels is not None:
            return {}
        bank = build_fault_bank(self.model, self.runs, noise_of(self.model))
        longest = max(self.runs, key=lambda run: len(run.t))
        (sizes,) = smallest_from(bank, longest, [0.5])
        return dict(zip(self.model.plant.signals.fault_names, sizes, strict=True))

    @property
    def lines(self) -> list[str]:
        return [*summary(self.model), *telling(self.model, self.smallest)]

    def as_dict(self) -> dict[str, Any]:
        smallest = {} if not self.smallest else {"smallest": self.smallest}
        return {**self._known.as_dict(), **smallest, "warnings": list(self.warnings)}

    def columns(self) -> Columns:
        """A row per healthy block with its highest score in log-odds; of an observer alone, a row
        per fault with the interval of its estimate."""
        channels = self._known.channels
        if channels is not None:
            return {
                "fault": list(channels),
                "interval": [each.interval for each in channels.values()],
            }
        found = self.found.blocks
        return {
            key: [getattr(each, key) for each in found] for key in ("run", "start", "end", "peak")
        }

    def page(self) -> Any:
        from faultgauge.reporting.chapters import calibration_report

        return calibration_report(self.found, self.runs)

    def figures(self) -> Any:
        """The healthy blocks against the alarm level; of an observer, its intervals."""
        channels = self._known.channels
        if channels is not None:
            from faultgauge.reporting.model_figures import bars

            widths = [each.interval for each in channels.values()]
            return [
                bars(
                    list(channels),
                    np.array([[each] * 3 for each in widths]),
                    title="Healthy estimates",
                    name="95 % within",
                    unit="each fault's own",
                )
            ]
        from faultgauge.reporting.calibration_chapter import calibration_section

        bank = build_fault_bank(self.model, self.runs, noise_of(self.model))
        return calibration_section(bank, self.found.blocks).figures


@reads
def calibrate(
    model: Any,
    sources: Any,
    *,
    mtbfa: float | None = None,
    observer: str = "bank",
    plant: str | None = None,
    progress: Callable[[str], None] = lambda text: None,
    **reading: Unpack[Reading],
) -> Calibrated:
    """Find noise, model error and alarm level on healthy logs.

    **Arguments**

    - `model`: a fitted model, or its file.
    - `sources`: healthy logs that the fit has not seen: paths, data frames, dicts of arrays, runs,
      or a list of them (`read`, which also says what `time`, `time_format`, `map`, `where` and
      `resample` mean).
    - `mtbfa`: mean time between false alarms [s]; by default the longest that the logs support.
    - `observer`: `"bank"`, which decides, or the name of an observer, for its intervals alone.
    - `plant`: a plant file (or preset) to take `[faults]`, `[detection]` and `[observer]` from.
    - `progress`: is told what is being done.

    Returns a `Calibrated`: its `.model` is for `estimate`. Raises `InputError` where more is asked
    for than the logs support, where they are too short, or where no fault is declared.
    """
    known = model_of(model)
    if plant is not None:
        known = with_settings(known, plant)
    runs = runs_for_model(known, sources, How(**reading))
    odd = unlike_warnings(known, runs)
    found = calibration.calibrate(known, runs, mtbfa=mtbfa, observer=observer, progress=progress)
    reason = doubt(found.model)
    return Calibrated(found, runs, [*odd, *found.warnings, *([reason] if reason else [])])
