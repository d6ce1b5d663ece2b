"""`detectability`: what could be seen of declared faults in logs like these."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Unpack

from faultgauge.foresight import Sheet
from faultgauge.foresight import detectability as foresee
from faultgauge.foresight.words import lines
from faultgauge.verbs.how import How, Reading, reads
from faultgauge.verbs.plants import model_of
from faultgauge.verbs.reading import runs_for_model, unlike_warnings
from faultgauge.verbs.result import Columns, Result

__all__ = ["Detectable", "detectability"]


@dataclass(frozen=True, eq=False, repr=False)
class Detectable(Result):
    """What could be seen: `sheet` holds every log's faults, pairs, delays and test inputs;
    `warnings` are about the logs."""

    sheet: Sheet
    warnings: Sequence[str]

    @property
    def lines(self) -> list[str]:
        return lines(self.sheet)

    def as_dict(self) -> dict[str, Any]:
        return self.sheet.as_dict()

    def columns(self) -> Columns:
        """Every fault of every log as a row: the size seen, and those named at each rate of false
        alarms."""
        rows = [(run.name, each) for run in self.sheet.runs for each in run.faults]
        found: Columns = {
            "run": [run for run, _ in rows],
            "fault": [each.name for _, each in rows],
            "unit": [each.unit for _, each in rows],
            "seen_from": [each.seen_from for _, each in rows],
        }
        for rarer in self.sheet.rarer:
            found[f"smallest_{rarer:g}"] = [each.smallest[rarer] for _, each in rows]
        return found

    def page(self) -> Any:
        from faultgauge.reporting.detectability_chapter import detectability_report

        return detectability_report(self.sheet)


@reads
def detectability(
    model: Any,
    sources: Any,
    *,
    progress: Callable[[str], None] = lambda text: None,
    **reading: Unpack[Reading],
) -> Detectable:
    """What could be seen of each fault in logs like these, told apart, and by what test input?

    **Arguments**

    - `model`: a calibrated model, or its file.
    - `sources`: logs: paths, data frames, dicts of arrays, runs, or a list of them (`read`, which
      also says what `time`, `time_format`, `map`, `where` and `resample` mean).
    - `progress`: is told what is being done.

    Returns a `Detectable`. Raises `InputError` for a model without calibration, where no fault is
    declared, and for a log that holds no information on any of them.
    """
    known = model_of(model)
    runs = runs_for_model(known, sources, How(**reading))
    return Detectable(foresee(known, runs, progress=progress), unlike_warnings(known, runs))
