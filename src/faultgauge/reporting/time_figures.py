"""Figures over time: free run, residual, several curves in one panel, fault estimate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.reporting import marks, style
from faultgauge.reporting.svg import Figure, figure
from faultgauge.telemetry.clock import Clock

__all__ = ["Panel", "around", "curves", "fault_estimate", "free_run", "panels", "residual"]


@dataclass(frozen=True)
class Panel:
    """One panel of `panels`: curves of one quantity by their name in the legend; its vertical axis
    shows `span` (low, high) at least."""

    name: str
    unit: str
    values: Mapping[str, Float[np.ndarray, "samples"]]
    truth: Float[np.ndarray, "samples"] | None = None
    truth_name: str = "truth"
    span: tuple[float, float] | None = None


def free_run(
    t: Float[np.ndarray, "samples"],
    measured: Float[np.ndarray, "samples"],
    predicted: Float[np.ndarray, "samples"],
    *,
    name: str,
    unit: str,
    run: str,
    warmup: int = 0,
    noise: float = 0.0,
    clock: Clock | None = None,
) -> Figure:
    """Draw an output and the model's pure simulation of it; below, their difference.

    Args:
        t: increasing time, s.
        measured: the output y, `unit`; NaN where it was not sampled.
        predicted: the free run yhat, `unit`.
        name: the output's name.
        unit: its unit as declared.
        run: the run's name.
        warmup: this many first samples, which found the initial state and are not scored, are
            shaded.
        noise: its standard deviation in the output, `unit`; an axis spans five of them at least
            on either side.
        clock: that of the log, where it has one.
    """
    with style.drawing():
        canvas, (top, bottom) = style.panels((2.3, 1.5), share_time=True)
        marks.line(top, t, measured, color=style.MEASURED, linewidth=2.8, label="measured")
        marks.line(top, t, predicted, color=style.PREDICTED, linewidth=1.2, label="free run")
        bottom.axhline(0.0, color=style.GREY, linewidth=0.8)
        marks.line(bottom, t, measured - predicted, color=style.PREDICTED, linewidth=0.8)
        if warmup > 0:
            span = (float(t[0]), float(t[min(warmup, t.size - 1)]))
            for axes in (top, bottom):
                marks.shade(axes, t, [span], color=style.BLANK, label="warm-up, not scored")
        top.set_ylabel(style.upright_label(name, unit))
        bottom.set_ylabel(style.upright_label("residual", unit, width=14))
        style.legend(top)
        marks.time_below(bottom, t, clock)
        caption = (
            "Above: what was measured, and what the model makes of the inputs alone. "
            "Below: the residual, measured minus model."
        )
        if _diverges(measured, predicted):
            seen = measured[np.isfinite(measured)]
            marks.look_at(top, seen, seen + np.ptp(seen), seen - np.ptp(seen))
            marks.look_at(bottom, np.ptp(seen) * np.array([-1.5, 1.5]))
            caption += " The free run leaves the picture: it diverges."
        marks.show_at_least(top, *around(measured, noise))
        marks.show_at_least(bottom, *around(np.zeros(1), noise))
        return figure(canvas, f"Free run of {style.short(name)}, {style.short(run)}", caption)


def residual(
    t: Float[np.ndarray, "samples"],
    r: Float[np.ndarray, "samples"],
    *,
    limit: float | None = None,
    name: str,
    unit: str,
    reference: str,
    noise: float = 0.0,
    clock: Clock | None = None,
) -> Figure:
    """Draw the residual r = y - yhat of one output, with the limits of its healthy range.

    Args:
        t: increasing time, s.
        r: residual, `unit`; NaN where there is none.
        limit: r leaves its healthy range beyond plus or minus this, `unit`.
        name: the output's name.
        unit: its unit as declared.
        reference: what the healthy reference is driven by, a few words.
        noise: its standard deviation in the output, `unit`; the axis spans five of them at least
            on either side.
        clock: that of the log, where it has one.
    """
    with style.drawing():
        canvas, (axes,) = style.panels((2.1,))
        marks.line(axes, t, r, color=style.PREDICTED, linewidth=0.8, label="residual")
        marks.limits(axes, limit)
        marks.show_at_least(axes, *around(np.zeros(1), noise))
        axes.set_ylabel(style.upright_label("residual", unit))
        style.legend(axes)
        marks.time_below(axes, t, clock)
        caption = f"Measured minus healthy reference ({style.short(reference)})."
        if limit is not None:
            caption += (
                f" Dash-dotted: the limits of the healthy range, ±{style.quantity(limit, unit)}."
            )
        return figure(canvas, f"Residual of {style.short(name)}", caption)


def curves(
    t: Float[np.ndarray, "samples"],
    values: Mapping[str, Float[np.ndarray, "samples"]],
    *,
    title: str,
    name: str,
    unit: str,
    truth: Float[np.ndarray, "samples"] | None = None,
    truth_name: str = "truth",
    clock: Clock | None = None,
) -> Figure:
    """Draw several curves of one quantity in one panel: residuals or estimates side by side.

    Args:
        t: increasing time, s.
        values: curve by its name in the legend, `unit`; at most eight, of which four read well.
        title: what is compared, a few words.
        name: the quantity.
        unit: its unit as declared.
        truth: what the curves are to be compared with, `unit`; drawn dashed on top.
        truth_name: its name in the legend.
        clock: that of the log, where it has one.
    """
    panel = Panel(name, unit, values, truth, truth_name)
    caption = "" if truth is None else f"Dashed, on top: {style.short(truth_name)}."
    return panels(t, [panel], title=title, caption=caption, clock=clock)


def panels(
    t: Float[np.ndarray, "samples"],
    stack: Sequence[Panel],
    *,
    title: str,
    caption: str = "",
    clock: Clock | None = None,
) -> Figure:
    """Draw panels (a), (b), ... above each other over one time axis.

    Args:
        t: increasing time, s.
        stack: what each panel shows; at most eight curves in one, of which four read well.
        title: what is shown, a few words.
        caption: what to see in it.
        clock: that of the log, where it has one.
    """
    height = 2.8 if len(stack) == 1 else 1.9
    with style.drawing():
        canvas, rows = style.panels((height,) * len(stack), share_time=True)
        for letter, axes, panel in zip("abcdefgh", rows, stack, strict=False):
            looks = style.SERIES[: len(panel.values)]
            for look, (label, y) in zip(looks, panel.values.items(), strict=True):
                marks.line(axes, t, y, label=style.short(label), **look)
            if panel.truth is not None:
                marks.line(axes, t, panel.truth, label=style.short(panel.truth_name), **style.TRUTH)
            if panel.span is not None:
                marks.show_at_least(axes, *panel.span)
            width = 24 if len(stack) == 1 else 17
            axes.set_ylabel(style.upright_label(panel.name, panel.unit, width))
            style.legend(axes)
            if len(stack) > 1:
                axes.set_title(f"({letter})", loc="left")
        marks.time_below(rows[-1], t, clock)
        return figure(canvas, title, caption)


def fault_estimate(
    t: Float[np.ndarray, "samples"],
    f: Float[np.ndarray, "samples"],
    lo: Float[np.ndarray, "samples"],
    hi: Float[np.ndarray, "samples"],
    *,
    limit: float | None,
    name: str,
    unit: str,
    truth: Float[np.ndarray, "samples"] | None = None,
    events: Sequence[tuple[float, float]] = (),
    not_judged: Bool[np.ndarray, "samples"] | None = None,
    probable: bool = False,
    least: float = 0.0,
    clock: Clock | None = None,
) -> Figure:
    """Draw a fault estimate with its 95 % band, limits and events.

    Args:
        t: increasing time, s.
        f: estimate, `unit`; NaN where there is none.
        lo: lower end of the 95 % band, `unit`.
        hi: upper end, `unit`.
        limit: the smallest size called a fault, either sign, `unit`; None where there is none.
        name: the fault's name.
        unit: its unit as declared.
        truth: the injected fault where it is known, `unit`.
        events: start and end, s, of each fault found; an end of infinity is still open.
        not_judged: where nothing was judged; hatched, and left out of the vertical range.
        probable: judged by probabilities, which need no limit.
        least: the smallest size that would be told, `unit`; the axis spans it at least, either way.
        clock: that of the log, where it has one.
    """
    hidden = np.zeros(t.shape, dtype=bool) if not_judged is None else not_judged
    seen = ~hidden if not hidden.all() else hidden
    with style.drawing():
        canvas, (axes,) = style.panels((2.9,))
        marks.shade(axes, t, events, color=style.EVENT, label="event")
        marks.hatch(axes, t, hidden, label="not judged")
        marks.band(axes, t, lo, hi, label="95 % band")
        marks.line(axes, t, f, color=style.PREDICTED, linewidth=1.4, label="estimate")
        values = list[np.ndarray]()
        if limit is not None:
            marks.limits(axes, limit)
            values.append(np.array([-limit, limit]))
        if truth is not None:
            marks.line(axes, t, truth, label="truth", **style.TRUTH)
            values.append(truth)
        marks.look_at_estimate(axes, f, lo, hi, seen, *values)
        marks.show_at_least(axes, -least, least)
        axes.set_ylabel(style.upright_label(name, unit))
        style.legend(axes)
        marks.time_below(axes, t, clock)
        caption = _estimate_caption(
            limit, unit, truth is not None, len(events), bool(hidden.any()), probable
        )
        return figure(canvas, f"Estimated fault: {style.short(name)}", caption)


def around(values: Float[np.ndarray, "samples"], noise: float) -> tuple[float, float]:
    """What an axis of `values` shows at least: five times their `noise` on either side of their
    middle."""
    seen = values[np.isfinite(values)]
    middle = float(seen.min() + seen.max()) / 2 if seen.size else 0.0
    return middle - marks.NOISES * noise, middle + marks.NOISES * noise


def _diverges(
    measured: Float[np.ndarray, "samples"], predicted: Float[np.ndarray, "samples"]
) -> bool:
    """Whether the free run leaves what was measured by more than three times its range."""
    seen = measured[np.isfinite(measured)]
    far = 3.0 * np.ptp(seen) if seen.size else 0.0
    if far == 0.0:
        return False
    return bool(((predicted > seen.max() + far) | (predicted < seen.min() - far)).any())


def _estimate_caption(
    limit: float | None, unit: str, truth: bool, events: int, hidden: bool, probable: bool
) -> str:
    parts = ["Estimate and 95 % band."]
    if limit is None and not probable:
        parts.append("Not calibrated, so there is no limit to judge by.")
    if limit is not None:
        parts.append(f"Dash-dotted: the limits, ±{style.quantity(limit, unit)}.")
    if events:
        shaded = "the event" if events == 1 else f"{events} events"
        parts.append(f"Shaded: {shaded}, from the onset to when the fault was last seen.")
    if hidden:
        parts.append("Hatched: not judged.")
    if truth:
        parts.append("Dashed: the fault that was injected.")
    return " ".join(parts)
