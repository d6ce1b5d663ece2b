"""One run at a glance: outputs beside the healthy model, and every fault that was told."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes

from faultgauge.reporting import marks, style
from faultgauge.reporting.svg import Figure, figure
from faultgauge.reporting.time_figures import around
from faultgauge.telemetry.clock import Clock

__all__ = ["Compared", "ToldSpan", "overview"]

HEIGHT = 1.6  # of a panel, inches


class Compared(NamedTuple):
    """An output as `measured` and as the healthy model has it; `noise` is its standard deviation.
    NaN where there is no sample."""

    name: str
    unit: str
    measured: Float[np.ndarray, "samples"]
    healthy: Float[np.ndarray, "samples"]
    noise: float = 0.0


class ToldSpan(NamedTuple):
    """A fault that was told in the `spans` (s): its estimate with the 95 % band, the smallest size
    that would be told, and the truth where it is known."""

    name: str
    unit: str
    f: Float[np.ndarray, "samples"]
    lo: Float[np.ndarray, "samples"]
    hi: Float[np.ndarray, "samples"]
    spans: Sequence[tuple[float, float]]
    least: float = 0.0
    truth: Float[np.ndarray, "samples"] | None = None


def overview(
    t: Float[np.ndarray, "samples"],
    outputs: Sequence[Compared],
    told: Sequence[ToldSpan],
    *,
    run: str,
    spans: Sequence[tuple[float, float]] = (),
    alarms: Sequence[tuple[float, float]] = (),
    not_judged: Bool[np.ndarray, "samples"] | None = None,
    likely: Mapping[str, Float[np.ndarray, "samples"]] | None = None,
    clock: Clock | None = None,
    note: str = "",
    title: str = "",
) -> Figure:
    """Draw outputs, with the times of faults shaded, and below them what the faults are and how
    likely.

    Args:
        t: increasing time, s.
        outputs: one panel each.
        told: below them one panel each.
        run: the run's name.
        spans: when any fault was there, s.
        alarms: when there was an alarm without a name, s.
        not_judged: where nothing was judged; hatched in the panels of the faults, or where there
            are none in those of the outputs.
        likely: the probability of each cause, in a last panel.
        clock: that of the log, where it has one.
        note: a sentence behind the caption.
        title: of the figure, "Run ... at a glance" where it is left out.
    """
    likely = likely or {}
    hidden = np.zeros(t.shape, dtype=bool) if not_judged is None else not_judged
    with style.drawing():
        heights = (HEIGHT,) * (len(outputs) + len(told) + bool(likely))
        canvas, rows = style.panels(heights, share_time=True)
        gone = []
        for axes, each in zip(rows, outputs, strict=False):
            marks.shade(axes, t, spans, color=style.EVENT, label="event")
            marks.shade(axes, t, alarms, color=style.ALARM, label="alarm, no name")
            if not told:
                marks.hatch(axes, t, hidden, label="not judged")
            if _draw_output(axes, t, each):
                gone.append(style.short(each.name))
            if axes is rows[0]:
                style.legend(axes)
        for axes, each in zip(rows[len(outputs) :], told, strict=False):
            _draw_told(axes, t, each, hidden)
            if each is told[0]:
                style.legend(axes)
        if likely:
            _draw_likely(rows[-1], t, likely)
        if gone:
            note = f"The healthy model runs out of the picture of {', '.join(gone)}. {note}"
        marks.time_below(rows[-1], t, clock)
        title = title or f"Run {style.short(run)} at a glance"
        return figure(canvas, title, _caption(told, spans, alarms, bool(likely), note))


def _draw_output(axes: Axes, t: Float[np.ndarray, "samples"], each: Compared) -> bool:
    """Whether the healthy model runs out of the picture: one that diverges must not make a line of
    what was measured."""
    marks.line(axes, t, each.measured, color=style.MEASURED, linewidth=2.8, label="measured")
    marks.line(axes, t, each.healthy, color=style.PREDICTED, linewidth=1.2, label="healthy model")
    seen = each.measured[np.isfinite(each.measured)]
    far = float(np.ptp(seen)) if seen.size else 0.0
    low, high = around(each.measured, each.noise)
    near = np.clip(each.healthy, low - 1.5 * far, high + 1.5 * far)
    marks.look_at(axes, seen, near)
    marks.show_at_least(axes, low, high)
    axes.set_ylabel(style.upright_label(each.name, each.unit, 17))
    return bool(np.nanmax(np.abs(each.healthy - near), initial=0.0) > 0.0)


def _draw_told(
    axes: Axes,
    t: Float[np.ndarray, "samples"],
    each: ToldSpan,
    hidden: Bool[np.ndarray, "samples"],
) -> None:
    marks.shade(axes, t, each.spans, color=style.EVENT, label="event")
    marks.hatch(axes, t, hidden, label="not judged")
    marks.band(axes, t, each.lo, each.hi, label="95 % band")
    axes.axhline(0.0, color=style.GREY, linewidth=0.8)
    marks.line(axes, t, each.f, color=style.PREDICTED, linewidth=1.4, label="estimate")
    values = list[np.ndarray]()
    if each.truth is not None:
        marks.line(axes, t, each.truth, label="truth", **style.TRUTH)
        values.append(each.truth)
    marks.look_at_estimate(axes, each.f, each.lo, each.hi, ~hidden, *values)
    marks.show_at_least(axes, -each.least, each.least)
    axes.set_ylabel(style.upright_label(each.name, each.unit, 17))


def _draw_likely(
    axes: Axes,
    t: Float[np.ndarray, "samples"],
    likely: Mapping[str, Float[np.ndarray, "samples"]],
) -> None:
    for look, (cause, p) in zip(style.SERIES, likely.items(), strict=False):
        marks.line(axes, t, p, label=style.short(cause), **look)
    marks.show_at_least(axes, 0.0, 1.0)
    axes.set_ylabel("probability")
    style.legend(axes)


def _caption(
    told: Sequence[ToldSpan],
    spans: Sequence[tuple[float, float]],
    alarms: Sequence[tuple[float, float]],
    likely: bool,
    note: str,
) -> str:
    parts = ["Measured, and what the healthy model gives for the same inputs."]
    if spans:
        parts.append("Shaded: from when a fault began to when it was last seen.")
    if told:
        parts.append("Below: each fault that was told, or may be an alarm's cause; 95 % band.")
    elif not spans and not alarms:
        parts.append("No fault was told.")
    if alarms:
        parts.append("In grey: an alarm for which no fault was named.")
    if likely:
        parts.append("Last: how likely each cause is.")
    return " ".join([*parts, note]).strip()
