"""`estimate --evidence`: a log of each event's evidence, which gives the same answer again."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from faultgauge.cli import options

if TYPE_CHECKING:
    from faultgauge.detection.evidence import Evidence

__all__ = ["write_evidence"]


def write_evidence(found: "Sequence[Evidence]", folder: Path) -> list[str]:
    """Write the windows; the path of each. A window that does not replay is written too, and said
    to be one."""
    from faultgauge.telemetry.writing import as_table, write_table

    paths = []
    for count, each in enumerate(found, 1):
        safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in each.run.name)
        path = folder / f"{count:02d}_{safe}_{each.event.fault}.csv"
        write_table(as_table(each.run), path)
        paths.append(str(path))
        if each.replayed is None:
            options.warn(
                [f"{path}: judged alone, this part of the run does not give the same answer"]
            )
    return paths
