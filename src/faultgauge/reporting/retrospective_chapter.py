"""The section of `estimate --smooth`: what the whole log tells, beside what was told then."""

from collections.abc import Sequence

import numpy as np

from faultgauge.detection.answer.shares import WHOLE
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.onset.retrospective import NO_FAULT, Retrospect
from faultgauge.detection.posterior.events import UNKNOWN
from faultgauge.detection.posterior.over_onsets import onset_over
from faultgauge.detection.words import UNDECLARED, about, amount, moment
from faultgauge.observers.divided_difference import FAR
from faultgauge.reporting.marks import NOISES
from faultgauge.reporting.report import Section, Table
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, panels
from faultgauge.reporting.words.hindsight import onset_of, sentences
from faultgauge.reporting.words.probability import probability
from faultgauge.telemetry.clock import Clock

__all__ = ["retrospective_section"]

MOST_FIGURES = 6  # of a chapter
HEADER = ("run", "window", "judged", "cause", "began", "told", "size", "p")
NAMES = {NO_FAULT: "no fault", UNKNOWN: f"{UNDECLARED} or not constant"}
AROUND = 2.0  # widths of the onset's interval that are shown on either side of it


def retrospective_section(
    bank: FaultBank, decisions: Sequence[Decision], found: Sequence[Retrospect]
) -> Section:
    """Sentences, a table of all windows, and the figures of those with a fault, in the order of
    `decisions`. Which share of its run each window judges is told where some of a run was not
    judged."""
    by_run = {each.run.name: each for each in decisions}
    order = {name: k for k, name in enumerate(by_run)}
    figures = [
        picture
        for each in sorted(found, key=lambda each: order[each.run])
        if each.cause != NO_FAULT
        for picture in (
            _fault(bank, by_run[each.run], each),
            *_onset(each, by_run[each.run].run.clock),
        )
    ]
    rows = [_row(bank, each) for each in found]
    # several changes in a window share its rows
    windows = {(each.run, each.start): each.judged for each in found}
    whole = min(sum(j for (of, _), j in windows.items() if of == run) for run in by_run) >= WHOLE
    left = {"judged"} if whole else set[str]()
    left |= {"run"} if len(by_run) == 1 else set()
    left |= {name for k, name in enumerate(HEADER) if not any(row[k] for row in rows)}
    kept = [k for k, name in enumerate(HEADER) if name not in left]
    table = Table(
        tuple(HEADER[k] for k in kept),
        tuple(tuple(row[k] for k in kept) for row in rows),
        "Every window, in hindsight.",
    )
    return Section(
        "In hindsight",
        tuple(f"{each}." for each in sentences(bank, decisions, found)),
        (table,),
        tuple(figures[:MOST_FIGURES]),
        shown=1,
    )


def _row(bank: FaultBank, found: Retrospect) -> tuple[str, ...]:
    """What the sentence of a window says, as cells."""
    clock, told, began, size = found.clock, found.told.start, "", ""
    onset = onset_of(found)
    if onset is not None:  # as the sentence has it
        began = onset.or_earlier() if onset.low <= found.start else onset.cell()
    if found.size is not None and found.lo is not None and found.hi is not None:
        units = {each.name: each.unit for each in bank.model.plant.signals.faults}
        size = amount(found.size, found.lo, found.hi, units[found.cause])
    # one ends where the next change begins, which lies between rows
    first, last = moment(clock, found.start, bank.step), about(clock, found.end, bank.step)
    return (
        found.run,
        f"{first} to {last}",
        f"{100 * found.judged:.0f} %",
        NAMES.get(found.cause, found.cause) if found.judged > 0 else "not judged",
        began,
        "" if told is None else moment(clock, told, bank.step),
        size,
        probability(found.p) if found.judged > 0 else "",
    )


def _fault(bank: FaultBank, decision: Decision, found: Retrospect) -> Figure:
    """Data with the fitted fault, and the fault as told online and in hindsight."""
    first = int(np.searchsorted(decision.run.t, found.t[0]))
    signals = bank.model.plant.signals
    explained, left = (np.nansum(np.abs(each), axis=0) for each in (found.fit, found.white))
    j = int(np.argmax(explained if explained.any() else left))
    noise = (-NOISES, NOISES)
    seen = {"without a fault": found.white[:, j]}
    caption = "What the healthy filter saw, in standard deviations of the noise."
    if found.size is None:
        stack = [Panel(f"innovation of {signals.output_names[j]}", "sd", seen, span=noise)]
    else:
        k = signals.fault_names.index(found.cause)
        online = decision.posterior.f[first : first + len(found.t), k]
        lasts = (found.t >= found.onset) & (found.t <= found.end)
        levels = {"online": online, "in hindsight": np.where(lasts, found.size, np.nan)}
        seen |= {"the fitted fault": found.fit[:, j]}
        caption = (
            "What the healthy filter saw and what the fault explains of it, in standard "
            "deviations of the noise; below, the fault."
        )
        stack = [
            Panel(f"innovation of {signals.output_names[j]}", "sd", seen, span=noise),
            Panel(found.cause, signals.faults[k].unit, levels),
        ]
    if np.isclose(np.nanmax(np.abs(seen["without a fault"]), initial=0.0), FAR):
        caption += f" What lies beyond {FAR:g} of them is cut off there."
    return panels(
        found.t,
        stack,
        title=f"In hindsight: {NAMES.get(found.cause, found.cause)}, run {found.run}",
        caption=caption,
        clock=decision.run.clock,
    )


def _onset(found: Retrospect, clock: Clock | None) -> tuple[Figure, ...]:
    """The posterior of the onset, near it; none of what is older than the window, nor where it is
    not what is told: what is undeclared may be as old as its alarm."""
    assert found.onset_lo is not None
    assert found.onset_hi is not None
    told = (found.onset, found.onset_lo, found.onset_hi)
    if found.onset_lo <= found.start or onset_over(found.t, found.density) != told:
        return ()
    room = AROUND * (found.onset_hi - found.onset_lo)
    near = (found.t >= found.onset_lo - room) & (found.t <= found.onset_hi + room)
    picture = panels(
        found.t[near],
        [Panel("probability per sample", "", {"posterior": found.density[near]})],
        title=f"Onset of {NAMES.get(found.cause, found.cause)}, run {found.run}",
        caption="How likely each sample is the first with the fault, as the whole log tells.",
        clock=clock,
    )
    return (picture,)
