"""Figures of a rehearsal: what was found, how well it was sized and when it was told, by size."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes

from faultgauge.rehearsal.result import NEAR, FaultResult, Figures, Trial
from faultgauge.rehearsal.shares import Share
from faultgauge.reporting import style
from faultgauge.reporting.svg import Figure, figure

__all__ = ["against_sheet", "by_size"]

MARKS = ("o", "s")


def by_size(fault: FaultResult, trials: Sequence[Trial]) -> Figure:
    """Draw over the size: the shares that were found and named exactly with their 95 % intervals,
    the estimates' errors, and the delays.

    Args:
        fault: the figures of one fault, with at least one size.
        trials: those of this fault alone.
    """
    with style.drawing():
        canvas, (shares, errors, delays) = style.panels((2.7,), 3)
        _shares(shares, fault)
        answers = [trial.answers[0] for trial in trials if trial.found]
        _dots(errors, [(abs(e.size), 100 * e.error) for e in answers if e.error is not None])
        _medians(errors, fault.by_size, lambda row: row.error_median, 100.0)
        errors.set_ylabel(style.upright_label("size error", "%"))
        _dots(delays, [(abs(each.size), each.delay) for each in answers if each.delay is not None])
        _medians(delays, fault.by_size, lambda row: row.delay_median, 1.0)
        delays.set_ylabel(style.upright_label("told after", "s"))
        for axes in (shares, errors, delays):
            _size_axis(axes, fault)
            style.legend(axes)
        caption = (
            f"{len(trials)} logs with {style.short(fault.name)} in them. Bands and bars: 95 % "
            "intervals of the shares. Errors and delays are of what was named: each a dot, the "
            "line their medians. Dotted: the smallest size that the model foretells; solid, red: "
            "the size that was named in 90 % of the logs."
        )
        return figure(canvas, f"{style.short(fault.name)} by its size", caption)


def against_sheet(faults: Sequence[FaultResult]) -> Figure | None:
    """Draw the size that was named 90 % of the time over the one that the sheet foretells for 90 %
    of the onsets, each fault in its own unit; None where no fault has both."""
    known = [each for each in faults if each.ratio is not None and each.along and each.smallest]
    if not known:
        return None
    x = np.array([each.along for each in known], float)
    y = np.array([each.smallest.size for each in known if each.smallest], float)
    ends = np.array([min(x.min(), y.min()) / 3, 3 * max(x.max(), y.max())])
    with style.drawing():
        canvas, (axes,) = style.panels((4.2,))
        axes.plot(ends, ends, color=style.GREY, linewidth=0.8)
        for factor in (1 / NEAR, NEAR):
            axes.plot(ends, factor * ends, color=style.GREY, linewidth=0.8, linestyle=(0, (4, 3)))
        for fault, foretold, found in zip(known, x, y, strict=True):
            least = fault.smallest is not None and fault.smallest.at_most
            axes.plot(foretold, found, "v" if least else "o", color=style.PREDICTED, markersize=5)
            text = style.axis_label(fault.name, fault.unit)
            axes.annotate(text, (foretold, found), (7, -3), textcoords="offset points", fontsize=8)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlim(*ends)
        axes.set_ylim(*ends)
        for axis in (axes.xaxis, axes.yaxis):
            style.plain_powers(axis)
        axes.set_xlabel("foretold along the log, for 90 % of the onsets")
        axes.set_ylabel("named in 90 % of the logs")
        caption = (
            "Each fault in its own unit. Dashed: 1.5 times more and less. A triangle is the "
            "smallest size that was tried, which was named often enough already."
        )
        return figure(canvas, "Foretold and found", caption)


def _shares(axes: Axes, fault: FaultResult) -> None:
    sizes = np.array([row.size or np.nan for row in fault.by_size])
    _share(axes, sizes, [row.found for row in fault.by_size], "named", 0, banded=True)
    _share(axes, sizes, [row.exact for row in fault.by_size], "exactly", 1, banded=False)
    axes.axhline(90.0, color=style.GREY, linewidth=0.8)
    axes.set_ylim(-3.0, 103.0)
    axes.set_ylabel(style.upright_label("share of logs", "%"))


def _share(
    axes: Axes, sizes: np.ndarray, shares: Sequence[Share], label: str, k: int, *, banded: bool
) -> None:
    values, lo, hi = (
        100 * np.array([getattr(each, key) for each in shares]) for key in ("value", "lo", "hi")
    )
    if banded and len(sizes) > 1:
        axes.fill_between(sizes, lo, hi, color=style.BAND, linewidth=0.0)
    elif banded:
        axes.vlines(sizes, lo, hi, color=style.BAND, linewidth=4.0)
    look = style.SERIES[k]
    axes.plot(sizes, values, marker=MARKS[k], markersize=3.5, label=label, **look)


def _dots(axes: Axes, points: Sequence[tuple[float, float]]) -> None:
    if points:
        x, y = np.array(points).T
        axes.plot(x, y, "o", color=style.MEASURED, markersize=2.6, label="each")


def _medians(
    axes: Axes, rows: Sequence[Figures], of: Callable[[Figures], float | None], scale: float
) -> None:
    points = [(row.size, scale * value) for row in rows if (value := of(row)) is not None]
    if points:
        x, y = np.array(points, float).T
        axes.plot(x, y, marker=MARKS[0], markersize=3.5, label="median", **style.SERIES[0])
        axes.set_ylim(bottom=0.0)
    else:
        axes.text(0.5, 0.5, "never found", transform=axes.transAxes, ha="center", color=style.GREY)
        axes.set_yticks([])


def _size_axis(axes: Axes, fault: FaultResult) -> None:
    """A logarithmic axis over all sizes, with what is foretold and what was found."""
    sizes = [row.size for row in fault.by_size if row.size is not None]
    axes.set_xscale("log")
    room = 1.3 if len(sizes) > 1 else 4.0
    axes.set_xlim(min(sizes) / room, max(sizes) * room)
    if fault.predicted is not None:
        axes.axvline(fault.predicted, color=style.INK, linewidth=1.0, linestyle=(0, (1, 1.5)))
    if fault.smallest is not None and not fault.smallest.at_most:
        axes.axvline(fault.smallest.size, color=style.LIMIT, linewidth=1.0)
    style.plain_powers(axes.xaxis)
    axes.set_xlabel(style.axis_label(f"size of {fault.name}", fault.unit))
