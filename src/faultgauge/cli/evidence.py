"""`estimate --evidence`: a log of each event's evidence, which gives the same answer again."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from faultgauge.cli import options
from faultgauge.progress import Step

if TYPE_CHECKING:
    from faultgauge.detection.answer.evidence import Evidence
    from faultgauge.verbs.estimate import Answer, Estimates

__all__ = ["evidence_files", "replayed", "write_evidence"]

LONGEST = 100  # bytes of a run's and of a fault's name in a file name, of which 255 are legal


def replayed(found: "Answer | Estimates", progress: Callable[[str], None]) -> "list[Evidence]":
    """The evidence of every event."""
    windows = []
    for k, event in enumerate(found.events):
        progress(Step(f"replaying event {k + 1} of {len(found.events)}", k / len(found.events)))
        windows.append(found.evidence(event))
    return windows


def evidence_files(found: "Sequence[Evidence]", folder: Path) -> list[Path]:
    """Where each window goes."""
    return [
        folder / f"{count:02d}_{_legal(each.run.name)}_{_legal(each.event.fault)}.csv"
        for count, each in enumerate(found, 1)
    ]


def _legal(name: str) -> str:
    safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
    return safe.encode()[:LONGEST].decode(errors="ignore")


def write_evidence(found: "Sequence[Evidence]", paths: "Sequence[Path]") -> None:
    """Write the windows. One that does not replay is written too, and said to be one."""
    from faultgauge.telemetry.writing import as_table, write_table

    for each, path in zip(found, paths, strict=True):
        write_table(as_table(each.run), path)
        if each.replayed is None:
            options.warn(
                [f"{path}: judged alone, this part of the run does not give the same answer"]
            )
