"""The report of `estimate`: events, and every fault with its interval."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from faultgauge.detection.answer.evidence import Evidence
from faultgauge.detection.answer.shares import WHOLE, shares_of
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.onset.retrospective import Retrospect
from faultgauge.detection.posterior.events import BankEvent
from faultgauge.detection.words import OLDER, TOLD_ODDS, UNDECLARED, amount, moment, number
from faultgauge.plants.model import Model
from faultgauge.reporting.evidence_chapter import evidence_section
from faultgauge.reporting.report import Report, Section, Table
from faultgauge.reporting.retrospective_chapter import retrospective_section
from faultgauge.reporting.run_overview import run_overview, silent
from faultgauge.reporting.scales import least_sizes, noise_scales
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, around, fault_estimate, panels
from faultgauge.reporting.words.answer import answers, headline, told
from faultgauge.reporting.words.event_sentence import called, given_up, onset_of, other_cause
from faultgauge.reporting.words.probability import probability

__all__ = [
    "decision_figures",
    "decision_report",
    "leading",
    "unjudged_report",
]

MOST_CURVES, MOST_RESIDUALS = 8, 4  # in one figure
MOST_ROWS = 12  # of an open table
MOST_FIGURES = 12  # a report is read, not scrolled
HEADER = ("run", "fault", "began", "told", "seen until", "size", "p", "less likely", "there too")


def decision_report(
    bank: FaultBank,
    decisions: Sequence[Decision],
    hindsight: Sequence[Retrospect] = (),
    windows: Sequence[Evidence] = (),
    truth: Mapping[str, Float[np.ndarray, "samples"]] | None = None,
) -> Report:
    """Events as sentences, a figure of every run and a table; then the evidence `windows` of the
    events and `hindsight`, what the whole logs tell; every fault's estimate is folded. The run of
    the first sentence comes first, then those with a fault. `truth` (fault: size) where it is
    known."""
    first, more, whose = leading(bank, decisions)
    ordered = sorted(decisions, key=lambda each: (each is not whose, not each.events))
    sections = [*_overviews(bank, ordered, truth or {}), *_events(bank, decisions)]
    if windows:
        shown = sorted(windows, key=lambda each: each.decision is not whose)
        sections.append(evidence_section(bank, shown))
    if hindsight:
        sections.append(retrospective_section(bank, ordered, hindsight))
    figures = [figure for each in ordered for figure in decision_figures(bank, each, truth or {})]
    all_of_it = tuple(figures[:MOST_FIGURES])
    sections.append(Section("Every fault, told or not", figures=all_of_it, folded=True))
    title = f"Faults: {bank.model.plant.spec.name}"
    return Report(title, (first, *more), tuple(sections))


def _overviews(
    bank: FaultBank,
    decisions: Sequence[Decision],
    truth: Mapping[str, Float[np.ndarray, "samples"]],
) -> list[Section]:
    """A figure of each run; the first is open."""
    left = len(decisions) - MOST_FIGURES
    note = (f"{left} more runs are not drawn.",) if left > 0 else ()
    found = [
        Section(f"Run {each.run.name}", (), (), (run_overview(bank, each, truth),), folded=k > 0)
        for k, each in enumerate(decisions[:MOST_FIGURES])
    ]
    return [*found[:-1], replace(found[-1], paragraphs=note)]


def _events(bank: FaultBank, decisions: Sequence[Decision]) -> list[Section]:
    """The table of all events, where there is any; a long one is folded."""
    rows = [_row(bank, each, event) for each in decisions for event in each.events]
    if not rows:
        return []
    kept = [k for k in range(len(HEADER)) if any(row[k] for row in rows)]
    kept = kept if len(decisions) > 1 else kept[1:]
    table = Table(
        tuple(HEADER[k] for k in kept),
        tuple(tuple(row[k] for k in kept) for row in rows),
        "Every event.",
    )
    return [Section("Faults", (), (table,), folded=len(rows) > MOST_ROWS)]


def leading(bank: FaultBank, decisions: Sequence[Decision]) -> tuple[str, list[str], Decision]:
    """(what to say first: fault, size, onset and p; the sentences behind it; the run that it is
    of). First is the `headline`, else what it means that there is none, of runs of which all was
    judged if there are such; behind it all that is said of it, and in the order of time the
    others."""
    everything, said = answers(bank, decisions), headline(bank, decisions)
    if said:
        whose, first = said
        head, rest, found = first.head, "; ".join(first.rest), told(bank, decisions)
        others = [each.head for each in found if each != first] + everything[len(found) :]
    else:
        judged = (one for one in decisions if shares_of(one).judged >= WHOLE)
        whose = next(judged, decisions[0])
        head, _, rest = everything[0].partition("; ")
        others = everything[1:]
    return head, [_sentence(each) for each in (rest, *others) if each], whose


def _sentence(text: str) -> str:
    """With a full stop; of the name of a fault the first letter stays as it is."""
    text = f"{text[0].upper()}{text[1:]}" if text.startswith(("told", "not judged")) else text
    return f"{text.rstrip('.')}."


def unjudged_report(model: Model, decisions: Sequence[Decision], sentence: str) -> Report:
    """Where nothing could be judged: `sentence` says why, and the residuals are shown."""
    figures = [
        panels(
            each.run.t,
            _residuals(model, each),
            title=f"Residuals, {each.run.name}",
            caption="Measured less healthy reference.",
            clock=each.run.clock,
        )
        for each in decisions[:MOST_FIGURES]
    ]
    section = Section("Residuals", (), (), tuple(figures))
    return Report(f"Faults: {model.plant.spec.name}", (sentence,), (section,))


def _residuals(model: Model, decision: Decision) -> list[Panel]:
    units = {each.name: each.unit for each in model.plant.signals.outputs}
    spans = {name: around(np.zeros(1), each) for name, each in noise_scales(model).items()}
    return [
        Panel(f"residual of {name}", units[name], {"measured less reference": r}, span=spans[name])
        for name, r in list(decision.residuals.items())[:MOST_RESIDUALS]
    ]


def _row(bank: FaultBank, decision: Decision, event: BankEvent) -> tuple[str, ...]:
    """What the sentence of an event says, as cells."""
    clock, named = decision.run.clock, {name for name, *_ in given_up(bank, decision, event)}
    units = {each.name: each.unit for each in bank.model.plant.signals.faults}

    size = ""
    if event.size is not None and event.lo is not None and event.hi is not None:
        size = amount(event.size, event.lo, event.hi, units[event.fault])
    began = onset_of(event, bank.step, clock).cell()
    return (
        event.run,
        called(event),
        OLDER if event.older == "yes" else began,
        moment(clock, event.start, bank.step),
        moment(clock, event.end, bank.step),
        size,
        probability(event.p),
        "; ".join(
            f"{other_cause(event, name, named)} 1:{number(odds, 2)}"
            for name, odds in event.instead
            if odds < TOLD_ODDS
        ),
        "; ".join(f"{name} p {probability(p)}" for name, p in event.beside if name not in named),
    )


def decision_figures(
    bank: FaultBank, decision: Decision, truth: Mapping[str, Float[np.ndarray, "samples"]]
) -> list[Figure]:
    """What each fault is given, with the residuals; then every fault, in the plant's order."""
    found, run = decision.posterior, decision.run
    faults = bank.model.plant.signals.faults
    least = least_sizes(bank, decision)
    curves = {"no fault": found.healthy, UNDECLARED: found.unknown}
    curves |= {fault.name: found.p[:, k] for k, fault in enumerate(faults[: MOST_CURVES - 2])}
    evidence = [
        Panel("probability", "", curves, span=(0.0, 1.0)),
        *_residuals(bank.model, decision),
    ]
    shown = panels(
        run.t,
        evidence,
        title=f"Probabilities and residuals, {run.name}",
        caption=f"How likely no fault, {UNDECLARED} and each fault are, and the residuals.",
        clock=run.clock,
    )
    return [shown] + [
        fault_estimate(
            run.t,
            found.f[:, k],
            found.lo[:, k],
            found.hi[:, k],
            limit=None,
            name=fault.name,
            unit=fault.unit,
            truth=truth.get(fault.name),
            events=[(e.onset, e.end) for e in decision.events if e.fault == fault.name],
            not_judged=silent(decision),
            probable=True,
            least=least[k],
            clock=run.clock,
        )
        for k, fault in enumerate(faults)
    ]
