"""`calibrate --fleet`: noise, model error and alarm level of every unit, on its healthy logs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

from faultgauge.crew.crew import Done, crew
from faultgauge.errors import InputError
from faultgauge.fleet.folder import (
    check_some,
    folder_for,
    land,
    model_path,
    unit_file,
    with_models,
)
from faultgauge.fleet.result import FleetResult, failures
from faultgauge.fleet.units import Unit, units_in
from faultgauge.plants.model import Model, decoded, encoded, load_model
from faultgauge.plants.record import CalibrationRecord
from faultgauge.reporting.words.calibration import summary
from faultgauge.verbs.calibrate import calibrate
from faultgauge.verbs.how import How, Reading, reads
from faultgauge.verbs.reading import runs_for_model
from faultgauge.verbs.result import Columns

__all__ = ["CalibrateJob", "FleetCalibrated", "calibrate_fleet", "model_of_unit"]


@dataclass(frozen=True)
class CalibrateJob:
    """The calibrated model of one unit."""

    how: How
    mtbfa: float | None

    def __call__(self, unit: Unit) -> Done:
        model = model_of_unit(unit)
        runs = runs_for_model(model, [unit.source], self.how)
        found = calibrate(model, runs, mtbfa=self.mtbfa).model
        return Done(unit.name, {unit_file(unit.name): encoded(found)})


def model_of_unit(unit: Unit) -> Model:
    """The fitted model of `unit`. Raises `InputError` where its fit failed or never was."""
    if unit.model is None:
        raise InputError(
            "it has no model in this fleet; fit it with `faultgauge fit ... --fleet --out` of the "
            "same folder, or take its log away."
        )
    return decoded(unit.model, unit_file(unit.name))


@dataclass(frozen=True, eq=False, repr=False)
class FleetCalibrated(FleetResult):
    """What `calibrate_fleet` found: the calibration of every unit, by name, in `units`."""

    folder: Path
    units: dict[str, CalibrationRecord]
    failed: dict[str, str]
    before: int
    warnings: Sequence[str]
    said: dict[str, list[str]]

    @property
    def title(self) -> str:
        return "Calibration of a fleet"

    @property
    def lines(self) -> list[str]:
        return [f"{self.counts}; calibrated"]

    @property
    def sentences(self) -> list[str]:
        """And every unit's own."""
        own = [f"{name}: {line}" for name, lines in self.said.items() for line in lines]
        return [*self.lines, *own]

    def as_dict(self) -> dict[str, Any]:
        units = {name: each.as_dict() for name, each in self.units.items()}
        return {"units": units, "failed": self.failed, "done_before": self.before}

    def columns(self) -> Columns:
        """A row per unit: seconds of healthy log, alarm level, mean time between false alarms."""
        banks = [each.bank for each in self.units.values()]
        rest = [None] * len(self.failed)
        keys = ("healthy_s", "level", "mtbfa_s", "widened")
        return {
            "unit": [*self.units, *self.failed],
            **{key: [*(getattr(bank, key) for bank in banks), *rest] for key in keys},
            "failed": [*(None for _ in banks), *self.failed.values()],
        }


@reads
def calibrate_fleet(
    fleet: str | Path,
    logs: Any,
    *,
    out: str | Path | None = None,
    mtbfa: float | None = None,
    again: bool = False,
    scheduler: str | None = None,
    progress: Callable[[str], None] = lambda text: None,
    **reading: Unpack[Reading],
) -> FleetCalibrated:
    """Calibrate every unit of a fleet on its own healthy logs.

    **Arguments**

    - `fleet`: the folder that `fit_fleet` has filled.
    - `logs`: healthy logs of its units, as for `fit_fleet`.
    - `out`: the folder for the calibrated models; by default they replace those of `fleet`. Units
      that are calibrated there are not calibrated `again` unless that is asked for.
    - `mtbfa` as in `calibrate`, the rest as for `fit_fleet`.

    Returns a `FleetCalibrated`. Raises `InputError` for logs that are not those of a fleet, and
    where no unit can be calibrated.
    """
    source, units = Path(fleet), units_in(logs)
    target = folder_for(source if out is None else out, logs)
    job = CalibrateJob(How(**reading), mtbfa)
    todo = [u for u in units if again or not _calibrated(model_path(target, u.name))]
    given = with_models(source, todo)
    with crew(scheduler, progress) as workers:
        failed = land(workers, job, given, target, len(todo), "calibrating", progress)
    found = {u.name: model_path(target, u.name) for u in units if u.name not in failed}
    check_some(failed, list(found))
    told, said = {}, {}
    for name, path in sorted(found.items()):
        model = load_model(path)
        if model.calibration is not None:
            told[name], said[name] = model.calibration, summary(model)
    before = len(units) - len(todo)
    return FleetCalibrated(target, told, failed, before, failures(failed), said)


def _calibrated(path: Path) -> bool:
    return path.is_file() and load_model(path).calibration is not None
