"""The benchmarks of decisions: public records with real faults, and what is told of them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

from faultgauge.reporting.report import Report, Section, Table
from faultgauge_studies.published import crazypad, skab

__all__ = ["MEASURES", "Outcome", "faulted_report"]

TITLES = {
    "crazypad": "CrazyPAD: a damaged propeller in hover",
    "skab": "SKAB: anomalies of a water loop",
}


@runtime_checkable
class Outcome(Protocol):
    """What such a benchmark found: plain JSON, a table, and sentences under it."""

    def as_dict(self) -> dict[str, Any]: ...

    def table(self) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]: ...

    @property
    def notes(self) -> tuple[str, ...]: ...


MEASURES: Mapping[str, Callable[[Sequence[int], Callable[[str], None]], Outcome]] = {
    "crazypad": crazypad.measure,
    "skab": skab.measure,
}


def faulted_report(name: str, outcome: Outcome) -> Report:
    """The report of `faultgauge benchmark` for one of them."""
    section = Section(TITLES[name], outcome.notes, (Table(*outcome.table()),))
    return Report(f"Benchmark: {TITLES[name]}", outcome.notes[:1], (section,))
