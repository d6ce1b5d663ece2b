"""The report of `estimate`: events, and every fault with its interval."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from faultgauge.detection.answer import answers, told
from faultgauge.detection.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.events import BankEvent
from faultgauge.detection.evidence import Evidence
from faultgauge.detection.probability import probability
from faultgauge.detection.retrospective import Retrospect
from faultgauge.detection.verdicts import NOT_JUDGED, STALE
from faultgauge.plants.model import Model
from faultgauge.reporting.evidence_chapter import evidence_section
from faultgauge.reporting.report import Report, Section, Table
from faultgauge.reporting.retrospective_chapter import retrospective_section
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, fault_estimate, panels

__all__ = [
    "decision_figures",
    "decision_report",
    "headline",
    "leading",
    "unjudged_report",
]

MOST_CURVES, MOST_RESIDUALS = 8, 4  # in one figure
MOST_SENTENCES = 5
MOST_FIGURES = 12  # a report is read, not scrolled
HEADER = ("run", "fault", "began [s]", "told [s]", "end [s]", "size", "p", "instead, odds")


def decision_report(
    bank: FaultBank,
    decisions: Sequence[Decision],
    hindsight: Sequence[Retrospect] = (),
    windows: Sequence[Evidence] = (),
    truth: Mapping[str, Float[np.ndarray, "samples"]] | None = None,
) -> Report:
    """Events as sentences and as a table, estimates with their intervals; `hindsight`, what the
    whole logs tell, and the evidence `windows` of the events, as sections of their own. `truth`
    (fault: size) where it is known."""
    first, more = leading(bank, decisions)
    head, detail = headline(first)
    summary = (head, *detail, *more[: MOST_SENTENCES - 1])
    if len(more) >= MOST_SENTENCES:
        summary = (*summary, f"And {len(more) + 1 - MOST_SENTENCES} more, listed below.")
    events = [event for each in decisions for event in each.events]
    shown = slice(
        0 if len(decisions) > 1 else 1,
        None if any(event.alternatives for event in events) else -1,
    )
    rows = tuple(_row(event)[shown] for event in events)
    tables = (Table(HEADER[shown], rows, "Every event."),) if events else ()
    figures = [figure for each in decisions for figure in decision_figures(bank, each, truth or {})]
    section = Section("Faults", (), tables, tuple(figures[:MOST_FIGURES]))
    sections = [section]
    if windows:
        sections.append(evidence_section(bank, windows))
    if hindsight:
        sections.append(retrospective_section(bank, decisions, hindsight))
    return Report(f"Faults: {bank.model.plant.spec.name}", summary, tuple(sections))


def leading(bank: FaultBank, decisions: Sequence[Decision]) -> tuple[str, list[str]]:
    """(what to say first, the rest in the order of time): the first answer that lasts at least
    half as long as the longest one, or the one answer where nothing was found."""
    found = told(bank, decisions)
    everything = answers(bank, decisions)
    if not found:
        return everything[0], everything[1:]
    longest = max(each.end - each.start for each in found)
    k = next(k for k, each in enumerate(found) if each.end - each.start >= longest / 2)
    return everything.pop(k), everything


def headline(sentence: str) -> tuple[str, tuple[str, ...]]:
    """An answer as what is said largest, fault, size, onset and p, and the sentence behind it."""
    head, _, rest = sentence.partition("; ")
    return head, (f"{rest[0].upper()}{rest[1:]}.",) if rest else ()


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
        f"{event.size:.4g} ({event.lo:.4g} to {event.hi:.4g})" if sized else "",
        probability(event.p),
        "; ".join(f"{label} 1:{odds:.3g}" for label, odds in event.alternatives),
    )


def decision_figures(
    bank: FaultBank, decision: Decision, truth: Mapping[str, Float[np.ndarray, "samples"]]
) -> list[Figure]:
    """What each fault is given, with the residuals; then every fault, in the plant's order."""
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
            truth=truth.get(fault.name),
            events=[(e.start, e.end) for e in decision.events if e.fault == fault.name],
            not_judged=silent,
            probable=True,
        )
        for k, fault in enumerate(faults)
    ]
