"""Maps: one quantity over two others, in greys with labelled contours."""

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.reporting import style
from faultgauge.reporting.svg import Figure, figure

__all__ = ["contour_map"]


def contour_map(
    x: Float[np.ndarray, "columns"],
    y: Float[np.ndarray, "rows"],
    z: Float[np.ndarray, "rows columns"],
    levels: Float[np.ndarray, "levels"],
    *,
    title: str,
    caption: str,
    x_label: tuple[str, str],
    y_label: tuple[str, str],
    z_label: tuple[str, str],
    hatched: Bool[np.ndarray, "rows columns"] | None = None,
    line: float | None = None,
) -> Figure:
    """Draw `z` between rising `levels`, darker for more.

    Args:
        x: increasing, along the axis.
        y: increasing.
        z: NaN where there is nothing to show.
        levels: where contours run.
        title: what is shown, a few words.
        caption: how to read it.
        x_label: name and unit.
        y_label: name and unit.
        z_label: name and unit.
        hatched: where to lay a hatching on top, with `z` of no meaning there.
        line: a horizontal line at this y.
    """
    with style.drawing():
        canvas, (axes,) = style.panels((3.4,))
        drawn = axes.contourf(x, y, np.clip(z, levels[0], levels[-1]), levels, cmap="Greys")
        bar = canvas.colorbar(drawn, ax=axes)
        bar.set_label(style.axis_label(*z_label))
        if hatched is not None:
            axes.contourf(
                x, y, hatched.astype(float), [0.5, 1.5], colors="none", hatches=["//////"]
            )
        if line is not None:
            axes.axhline(line, color=style.LIMIT, linewidth=1.4)
        axes.set_xlabel(style.axis_label(*x_label))
        axes.set_ylabel(style.axis_label(*y_label))
        return figure(canvas, title, caption)
