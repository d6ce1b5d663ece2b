"""Figures of a validation: error with its band, residual tests, error against operating point."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from faultgauge.identification.validation.band import Band
from faultgauge.identification.validation.correlation import InputTest, ResidualTest
from faultgauge.identification.validation.operating import Profile
from faultgauge.identification.validation.ranges import Range
from faultgauge.reporting import marks, style
from faultgauge.reporting.svg import Figure, figure
from faultgauge.reporting.thinning import thin

__all__ = ["correlations", "error_band", "operating_points", "ranges"]

MOST_RUNS = 20  # drawn
MOST_PANELS = 8  # above each other
FAMILY = {"color": style.LIMIT, "linestyle": (0, (9, 2, 2, 2)), "linewidth": 1.0}


def error_band(
    times: Sequence[Float[np.ndarray, "_"]],
    errors: Sequence[Float[np.ndarray, "_"]],
    band: Band,
    *,
    name: str,
    unit: str,
) -> Figure:
    """Draw the free-run error of every run over the time since its start, in its band.

    Args:
        times: s since the start of each run.
        errors: measured minus free run, `unit`.
        band: its 95 % band.
        name: the output's name.
        unit: its unit as declared.
    """
    span = np.concatenate([times[0][:1], *(t[-1:] for t in times), band.edges_s])
    scale, _ = style.time_axis(span)
    shown = range(min(len(times), MOST_RUNS))
    with style.drawing():
        canvas, (axes,) = style.panels((2.5,))
        edges = band.edges_s / scale
        width = np.append(band.half_width, band.half_width[-1])
        label = f"{100 * band.level:.0f} % band"
        axes.fill_between(edges, -width, width, step="post", color=style.BAND, label=label)
        for sign in (-1.0, 1.0):
            axes.step(edges, sign * width, where="post", color=style.PREDICTED, linewidth=1.2)
        for k in shown:
            t, e = thin(times[k], errors[k], style.BINS // len(shown))
            look = {"color": style.INK, "linewidth": 0.8 if len(shown) < 4 else 0.5}
            axes.plot(t / scale, e, label="error" if k == 0 else None, **look)
        axes.set_ylabel(style.upright_label(f"error of {name}", unit))
        style.legend(axes)
        marks.time_below(axes, np.array([0.0, span.max()]))
        axes.set_xlabel(axes.get_xlabel().replace("time", "time since the start of the run"))
        caption = (
            "Measured minus free run, and the band that it should stay in. Held against a band "
            f"from {band.held_against}, {100 * band.share_inside:.1f} % of the samples were inside "
            f"(95 % interval {100 * band.low:.0f} % to {100 * band.high:.0f} %)."
        )
        if len(times) > MOST_RUNS:
            caption += f" The first {MOST_RUNS} of {len(times)} runs are drawn."
        return figure(canvas, f"Free-run error of {style.short(name)}", caption)


def correlations(residual: ResidualTest, inputs: Sequence[InputTest], *, name: str) -> Figure:
    """Draw the residual's correlation with itself and with each input, with what chance allows.

    Args:
        residual: the whiteness test.
        inputs: the test against every input; the first seven are drawn.
        name: the output's name.
    """
    drawn = inputs[: MOST_PANELS - 1]
    with style.drawing():
        canvas, axes = _grid(1 + len(drawn))
        _correlation(axes[0], residual.lags_s, residual.correlation, residual)
        axes[0].set_ylabel(style.upright_label("autocorrelation", "1"))
        style.legend(axes[0])
        for panel, test in zip(axes[1:], drawn, strict=True):
            _correlation(panel, test.lags_s, test.correlation, test)
            panel.axvline(0.0, color=style.GREY, linewidth=0.8)
            panel.set_ylabel(style.upright_label(f"correlation with {test.name}", "1"))
        caption = (
            "What is left in the residual. By chance alone 95 % of the lags stay in the grey, and "
            "all of them between the dash-dotted lines (99 %). Against an input the width allows "
            "for the memory of both signals (Bartlett). Right of 0 the residual follows the input: "
            "dynamics that the model lacks; left of 0 the input follows the residual: feedback "
            "while the log was taken. An input with memory smears either to both sides; the "
            "larger side is the cause."
        )
        return figure(canvas, f"Residual tests of {style.short(name)}", caption)


def operating_points(profiles: Sequence[Profile], rmse: float, *, name: str, unit: str) -> Figure:
    """Draw the error against every state and input, in bins of as many samples each.

    Args:
        profiles: one panel each, the first eight.
        rmse: of all samples, `unit`.
        name: the output's name.
        unit: its unit as declared.
    """
    drawn = profiles[:MOST_PANELS]
    with style.drawing():
        canvas, axes = _grid(len(drawn))
        for panel, each in zip(axes, drawn, strict=True):
            middle, half = (each.low + each.high) / 2, (each.high - each.low) / 2
            panel.axhline(0.0, color=style.GREY, linewidth=0.8)
            panel.axhline(rmse, color=style.INK, linewidth=0.8, linestyle=(0, (1, 1.5)))
            panel.errorbar(
                middle,
                each.rms,
                xerr=half,
                fmt="s",
                color=style.PREDICTED,
                markersize=4.0,
                linewidth=1.6,
                label="RMS",
            )
            panel.errorbar(
                middle,
                each.mean,
                yerr=1.96 * each.mean_sd,
                fmt="o",
                color=style.STRANGE,
                markerfacecolor="#ffffff",
                markersize=4.0,
                linewidth=1.0,
                capsize=2.0,
                label="mean and its 95 %",
            )
            panel.margins(0.04)
            panel.set_xlabel(style.axis_label(each.name, each.unit))
            panel.set_ylabel(style.upright_label(f"error of {name}", unit))
        style.legend(axes[0])
        caption = (
            "Bins hold about as many samples each. Squares: root mean square, the bar is the bin; "
            "dotted: that of all samples. Circles: mean, where the model is wrong to one side."
        )
        return figure(canvas, f"Where the model of {style.short(name)} is wrong", caption)


def ranges(found: Sequence[Range]) -> Figure | None:
    """Draw where the unseen data lie in the training range; None where nothing is known."""
    rows = [
        (f"{each.where}: {each.name}", each, *_place(each))
        for each in found
        if each.training and each.unseen and each.beyond is not None
    ]
    if not rows:
        return None
    with style.drawing():
        canvas, (axes,) = style.panels((0.85 + 0.3 * len(rows),))
        for k, (_, each, low, high) in enumerate(rows):
            labels = ("training", "unseen") if k == 0 else ("_training", "_unseen")
            axes.hlines(k, 0.0, 1.0, color="#d9e0e6", linewidth=11.0, label=labels[0])
            axes.hlines(k, low, high, color=style.INK, linewidth=2.0, label=labels[1])
            axes.plot([low, high], [k, k], "|", color=style.INK, markersize=8.0)
            text = f"{100 * (each.share_outside or 0.0):.1f} % outside"
            place = ("axes fraction", "data")
            axes.annotate(text, (1.02, k), xycoords=place, va="center", fontsize=8.5)
        axes.set_yticks(range(len(rows)), [style.short(label) for label, *_ in rows])
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.margins(x=0.03)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("place in the training range (1)")
        style.legend(axes)
        caption = (
            "0 and 1 are the ends of what training covered. Outside, a network argument counts as "
            "the end of its range; the share outside is of the unseen samples."
        )
        return figure(canvas, "Unseen data against the training range", caption)


def _place(each: Range) -> tuple[float, float]:
    assert each.training is not None
    assert each.unseen is not None
    low, high = each.training
    return (each.unseen[0] - low) / (high - low), (each.unseen[1] - low) / (high - low)


def _grid(count: int) -> tuple:
    """`count` panels, two in a row where there are more than one."""
    columns = min(count, 2)
    canvas, axes = style.panels((2.1,) * -(-count // columns), columns)
    for spare in axes[count:]:
        spare.remove()
    return canvas, axes[:count]


def _correlation(
    axes: Axes,
    lags: Float[np.ndarray, "lags"],
    r: Float[np.ndarray, "lags"],
    test: ResidualTest | InputTest,
) -> None:
    scale, unit = style.time_axis(lags)
    axes.axhspan(-test.bound, test.bound, color=style.BLANK, linewidth=0.0, label="95 % of lags")
    for limit, label in ((test.limit, "all lags, 99 %"), (-test.limit, None)):
        axes.axhline(limit, label=label, **FAMILY)
    axes.axhline(0.0, color=style.GREY, linewidth=0.8)
    axes.plot(lags / scale, r, color=style.PREDICTED, linewidth=1.2)
    if len(lags) <= 60:
        axes.plot(lags / scale, r, "o", color=style.PREDICTED, markersize=2.5)
    axes.set_xlim(min(lags[0], 0.0) / scale, lags[-1] / scale)
    axes.margins(y=0.08)
    axes.set_xlabel(style.axis_label("lag", unit))
