"""What the bank was calibrated with: its alarm level, and what noise and model error hide."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.bank.knowledge import Knowledge
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.bank.uncertain_constants import constants_of, drifting_of, parameters_of
from faultgauge.detection.calibration.blocks import Block
from faultgauge.detection.posterior.uncalibrated import level_in
from faultgauge.detection.words import duration, number
from faultgauge.plants.disturbed import dynamic_states, following_inputs
from faultgauge.plants.model import Model
from faultgauge.plants.record import Interval
from faultgauge.plants.signals import Fault
from faultgauge.reporting import style
from faultgauge.reporting.report import Section, Table
from faultgauge.reporting.style import quantity
from faultgauge.reporting.svg import Figure, figure
from faultgauge.reporting.words.calibration import doubted

__all__ = [
    "calibration_section",
    "intervals_section",
    "knowledge_figure",
    "peaks_figure",
    "proof",
]

MOST_PANELS = 12  # a report is read, not scrolled
LOWEST = -30.0  # natural log-odds: what lies below is drawn there
FLAT = 1.1  # times the last standard deviation: from there on it is flat


def proof(model: Model) -> str:
    """What the healthy logs prove of the posterior's alarms."""
    bank = level_in(model)
    alarms = {0: "no alarm", 1: "1 alarm"}.get(bank.alarms, f"{bank.alarms} alarms")
    return (
        f"{alarms[0].upper()}{alarms[1:]} in {bank.blocks} healthy blocks "
        f"({duration(bank.judged_s)} in all) proves that false alarms come at most once in "
        f"{duration(bank.mtbfa_s)}, with 95 % confidence; an alarm begins where a fault is "
        f"{number(np.exp(min(bank.level, 100.0)))} times as likely as none."
    )


def calibration_section(bank: FaultBank, blocks: Sequence[Block] = ()) -> Section:
    """Proof, healthy `blocks` against the alarm level, and how well each fault can be known."""
    figures = (peaks_figure(blocks, bank.level),) if len(blocks) else ()
    return Section(
        "What the healthy log proves",
        (proof(bank.model), *_hidden(bank)),
        (_levels(bank.model, bank.noise),),
        (*figures, knowledge_figure(bank.knowledge, bank.model.plant.signals.faults)),
    )


def intervals_section(model: Model, channels: Mapping[str, Interval]) -> Section:
    """Of an observer alone: within what its healthy estimates lie."""
    units = {fault.name: fault.unit for fault in model.plant.signals.faults}
    rows = tuple(
        (name, quantity(each.interval, units.get(name, "1"))) for name, each in channels.items()
    )
    table = Table(("fault", "95 % of healthy estimates within"), rows)
    return Section("Healthy estimates", (), (table,))


def peaks_figure(blocks: Sequence[Block], level: float) -> Figure:
    """Draw the highest odds of a fault in every healthy block; `level` in log-odds."""
    peaks = np.exp(np.clip([block.peak for block in blocks], LOWEST, -LOWEST))
    with style.drawing():
        canvas, (axes,) = style.panels((2.4,))
        count = np.arange(1, len(peaks) + 1)
        axes.plot(count, peaks, "o", markersize=4.0, color=style.PREDICTED, label="healthy block")
        look = {"color": style.LIMIT, "linestyle": (0, (9, 2, 2, 2)), "linewidth": 1.0}
        axes.axhline(np.exp(min(level, -LOWEST)), label="alarm", **look)
        axes.set_yscale("log")
        style.plain_powers(axes.yaxis)
        axes.margins(x=0.03, y=0.1)
        axes.set_xlabel("block, in the order of the logs (number)")
        axes.set_ylabel(style.upright_label("highest odds of a fault", "to 1"))
        style.legend(axes)
        return figure(
            canvas,
            "Healthy blocks against the alarm level",
            "The highest odds of any fault, against none, in every block of the healthy logs. "
            "Dash-dotted: the odds from which on there is an alarm.",
        )


