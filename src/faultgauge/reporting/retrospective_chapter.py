"""The section of `estimate --smooth`: what the whole log tells, beside what was told then."""

from collections.abc import Sequence
from datetime import datetime

import numpy as np

from faultgauge.detection.bank import FaultBank
from faultgauge.detection.decisions import Decision
from faultgauge.detection.probability import probability
from faultgauge.detection.retrospective import HEALTHY, Retrospect, sentences
from faultgauge.detection.words import moment
from faultgauge.reporting.marks import NOISES
from faultgauge.reporting.report import Section, Table
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, curves, panels

__all__ = ["retrospective_section"]

MOST_FIGURES = 6
HEADER = ("run", "window [s]", "cause", "p", "began [s]", "size", "95 % interval", "told [s]")
AROUND = 2.0  # widths of the onset's interval that are shown on either side of it


def retrospective_section(
    bank: FaultBank, decisions: Sequence[Decision], found: Sequence[Retrospect]
) -> Section:
    """Sentences, a table of all windows, and the figures of those with a fault."""
    by_run = {each.run.name: each for each in decisions}
    figures = [
        picture
        for each in found
        if each.cause != HEALTHY
        for picture in (
            _fault(bank, by_run[each.run], each),
            _onset(each, by_run[each.run].run.clock),
        )
    ]
    clocks = [by_run[each.run].run.clock for each in found]
    clocked = any(clock is not None for clock in clocks)
    header = tuple(name.removesuffix(" [s]") if clocked else name for name in HEADER)
    rows = tuple(
        _row(each, clock, clocked=clocked) for each, clock in zip(found, clocks, strict=True)
    )
    table = Table(header, rows, "Every window, in hindsight.")
    return Section(
        "In hindsight",
        tuple(sentences(bank, found)),
        (table,),
        tuple(figures[:MOST_FIGURES]),
    )


def _row(found: Retrospect, clock: datetime | None, *, clocked: bool) -> tuple[str, ...]:
    began = found.onset is not None
    sized = found.size is not None
    told = found.told.start

    def at(t: float | None) -> str:
        return moment(clock, t or 0.0, 1.0) if clocked else f"{t:.6g}"

    return (
        found.run,
        f"{at(found.start)} to {at(found.end)}",
        found.cause,
        probability(found.p),
        f"{at(found.onset)} ({at(found.onset_lo)} to {at(found.onset_hi)})" if began else "",
        f"{found.size:.4g}" if sized else "",
        f"{found.lo:.4g} to {found.hi:.4g}" if sized else "",
        "" if told is None else at(told),
    )


def _fault(bank: FaultBank, decision: Decision, found: Retrospect) -> Figure:
    """Data with the fitted fault, and the fault as told online and in hindsight."""
    first = int(np.searchsorted(decision.run.t, found.t[0]))
    signals = bank.model.plant.signals
    j = int(np.argmax(np.abs(found.fit).sum(axis=0)))
    noise = (-NOISES, NOISES)
    seen = {"without a fault": found.white[:, j]}
    if found.size is None:
        stack = [Panel(f"innovation of {signals.output_names[j]}", "sd", seen, span=noise)]
    else:
        k = signals.fault_names.index(found.cause)
        online = decision.posterior.f[first : first + len(found.t), k]
        lasts = (found.t >= found.onset) & (found.t <= found.end)
        levels = {"online": online, "in hindsight": np.where(lasts, found.size, np.nan)}
        seen |= {"the fitted fault": found.fit[:, j]}
        stack = [
            Panel(f"innovation of {signals.output_names[j]}", "sd", seen, span=noise),
            Panel(found.cause, signals.faults[k].unit, levels),
        ]
    return panels(
        found.t,
        stack,
        title=f"In hindsight: {found.cause}, run {found.run}",
        caption="What the healthy filter saw and what the fault explains of it, in standard "
        "deviations of the noise; below, the fault.",
        clock=decision.run.clock,
    )


def _onset(found: Retrospect, clock: datetime | None) -> Figure:
    """The posterior of the onset, near it."""
    assert found.onset_lo is not None
    assert found.onset_hi is not None
    room = AROUND * (found.onset_hi - found.onset_lo)
    near = (found.t >= found.onset_lo - room) & (found.t <= found.onset_hi + room)
    return curves(
        found.t[near],
        {"posterior": found.density[near]},
        title=f"Onset of {found.cause}, run {found.run}",
        name="probability per sample",
        unit="",
        clock=clock,
    )
