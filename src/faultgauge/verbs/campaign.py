"""`campaign`: many simulated runs with faults in them, judged and scored."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from faultgauge.campaigns import Campaign, Plan, carry_out, read_campaign
from faultgauge.detection.decisions import Walk
from faultgauge.detection.watch import Watch
from faultgauge.files import write_atomically
from faultgauge.reporting.words.campaign import lines
from faultgauge.telemetry.writing import table_bytes, write_table
from faultgauge.verbs.result import Columns, Result

__all__ = ["FILES", "Campaigned", "campaign"]

FILES = ("runs.parquet", "results.json", "report.html")


@dataclass(frozen=True, eq=False, repr=False)
class Campaigned(Result):
    """What a campaign found: `found` holds every run and every figure; they stand in `folder`, too,
    as `runs.parquet`, `results.json` and `report.html`."""

    found: Campaign
    folder: Path
    warnings: Sequence[str]

    @property
    def lines(self) -> list[str]:
        return lines(self.found)

    def as_dict(self) -> dict[str, Any]:
        return self.found.as_dict()

    def columns(self) -> Columns:
        """Every run as a row: what was put in and what was said of it."""
        return self.found.table()

    def page(self) -> Any:
        from faultgauge.reporting.campaign_chapter import campaign_report

        return campaign_report(self.found)

    def written(self) -> "Campaigned":
        """The same, its files in the folder."""
        rows, results, page = (self.folder / name for name in FILES)
        write_table(self.columns(), rows)
        text = json.dumps(self.as_dict(), indent=1, allow_nan=False)
        write_atomically(results, text.encode())
        self.report(page)
        return self


def campaign(
    plan: Any,
    out: str | Path,
    *,
    walk: Walk = Watch.along,
    scheduler: str | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Campaigned:
    """Simulate many runs with faults in them, and judge each: what is found, and how honestly?

    **Arguments**

    - `plan`: a campaign file, or what `read_campaign` made of one.
    - `out`: the folder for the runs and all figures. Given again with the same plan, a call that
      was ended goes on where it was, and ends with the same files.
    - `walk`: who runs the step along a log: `faultgauge.export.engine.Engine(folder)` runs it as C.
    - `scheduler`: the address of a scheduler of Dask, whose workers do the runs, or `local` for one
      that is started on this machine; None does them here.
    - `progress`: is told what is being done.

    Returns a `Campaigned`. Raises `InputError` for a plan that makes no sense, for a folder of
    another campaign, and where its files cannot be written; what is done by then is kept.
    """
    folder = Path(out)
    table_bytes({}, folder / FILES[0])  # needs a package, which is missed before any work
    given = plan if isinstance(plan, Plan) else read_campaign(plan)
    found = carry_out(given, folder, walk=walk, scheduler=scheduler, progress=progress)
    return Campaigned(found, folder, found.warnings).written()
