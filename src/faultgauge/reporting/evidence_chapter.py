"""The section on evidence: of each event the window over which the bank gives it again."""

from collections.abc import Sequence

import numpy as np

from faultgauge.detection.answer.evidence import MOST_SHOWN, Evidence
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.posterior.events import POSSIBLE, UNKNOWN
from faultgauge.detection.words import UNDECLARED, moment
from faultgauge.reporting.report import Section
from faultgauge.reporting.run_overview import run_overview
from faultgauge.reporting.svg import Figure

__all__ = ["evidence_section"]

MOST_CAUSES = 6  # in one panel


def evidence_section(bank: FaultBank, windows: Sequence[Evidence]) -> Section:
    """What each window is, and its figure."""
    return Section(
        "Evidence",
        tuple(_words(bank, each) for each in windows[:MOST_SHOWN]),
        (),
        tuple(_figure(bank, each) for each in windows[:MOST_SHOWN]),
        shown=1,
    )


def _words(bank: FaultBank, found: Evidence) -> str:
    run = found.decision.run
    first, last = (moment(run.clock, float(found.run.t[k]), bank.step) for k in (0, -1))
    name = UNDECLARED if found.event.fault == UNKNOWN else found.event.fault
    verb = "gives" if found.replayed is not None else "does not give"
    return (
        f"{name}, run {run.name}: {first} to {last}; judged alone, this part "
        f"{verb} the same answer."
    )


def _figure(bank: FaultBank, found: Evidence) -> Figure:
    """What was measured, the estimates, and how likely each cause is that was ever possible."""
    decision, fault = found.decision, found.event.fault
    posterior, names = decision.posterior, bank.model.plant.signals.fault_names
    likely = {"no fault": posterior.healthy}
    if fault in names:
        likely[fault] = posterior.p[:, names.index(fault)]
    likely[UNDECLARED] = posterior.unknown
    largest = np.max(np.nan_to_num(posterior.p[found.part]), axis=0)
    others = [k for k in np.argsort(-largest) if names[k] != fault and largest[k] > POSSIBLE]
    likely |= {names[k]: posterior.p[:, k] for k in others[: MOST_CAUSES - len(likely)]}
    title = f"Evidence of {UNDECLARED if fault == UNKNOWN else fault}, run {decision.run.name}"
    return run_overview(bank, decision, part=found.part, likely=likely, title=title)
