"""`estimate --fleet`: which unit has which fault, how big, since when."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

from faultgauge.crew.crew import Done, crew
from faultgauge.fleet.calibrate import model_of_unit
from faultgauge.fleet.folder import check_some, folder_for, land, with_models
from faultgauge.fleet.result import FleetResult, failures
from faultgauge.fleet.units import Unit, units_in
from faultgauge.telemetry.writing import table_bytes
from faultgauge.verbs.estimate import estimate
from faultgauge.verbs.how import How, Reading, reads
from faultgauge.verbs.reading import runs_for_model
from faultgauge.verbs.result import Columns

__all__ = ["EstimateJob", "FleetEstimate", "estimate_fleet"]

ROWS, TOLD = ".csv", ".json"


@dataclass(frozen=True)
class EstimateJob:
    """What the bank says of one unit: a row per sample, and what `estimate --json` tells."""

    how: How

    def __call__(self, unit: Unit) -> Done:
        model = model_of_unit(unit)
        found = estimate(model, runs_for_model(model, [unit.source], self.how))
        told = {**found.as_dict(), "lines": found.lines, "warnings": list(found.warnings)}
        name = f"{unit.name}{ROWS}"
        text = json.dumps(told, indent=1, allow_nan=False).encode()
        # the latter is written last, and says that the unit is done
        return Done(
            unit.name, {name: table_bytes(found.rows, Path(name)), f"{unit.name}{TOLD}": text}
        )


@dataclass(frozen=True, eq=False, repr=False)
class FleetEstimate(FleetResult):
    """What `estimate_fleet` found: what `estimate --json` tells of every unit, by name, in `units`,
    with its `lines` and `warnings`; rows and answers stand in `folder`."""

    folder: Path
    units: dict[str, dict[str, Any]]
    failed: dict[str, str]
    before: int
    warnings: Sequence[str]

    @property
    def title(self) -> str:
        return "Faults in a fleet"

    @property
    def lines(self) -> list[str]:
        """The units with events, each with its first line; then how many have none."""
        told = [
            f"{name}: {each['lines'][0]}" for name, each in self.units.items() if each["events"]
        ]
        return [*told, f"{self.counts}; {len(told)} with a fault"]

    @property
    def sentences(self) -> list[str]:
        own = [f"{name}: {line}" for name, each in self.units.items() for line in each["lines"]]
        return [*own, self.lines[-1]]

    def as_dict(self) -> dict[str, Any]:
        return {"units": self.units, "failed": self.failed, "done_before": self.before}

    def columns(self) -> Columns:
        """A row per event, and one without for every unit that has none, or failed."""
        keys = ("run", "fault", "start", "end", "size", "lo", "hi", "p")
        rows = [
            {"unit": name, **{key: event[key] for key in keys}}
            for name, each in self.units.items()
            for event in each["events"] or [dict.fromkeys(keys)]
        ]
        rows += [{"unit": name, "failed": why} for name, why in self.failed.items()]
        names = ("unit", *keys, "failed")
        return {name: [row.get(name) for row in rows] for name in names}


@reads
def estimate_fleet(
    fleet: str | Path,
    logs: Any,
    out: str | Path,
    *,
    again: bool = False,
    scheduler: str | None = None,
    progress: Callable[[str], None] = lambda text: None,
    **reading: Unpack[Reading],
) -> FleetEstimate:
    """Estimate the faults of every unit of a fleet.

    **Arguments**

    - `fleet`: the folder with the units' calibrated models.
    - `logs`: their logs, as for `fit_fleet`.
    - `out`: the folder for `UNIT.csv`, a row per sample, `UNIT.json`, and `units.csv`, a row per
      event. Units whose answer is there are not asked `again` unless that is wanted.
    - the rest as for `fit_fleet`.

    Returns a `FleetEstimate`. Raises `InputError` for logs that are not those of a fleet, and where
    no unit can be judged.
    """
    units, folder = units_in(logs), folder_for(out, logs)
    job = EstimateJob(How(**reading))
    todo = [u for u in units if again or not (folder / f"{u.name}{TOLD}").is_file()]
    given = with_models(Path(fleet), todo)
    with crew(scheduler, progress) as workers:
        failed = land(workers, job, given, folder, len(todo), "estimating", progress)
    told = {u.name: folder / f"{u.name}{TOLD}" for u in units if u.name not in failed}
    check_some(failed, list(told))
    found = {name: json.loads(path.read_text()) for name, path in sorted(told.items())}
    before = len(units) - len(todo)
    return FleetEstimate(folder, found, failed, before, failures(failed)).written()
