"""`rehearse`: declared faults put into healthy logs, and what would be found."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Unpack

from faultgauge.rehearsal import rehearse as rehearsing
from faultgauge.rehearsal.rehearse import TRIALS
from faultgauge.rehearsal.result import Rehearsal
from faultgauge.rehearsal.words import lines
from faultgauge.verbs.how import How, Reading, reads
from faultgauge.verbs.plants import model_of
from faultgauge.verbs.reading import runs_for_model, unlike_warnings
from faultgauge.verbs.result import Columns, Result

__all__ = ["Rehearsed", "rehearse"]


@dataclass(frozen=True, eq=False, repr=False)
class Rehearsed(Result):
    """What would be found of each declared fault: `found` holds every trial and every figure,
    `warnings` are about the logs."""

    found: Rehearsal
    warnings: Sequence[str]

    @property
    def lines(self) -> list[str]:
        return lines(self.found)

    def as_dict(self) -> dict[str, Any]:
        return self.found.as_dict()

    def columns(self) -> Columns:
        """Every injected fault as a row."""
        return self.found.table()

    def page(self) -> Any:
        from faultgauge.reporting.rehearsal_chapter import rehearsal_report

        return rehearsal_report(self.found)


@reads
def rehearse(
    model: Any,
    sources: Any,
    *,
    sizes: Mapping[str, float] | None = None,
    trials: int = TRIALS,
    scheduler: str | None = None,
    progress: Callable[[str], None] = lambda text: None,
    **reading: Unpack[Reading],
) -> Rehearsed:
    """Put declared faults into healthy logs: what would be found?

    **Arguments**

    - `model`: a calibrated model, or its file.
    - `sources`: healthy logs that neither fit nor calibrate has seen: paths, data frames, dicts of
      arrays, runs, or a list of them (`read`, which also says what `time`, `time_format`, `map`,
      `where` and `resample` mean).
    - `sizes`: rehearse these faults alone, of these sizes [the fault's unit]: `{"leak": 0.002}`.
    - `trials`: logs to judge, at most.
    - `scheduler`: the address of a scheduler of Dask, whose workers judge the logs, or `local` for
      one that is started on this machine; None judges them here.
    - `progress`: is told what is being done.

    Returns a `Rehearsed`. Raises `InputError` for a model without calibration, and where no fault
    can be rehearsed on these logs.
    """
    known = model_of(model)
    runs = runs_for_model(known, sources, How(**reading))
    asked = {"sizes": sizes, "trials": trials, "scheduler": scheduler}
    found = rehearsing(known, runs, **asked, progress=progress)
    return Rehearsed(found, [*unlike_warnings(known, runs), *found.warnings])