def knowledge_figure(known: Knowledge, faults: Sequence[Fault]) -> Figure:
    """Draw how well each of `faults` is known against the time since its onset."""
    shown = [k for k, fault in enumerate(faults) if fault.monitor != "disabled"][:MOST_PANELS]
    columns = min(len(shown), 2)
    rows = -(-len(shown) // columns)
    with style.drawing():
        canvas, axes = style.panels((2.3,) * rows, columns)
        for spare in axes[len(shown) :]:
            spare.remove()
        for panel, k in zip(axes, shown, strict=False):
            _known(panel, known, k, faults[k])
        return figure(
            canvas,
            "How well a fault is known by when",
            "Standard deviation of a fault against the time since it began, from noise, the "
            "model's own error and the constants' spread. Where a curve flattens out, the model's "
            "own error hides what is smaller, however long one waits.",
        )


def _known(axes: Axes, known: Knowledge, fault: int, declared: Fault) -> None:
    """One panel: sd against time, both logarithmic."""
    sd = known.sd[:, fault]
    seen = np.isfinite(sd)
    axes.set_xlabel(style.axis_label("time since onset", "s"))
    axes.set_ylabel(style.upright_label(declared.name, declared.unit))
    if not seen.any():
        axes.set_xticks([])
        axes.set_yticks([])
        axes.text(0.5, 0.5, "nothing shows", ha="center", va="center", transform=axes.transAxes)
        return
    axes.plot(known.t[seen], sd[seen], color=style.PREDICTED, linewidth=1.6)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(y=0.1)
    style.plain_powers(axes.xaxis)
    style.plain_powers(axes.yaxis)


def _hidden(bank: FaultBank) -> tuple[str, ...]:
    """A sentence for each fault: what stays hidden, and from when on waiting no longer helps."""
    told = []
    for k, fault in enumerate(bank.model.plant.signals.faults):
        sd = bank.knowledge.sd[:, k]
        if fault.monitor == "disabled":
            continue
        if not np.isfinite(sd).any():
            told.append(f"{fault.name}: does not show in what is measured.")
            continue
        last = float(sd[-1])
        flat = float(bank.knowledge.t[np.argmax(sd <= FLAT * last)])
        told.append(
            f"{fault.name} is known to {quantity(last, fault.unit)} (one standard deviation) "
            f"after {duration(float(bank.knowledge.t[-1]))}, and within {100 * (FLAT - 1):.0f} % "
            f"of that after {duration(flat)}."
        )
    return tuple(told)


def _levels(model: Model, noise: Noise) -> Table:
    """Every level that calibration found."""
    signals = model.plant.signals
    rows = [
        (f"noise of {each.name}", quantity(float(sigma), each.unit), "")
        for each, sigma in zip(signals.outputs, noise.sigma, strict=True)
    ]
    for k, place in enumerate(dynamic_states(model.plant)):
        state = signals.states[place]
        unit = f"{state.unit}/s" if state.unit else "1/s"
        rows.append(
            (
                f"the model's own error in d({state.name})",
                quantity(float(noise.size[k]), unit),
                f"lasts {quantity(float(noise.lasting[k]), 's')}",
            )
        )
    rows += _besides(model, noise)
    rows += [
        (f"drift of {name}", quantity(float(drift), "1"), "per root second")
        for name, drift in zip(drifting_of(model), noise.drift, strict=True)
    ]
    rows += [
        _between_runs(model, name, float(spread), float(shift))
        for name, spread, shift in zip(
            constants_of(model).names, noise.spread, noise.shift, strict=True
        )
    ]
    header = ("", "standard deviation", "")
    return Table(header, tuple(rows), "What calibration found.")


def _between_runs(model: Model, name: str, spread: float, shift: float) -> tuple[str, str, str]:
    """How far a constant, or a network as a whole, differs from run to run."""
    if name in (each.name for each in model.plant.gains):
        row = f"all of {name}, from run to run"
        return row, f"{100 * spread:.2f} %", f"mean is {1 + shift:.4g} times what was fitted"
    unit = parameters_of(model)[name].unit or "1"
    mean = f"mean differs from the fit by {quantity(shift, unit)}"
    return f"{name}, from run to run", quantity(spread, unit), mean


def _lacking(model: Model, noise: Noise) -> list[tuple[str, str, str]]:
    """Lags and curves that the file lacks."""
    signals = model.plant.signals
    rows = [
        (
            f"share of a change of {signals.inputs[j].name} that is missing at first",
            f"{-100 * noise.lean[j]:.2f} %",
            f"comes within {quantity(float(noise.leaning[j]), 's')}",
        )
        for j in noise.leans
    ]
    rows += [
        (
            f"{signals.outputs[j].name} follows what it measures",
            "",
            f"within {quantity(float(noise.trail[j]), 's')}",
        )
        for j in noise.trails
    ]
    rows += [
        (
            f"curve of {signals.inputs[j].name}",
            "",
            f"{100 * noise.bend[j]:+.2f} % of its range off a straight line in the middle",
        )
        for j in noise.bends
    ]
    rows += [
        (
            f"{constants_of(model).names[k]} varies within a run, too",
            "",
            f"lasts {quantity(float(noise.varying[k]), 's')}",
        )
        for k in noise.varies
    ]
    return rows


def _besides(model: Model, noise: Noise) -> list[tuple[str, str, str]]:
    """What inputs and outputs err by on their own."""
    signals = model.plant.signals
    rows = [
        (
            f"{signals.inputs[j].name} strays from what the log says by",
            quantity(float(noise.stray[j]), signals.inputs[j].unit),
            f"lasts {quantity(float(noise.straying[j]), 's')}",
        )
        for j in noise.strays
    ]
    rows += [
        (
            f"{state.name} sticks within {quantity(float(noise.slip[k]), state.unit)} of rest by",
            quantity(float(noise.grip[k]), f"{state.unit}/s" if state.unit else "1/s"),
            f"lasts {quantity(float(noise.gripping[k]), 's')}",
        )
        for k, state in ((k, signals.states[k]) for k in noise.grips)
    ]
    rows += _lacking(model, noise)
    for k, place in enumerate(following_inputs(model.plant)):
        rows.append(
            (
                f"share of a change of {signals.inputs[place].name} that comes late or not at all",
                f"{100 * noise.share[k]:.2f} %",
                f"for {quantity(float(noise.settling[k]), 's')}",
            )
        )
    rows += _of_outputs(model, noise)
    rows += [
        (f"where {where}, all this is larger by", f"{number(times, 2)} times", "")
        for where, times in doubted(model, noise)
    ]
    return rows


def _of_outputs(model: Model, noise: Noise) -> list[tuple[str, str, str]]:
    """What outputs err by on their own."""
    signals = model.plant.signals
    rows = [
        (
            f"{signals.outputs[j].name} wanders beside the model by",
            quantity(float(noise.wander[j]), signals.outputs[j].unit),
            f"lasts {quantity(float(noise.wandering[j]), 's')}",
        )
        for j in noise.wanders
    ]
    rows += [
        (
            f"zero of {signals.outputs[j].name} is off by",
            quantity(float(noise.zero[j]), signals.outputs[j].unit),
            "another way in each run",
        )
        for j in noise.zeros
    ]
    rows += [
        (
            f"samples of {signals.outputs[j].name} come too early or too late by",
            quantity(float(noise.jitter[j]), "s"),
            "another time each",
        )
        for j in noise.jitters
    ]
    rows += [
        (
            f"error in what a change of an input does to {signals.outputs[j].name}",
            f"{100 * noise.late[j]:.2f} %",
            f"for {quantity(float(noise.lag[j]), 's')}",
        )
        for j in noise.lags
    ]
    return rows
