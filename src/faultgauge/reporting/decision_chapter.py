"""The report of `estimate --observer bank`: events, and every fault with its interval."""

from collections.abc import Sequence

import numpy as np

from faultgauge.detection.answer import answers
from faultgauge.detection.bank import FaultBank
from faultgauge.detection.decisions import BankEvent, Decision
from faultgauge.detection.evidence import Evidence
from faultgauge.detection.retrospective import Retrospect
from faultgauge.detection.verdicts import NOT_JUDGED, STALE
from faultgauge.plants.model import Model
from faultgauge.reporting.evidence_chapter import evidence_section
from faultgauge.reporting.report import Report, Section, Table
from faultgauge.reporting.retrospective_chapter import retrospective_section
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, fault_estimate, panels

__all__ = ["decision_report", "unjudged_report"]

MOST_CURVES, MOST_RESIDUALS = 8, 4  # in one figure
MOST_FIGURES = 12  # a report is read, not scrolled
HEADER = ("run", "fault", "began [s]", "told [s]", "end [s]", "size", "95 % interval", "p", "or")


def decision_report(
    bank: FaultBank,
    decisions: Sequence[Decision],
    hindsight: Sequence[Retrospect] = (),
    windows: Sequence[Evidence] = (),
) -> Report:
    """Events as sentences and as a table, estimates with their intervals; `hindsight`, what the
    whole logs tell, and the evidence `windows` of the events, as sections of their own."""
    told = answers(bank, decisions)
    summary = tuple(told[:5])
    if len(told) > 5:
        summary = (*summary, f"And {len(told) - 5} more events, listed below.")
    events = [event for each in decisions for event in each.events]
    tables = (Table(HEADER, tuple(_row(e) for e in events), "Every event."),) if events else ()
    figures = [figure for each in decisions for figure in _figures(bank, each)]
    section = Section("Faults", (), tables, tuple(figures[:MOST_FIGURES]))
    sections = [section]
    if windows:
        sections.append(evidence_section(bank, windows))
    if hindsight:
        sections.append(retrospective_section(bank, decisions, hindsight))
    return Report(f"Faults: {bank.model.plant.spec.name}", summary, tuple(sections))


def unjudged_report(model: Model, decisions: Sequence[Decision], sentence: str) -> Report:
    """Where nothing could be judged: `sentence` says why, and the residuals are shown."""
    figures = [
        panels(
            each.run.t,
            _residuals(model, each),
            title=f"Residuals, {each.run.name}",
            caption="Measured less healthy reference.",
        )
        for each in decisions[:MOST_FIGURES]
    ]
    section = Section("Residuals", (), (), tuple(figures))
    return Report(f"Faults: {model.plant.spec.name}", (sentence,), (section,))


def _residuals(model: Model, decision: Decision) -> list[Panel]:
    units = {each.name: each.unit for each in model.plant.signals.outputs}
    return [
        Panel(f"residual of {name}", units[name], {"measured less reference": r})
        for name, r in list(decision.residuals.items())[:MOST_RESIDUALS]
    ]


def _row(event: BankEvent) -> tuple[str, ...]:
    sized = event.size is not None
    return (
        event.run,
        event.fault,
        f"{event.onset:.6g} ({event.onset_lo:.6g} to {event.onset_hi:.6g})",
        f"{event.start:.6g}",
        f"{event.end:.6g}",
        f"{event.size:.4g}" if sized else "",
        f"{event.lo:.4g} to {event.hi:.4g}" if sized else "",
        f"{event.p:.3g}",
        "; ".join(f"{label} 1:{odds:.3g}" for label, odds in event.alternatives),
    )


def _figures(bank: FaultBank, decision: Decision) -> list[Figure]:
    found, run = decision.posterior, decision.run
    silent = np.isin(decision.status, [NOT_JUDGED, STALE])
    faults = bank.model.plant.signals.faults
    curves = {"healthy": found.healthy, "unknown": found.unknown}
    curves |= {fault.name: found.p[:, k] for k, fault in enumerate(faults[: MOST_CURVES - 2])}
    evidence = [Panel("probability", "", curves), *_residuals(bank.model, decision)]
    shown = panels(
        run.t,
        evidence,
        title=f"Evidence, {run.name}",
        caption="What each fault, none and an undeclared one are given, and the residuals.",
    )
    return [shown] + [
        fault_estimate(
            decision.run.t,
            found.f[:, k],
            found.lo[:, k],
            found.hi[:, k],
            limit=None,
            name=fault.name,
            unit=fault.unit,
            events=[(e.start, e.end) for e in decision.events if e.fault == fault.name],
            not_judged=silent,
            probable=True,
        )
        for k, fault in enumerate(faults)
    ]
