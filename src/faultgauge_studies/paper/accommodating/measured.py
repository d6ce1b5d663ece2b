"""All of it for one seed, and its sections of the report."""

from collections.abc import Iterator
from typing import Any

from faultgauge.reporting.report import Section
from faultgauge_studies.paper.accommodating import lost_wheel, margins, policies, pyramid
from faultgauge_studies.paper.accommodating.setting import calibrated
from faultgauge_studies.paper.bench import Bench, Traces
from faultgauge_studies.paper.tables import Results

__all__ = ["measured", "sections"]

SLOW = (margins.measure, lost_wheel.measure, pyramid.measure)


def measured(bench: Bench, *, quick: bool = False) -> Iterator[tuple[dict[str, Any], Traces]]:
    """(figures, traces) of every part; all of them act on one calibrated model."""
    model = calibrated(bench.learned.model, bench.wheel, bench.seed)
    for measure in (policies.measure, *(() if quick else SLOW)):
        yield measure(bench, model)


def sections(results: Results, traces: Traces) -> tuple[Section, ...]:
    """The policies, and what `--quick` leaves out where it was measured."""
    parts: list[Any] = [policies] if results["quick"] else [policies, margins, lost_wheel, pyramid]
    return tuple(part.section(results, traces) for part in parts)
