"""Figures of a campaign: alarms by their level, what was missed, who was named, how honestly."""

import numpy as np
from matplotlib.axes import Axes

from faultgauge.campaigns.result import Campaign, Curve, KindResult
from faultgauge.rehearsal.shares import Rate
from faultgauge.reporting import marks, style
from faultgauge.reporting.svg import Figure, figure

__all__ = ["delay_by_rate", "detection_by_rate", "isolation_map", "missed", "reliability"]

CELL, LEAST_HEIGHT = 0.42, 2.4  # inches of a kind
DARK = 0.55  # of a row's runs: above it a cell is dark
FLOOR = 0.3  # of the least rate that could be shown: where none was seen


def detection_by_rate(campaign: Campaign) -> Figure:
    """Draw the share of runs with an alarm over the rate of false alarms, by the alarm's level."""
    rates, bounds = _rates(campaign.false)
    with style.drawing():
        canvas, (axes,) = style.panels((3.4,))
        whole, *each = campaign.curves
        value, lo, hi = _shares(whole)
        axes.fill_between(rates, lo, hi, color=style.BAND, linewidth=0.0, label="95 %")
        axes.hlines(value, *bounds, color=style.MEASURED, linewidth=0.8)
        _by_kind(axes, [(c.name, rates, _shares(c)[0]) for c in (whole, *each)])
        _rate_axis(axes, campaign)
        axes.set_xlabel(style.axis_label("false alarms", "1/h"))
        axes.set_ylim(-3.0, 103.0)
        axes.set_ylabel(style.upright_label("runs with an alarm", "%"))
        style.legend(axes)
        caption = (
            "From right to left the level at which an alarm begins rises. Band: 95 % intervals "
            "over all runs; lines across: those of the rate, from the runs without a fault and the "
            "time before onsets. Red: what calibration allows; a level without a false alarm is "
            "shown at a third of one."
        )
        return figure(canvas, "Detection against false alarms", caption)


def delay_by_rate(campaign: Campaign) -> Figure:
    """Draw the median time until an alarm over the mean time between false alarms."""
    rates, _ = _rates(campaign.false)
    with style.drawing():
        canvas, (axes,) = style.panels((3.2,))
        whole = campaign.curves[0]
        lo, hi = ([getattr(f, end) for f in whole.delay] for end in ("lo", "hi"))
        ends = np.array([[np.nan if v is None else v for v in each] for each in (lo, hi)], float)
        axes.fill_between(1 / rates, *ends, color=style.BAND, linewidth=0.0, label="95 %")
        _by_kind(axes, [(c.name, 1 / rates, _delays(c)) for c in campaign.curves])
        _rate_axis(axes, campaign, inverse=True)
        axes.set_xlabel(style.axis_label("mean time between false alarms", "h"))
        axes.set_yscale("log")
        style.plain_powers(axes.yaxis)
        axes.set_ylabel(style.upright_label("median time to the alarm", "s"))
        style.legend(axes)
        caption = (
            "Medians over all runs with a fault, of those without an alarm, too; a curve ends "
            "where more than half of them have none. Band: of drawing runs anew. Red: what "
            "calibration allows."
        )
        return figure(canvas, "Delay against false alarms", caption)


def missed(campaign: Campaign) -> Figure | None:
    """Draw the share of runs in which a fault was not named over its size; None where no kind has
    sizes that were foretold."""
    drawn = [each for each in campaign.kinds if each.faults.by_size and each.faults.predicted]
    if not drawn:
        return None
    with style.drawing():
        canvas, (axes,) = style.panels((3.2,))
        curves = [(k.faults.name, *_missed(k)) for k in drawn]
        _by_kind(axes, curves)
        axes.axvline(1.0, color=style.INK, linewidth=1.0, linestyle=(0, (1, 1.5)))
        axes.axhline(10.0, color=style.GREY, linewidth=0.8)
        axes.set_xscale("log")
        style.plain_powers(axes.xaxis)
        axes.set_xlabel("size over the smallest that was foretold (median of the runs)")
        axes.set_ylim(-3.0, 103.0)
        axes.set_ylabel(style.upright_label("not named", "%"))
        style.legend(axes)
        caption = (
            "Of each kind, by its size; the intervals stand in the tables below. Dotted: from here "
            "on 9 in 10 were foretold to be named, which the grey line is."
        )
        return figure(canvas, "Missed, by size", caption)


