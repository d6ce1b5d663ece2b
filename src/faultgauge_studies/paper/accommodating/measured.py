"""All of it for one seed, and its sections of the report."""

from typing import Any

from faultgauge.reporting.report import Section
from faultgauge_studies.paper.accommodating import lost_wheel, margins, policies, pyramid
from faultgauge_studies.paper.bench import Traces
from faultgauge_studies.paper.tables import Results

__all__ = ["QUICK", "SLOW", "sections"]

QUICK = (policies.measure,)
SLOW = (margins.measure, lost_wheel.measure, pyramid.measure)


def sections(results: Results, traces: Traces) -> tuple[Section, ...]:
    """The policies, and what `--quick` leaves out where it was measured."""
    parts: list[Any] = [policies] if results["quick"] else [policies, margins, lost_wheel, pyramid]
    return tuple(part.section(results, traces) for part in parts)
