"""Figures of a detectability sheet: size against delay, information along a log, pairs."""

import numpy as np
from matplotlib.axes import Axes

from faultgauge.detection.words import number
from faultgauge.foresight.result import FaultSheet, RunSheet
from faultgauge.reporting import marks, style
from faultgauge.reporting.svg import Figure, figure

__all__ = ["along_the_log", "left_by_window", "pairs_map", "size_by_delay"]

CELL = 0.55  # inches of a pair
DARK = 0.45  # share of information above which a cell is dark


def size_by_delay(fault: FaultSheet) -> Figure:
    """Draw the smallest size that would be named over the time since its onset, for each rate of
    false alarms, and the standard deviation of a constant fault's estimate."""
    seconds = np.array(fault.delay.seconds)
    with style.drawing():
        canvas, (axes,) = style.panels((2.9,))
        for look, (rarer, sizes) in zip(
            style.SERIES, sorted(fault.delay.sizes.items()), strict=False
        ):
            label = "named, as calibrated" if rarer == 1 else f"false alarms {rarer:g} times rarer"
            axes.plot(seconds, _curve(sizes), label=label, **look)
        axes.plot(seconds, _curve(fault.delay.seen), label="seen, as calibrated", **style.SERIES[3])
        sd = _curve(fault.delay.sd)
        axes.plot(seconds, sd, color=style.MEASURED, linewidth=1.2, label="standard deviation")
        if fault.levels_off is not None:
            axes.axvline(fault.levels_off, color=style.GREY, linewidth=1.0, linestyle=(0, (1, 1.5)))
        _logarithmic(axes, [sd, *(_curve(each) for each in fault.delay.sizes.values())])
        axes.set_xlabel(style.axis_label("time since the onset", "s"))
        axes.set_ylabel(style.upright_label(f"size of {fault.name}", fault.unit))
        style.legend(axes)
        caption = (
            "From the middle of the log on: seen is what would raise an alarm, named what would be "
            "told from the other faults, too. A curve begins where the largest fault would be."
        )
        if fault.levels_off is not None:
            caption += " Dotted: from here on the estimate gets hardly better."
        return figure(canvas, f"{style.short(fault.name)}: size against delay", caption)


def along_the_log(fault: FaultSheet) -> Figure:
    """Draw where in the log the information on a fault lies, for onsets along it."""
    t = np.array(fault.times)
    information = np.array(fault.information)
    with style.drawing():
        canvas, (axes,) = style.panels((2.4,))
        for n, J in enumerate(information):
            shown = np.where(t >= fault.onsets[n], J, np.nan)
            look = {"color": style.PREDICTED, "linewidth": 1.6} if n == 0 else {}
            marks.line(axes, t, shown, **({"color": style.MEASURED, "linewidth": 1.0} | look))
        axes.set_ylabel(style.upright_label("information", _inverse(fault.unit)))
        marks.time_below(axes, t)
        caption = (
            "Fisher information about its size, added up from each of some onsets on (the first in "
            "blue): where a curve rises the log tells, where it is flat it does not."
        )
        return figure(canvas, f"{style.short(fault.name)} along the log", caption)


def left_by_window(run: RunSheet, fault: FaultSheet) -> Figure:
    """Draw the information about a fault over the time since its onset: alone, and what is left of
    it beside each of the faults that hide most."""
    mine = [pair for pair in run.pairs if pair.fault == fault.name]
    worst = sorted(mine, key=lambda pair: pair.share)[: len(style.SERIES)]
    seconds, sd = np.array(fault.delay.seconds), _curve(fault.delay.sd)
    with style.drawing():
        canvas, (axes,) = style.panels((2.6,))
        axes.plot(seconds, sd**-2.0, color=style.MEASURED, linewidth=2.4, label="alone")
        curves = [np.array(pair.left) for pair in worst]
        for look, pair, left in zip(style.SERIES, worst, curves, strict=False):
            known = np.where(left > 0, left, np.nan)
            axes.plot(seconds, known, label=f"beside {style.short(pair.other)}", **look)
        _logarithmic(axes, [sd**-2.0, *curves])
        axes.set_xlabel(style.axis_label("time since the onset", "s"))
        axes.set_ylabel(style.upright_label("information", _inverse(fault.unit)))
        style.legend(axes)
        caption = (
            "Fisher information about its size: half of it, times the size squared, is the "
            "Kullback-Leibler divergence from no fault, and from the other at its most alike."
        )
        return figure(canvas, f"{style.short(fault.name)} beside others", caption)


def pairs_map(run: RunSheet) -> Figure:
    """Draw for every pair the share of the information that is left beside the other one."""
    names = [each.name for each in run.faults]
    with style.drawing():
        canvas, (axes,) = style.panels((1.6 + CELL * len(names),))
        share = np.full((len(names), len(names)), np.nan)
        for pair in run.pairs:
            share[names.index(pair.fault), names.index(pair.other)] = 100 * pair.share
        marks.cells(axes, share)
        for pair in run.pairs:
            row, column = names.index(pair.fault), names.index(pair.other)
            text = f"{number(100 * pair.share, 2)} %{'' if pair.structural else ' *'}"
            color = "#ffffff" if pair.share > DARK else style.INK
            axes.text(column, row, text, ha="center", va="center", color=color, fontsize=8)
        axes.set_xticks(range(len(names)), [style.short(each) for each in names], rotation=25)
        axes.set_yticks(range(len(names)), [style.short(each) for each in names])
        axes.set_xlabel("beside this fault")
        axes.set_ylabel("information left about")
        caption = (
            "Of what the log tells about each fault (rows), the share that is left where another "
            "one (columns) may be there, of any size, from any onset nearby. *: the equations "
            "alone do not tell them apart; that they are constant, and how the inputs move, may."
        )
        return figure(canvas, "Told apart", caption)


def _curve(sizes: tuple[float | None, ...]) -> np.ndarray:
    return np.array([np.nan if each is None else each for each in sizes], float)


def _inverse(unit: str) -> str:
    """The unit of an information."""
    plain = unit if unit.isalpha() else f"({unit})"
    return "" if unit in ("", "1") else f"1/{plain}**2"


def _logarithmic(axes: Axes, curves: list[np.ndarray]) -> None:
    axes.set_xscale("log")
    if any(np.any(np.isfinite(each) & (each > 0)) for each in curves):
        axes.set_yscale("log")
        style.plain_powers(axes.yaxis)
    style.plain_powers(axes.xaxis)
