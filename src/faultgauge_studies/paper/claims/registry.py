"""The claims in the order of the report: a new one is a new file and one line here."""

from collections.abc import Callable
from types import ModuleType
from typing import Any, NamedTuple

from faultgauge.reporting.report import Section
from faultgauge_studies.paper.bench import Traces
from faultgauge_studies.paper.claims import (
    components,
    condition_13,
    convergence,
    four_parts,
    lemma1,
    peers,
    same_ability,
    separate_networks,
    unknown_domains,
    wavelets,
)
from faultgauge_studies.paper.claims.verdict import Verdict
from faultgauge_studies.paper.tables import Results

__all__ = ["CLAIMS", "ONCE", "Claim"]

Found = tuple[dict[str, Any], Traces]


class Claim(NamedTuple):
    """`measure` gives figures and curves, of one seed's bench or, in `ONCE`, for all seeds; the
    others speak of all seeds."""

    name: str
    measure: Callable[..., Found]
    section: Callable[[Results, Traces], Section]
    verdict: Callable[[Results], Verdict]


def _of(name: str, module: ModuleType) -> Claim:
    return Claim(name, module.measure, module.section, module.verdict)


CLAIMS = (
    _of("Fig 1: peers", peers),
    _of("Fig 2: four parts", four_parts),
    _of("Lemma 1", lemma1),
    _of("separate networks", separate_networks),
    _of("unknown domains", unknown_domains),
    _of("convergence", convergence),
    _of("model error put in", same_ability),
    _of("two components", components),
    _of("wavelets", wavelets),
)
ONCE = (_of("condition (13)", condition_13),)
