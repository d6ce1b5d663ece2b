"""Figures of one quantity against another, when neither is time."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from faultgauge.reporting import style
from faultgauge.reporting.svg import Figure, figure

__all__ = ["relation"]


def relation(
    x: Float[np.ndarray, "points"],
    values: Mapping[str, Float[np.ndarray, "points"]],
    *,
    title: str,
    x_name: str,
    x_unit: str,
    y_name: str,
    y_unit: str,
    caption: str = "",
    logarithmic: str = "",
    measured: Mapping[str, Float[np.ndarray, "points"]] | None = None,
    limit: float | None = None,
    limit_name: str = "",
) -> Figure:
    """Draw curves of one quantity against another.

    Args:
        x: the argument, `x_unit`.
        values: curve by its name in the legend, `y_unit`; NaN leaves a gap.
        title: what is shown, a few words.
        x_name: the argument's name.
        x_unit: its unit as declared.
        y_name: the quantity's name.
        y_unit: its unit as declared.
        caption: what to see in it.
        logarithmic: the axes that are: "x", "y" or "xy".
        measured: points to hold against the curves, at the same `x`; NaN for none.
        limit: a horizontal line, `y_unit`.
        limit_name: what it is.
    """
    with style.drawing():
        canvas, (axes,) = style.panels((3.0,))
        for look, (label, y) in zip(style.SERIES[: len(values)], values.items(), strict=True):
            axes.plot(x, y, label=style.short(label), **look)
        for marker, (label, y) in zip("oDs^v", (measured or {}).items(), strict=False):
            axes.plot(
                x,
                y,
                marker,
                markersize=5.0,
                markerfacecolor="#ffffff",
                markeredgecolor=style.INK,
                label=style.short(label),
            )
        if limit is not None:
            axes.axhline(limit, color=style.LIMIT, linewidth=1.0, label=limit_name)
        if "x" in logarithmic:
            axes.set_xscale("log")
            style.plain_powers(axes.xaxis)
        if "y" in logarithmic:
            axes.set_yscale("log")
            style.plain_powers(axes.yaxis)
        axes.margins(0.03)
        axes.set_xlabel(style.axis_label(x_name, x_unit))
        axes.set_ylabel(style.upright_label(y_name, y_unit))
        style.legend(axes)
        return figure(canvas, title, caption)