def isolation_map(campaign: Campaign) -> Figure:
    """Draw which answer the runs of each kind got."""
    table = campaign.isolation
    counts = np.array(table.counts, float)
    used = np.flatnonzero(counts.sum(axis=0))
    answers = [table.answers[k] for k in used]
    counts = counts[:, used]
    share = 100 * counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    with style.drawing():
        canvas, (axes,) = style.panels((max(LEAST_HEIGHT, 1.4 + CELL * len(table.kinds)),))
        marks.cells(axes, share)
        for (row, column), count in np.ndenumerate(counts):
            if count:
                color = "#ffffff" if share[row, column] > 100 * DARK else style.INK
                place = {"ha": "center", "va": "center", "fontsize": 8}
                axes.text(column, row, f"{int(count)}", color=color, **place)
        axes.set_xticks(range(len(answers)), [style.short(each) for each in answers], rotation=30)
        axes.set_yticks(range(len(table.kinds)), [style.short(each) for each in table.kinds])
        axes.set_xlabel("what was answered")
        axes.set_ylabel("what was put in")
        caption = (
            "Runs by what was named in them: one fault, something undeclared (unknown), both of a "
            "pair, or both names that are right, several others; undecided: an alarm without a "
            "name. The darker, the larger the share of the row."
        )
        return figure(canvas, "What was named", caption)


def reliability(campaign: Campaign) -> Figure:
    """Draw how often it was so over the probability that was told."""
    bins = [each for each in campaign.reliability if each.said is not None]
    with style.drawing():
        canvas, (axes,) = style.panels((3.4,))
        x = 100 * np.array([each.said for each in bins], float)
        y, lo, hi = (
            100 * np.array([getattr(each.share, key) for each in bins], float)
            for key in ("value", "lo", "hi")
        )
        axes.plot([0, 100], [0, 100], color=style.GREY, linewidth=0.8)
        axes.vlines(x, lo, hi, color=style.BAND, linewidth=4.0)
        axes.plot(x, y, marker="o", markersize=3.5, label="all causes", **style.SERIES[0])
        axes.set_xlim(-2.0, 102.0)
        axes.set_ylim(-3.0, 103.0)
        axes.set_xlabel(style.axis_label("probability that was told", "%"))
        axes.set_ylabel(style.upright_label("how often it was so", "%"))
        caption = (
            "Every cause and health, at the last judged row at which the faults act, by their "
            "probability. Bars: 95 % intervals, which take causes of one run as independent."
        )
        return figure(canvas, "Probabilities", caption)


def _rates(false: tuple[Rate, ...]) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """(rates [1/h], their intervals); where there was no alarm, a third of one."""
    least = FLOOR / max(max((each.hours for each in false), default=0.0), 1e-9)
    ends = (np.array([getattr(each, key) for each in false], float) for key in ("lo", "hi"))
    lo, hi = (np.maximum(each, least) for each in ends)
    return np.maximum(np.array([each.value for each in false], float), least), (lo, hi)


def _shares(curve: Curve) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    value, lo, hi = (
        100 * np.array([getattr(each, key) for each in curve.detected], float)
        for key in ("value", "lo", "hi")
    )
    return value, lo, hi


def _delays(curve: Curve) -> np.ndarray:
    # what is there at once is drawn at the least that a logarithmic axis shows
    return np.array([np.nan if f.value is None else max(f.value, 1e-3) for f in curve.delay])


def _missed(kind: KindResult) -> tuple[np.ndarray, np.ndarray]:
    rows = kind.faults.by_size
    sizes = np.array([row.size for row in rows], float) / (kind.faults.predicted or np.nan)
    return sizes, 100 - 100 * np.array([row.found.value for row in rows], float)


def _by_kind(axes: Axes, curves: list[tuple[str, np.ndarray, np.ndarray]]) -> None:
    """As many as can be told apart."""
    for look, (name, x, y) in zip(style.SERIES, curves, strict=False):
        axes.plot(x, y, marker="o", markersize=3.0, label=style.short(name), **look)


def _rate_axis(axes: Axes, campaign: Campaign, *, inverse: bool = False) -> None:
    allowed = campaign.calibrated_rate
    axes.axvline(1 / allowed if inverse else allowed, color=style.LIMIT, linewidth=1.0)
    axes.set_xscale("log")
    style.plain_powers(axes.xaxis)
