"""The section on evidence: of each event the window over which the bank gives it again."""

from collections.abc import Sequence

import numpy as np

from faultgauge.detection.answer.evidence import Evidence
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.posterior.events import UNKNOWN
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
        tuple(_words(bank, each) for each in windows),
        (),
        tuple(_figure(bank, each) for each in windows),
        shown=1,
    )


def _words(bank: FaultBank, found: Evidence) -> str:
    run = found.decision.run
    first, last = (moment(run.clock, float(found.run.t[k]), bank.step) for k in (0, -1))
    verb = "gives" if found.replayed is not None else "does not give"
    return (
        f"{_which(bank, found)}: {first} to {last}; judged alone, this part {verb} the same answer."
    )


def _which(bank: FaultBank, found: Evidence) -> str:
    """Which event it is: of one fault there may be many."""
    run, event = found.decision.run, found.event
    name = UNDECLARED if event.fault == UNKNOWN else event.fault
    return f"{name} told at {moment(run.clock, event.start, bank.step)}, run {run.name}"


def _figure(bank: FaultBank, found: Evidence) -> Figure:
    """What was measured, the estimates, and how likely each cause is, in the order, and so with the
    looks, that they have elsewhere; of many those that were the likeliest."""
    decision, fault = found.decision, found.event.fault
    posterior, names = decision.posterior, bank.model.plant.signals.fault_names
    likely = {"no fault": posterior.healthy, UNDECLARED: posterior.unknown}
    largest = np.max(np.nan_to_num(posterior.p[found.part]), axis=0)
    if fault in names:
        largest[names.index(fault)] = np.inf
    shown = sorted(np.argsort(-largest)[: MOST_CAUSES - len(likely)].tolist())
    likely |= {names[k]: posterior.p[:, k] for k in shown}
    title = f"Evidence of {_which(bank, found)}"
    return run_overview(bank, decision, part=found.part, likely=likely, title=title)
