"""What figures are made of: lines, bands, limits, shaded stretches, clouds of points."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from faultgauge.reporting import style
from faultgauge.reporting.clock_axis import clock_label, clock_ticks
from faultgauge.reporting.thinning import stretches, thin, thin_band
from faultgauge.telemetry.clock import Clock

__all__ = [
    "NOISES",
    "band",
    "cells",
    "cloud",
    "dots",
    "hatch",
    "limits",
    "line",
    "look_at",
    "look_at_estimate",
    "shade",
    "show_at_least",
    "time_below",
]

NOISES = 5.0  # standard deviations of the noise that an axis spans at least, either way

FEW_DOTS = 600  # up to here every point is a dot, above it a density says more
CELLS = (88, 56)  # of the density, across and up
DOT_CELLS = (176, 112)  # dots closer than this would cover each other
SHADES = ("#d9e0e6", "#bec8d1", "#a1aebb", "#84929f")  # more points, darker


def line(
    axes: Axes, t: Float[np.ndarray, "samples"], y: Float[np.ndarray, "samples"], **look: Any
) -> None:
    """Draw a curve over time, thinned to what the width can show."""
    scale, _ = style.time_axis(t)
    kept, drawn = thin(t, y, style.BINS)
    axes.plot(kept / scale, drawn, **look)


def band(
    axes: Axes,
    t: Float[np.ndarray, "samples"],
    lo: Float[np.ndarray, "samples"],
    hi: Float[np.ndarray, "samples"],
    label: str,
) -> None:
    """Fill between two curves over time."""
    scale, _ = style.time_axis(t)
    kept, low, high = thin_band(t, lo, hi, style.BINS)
    axes.fill_between(kept / scale, low, high, color=style.BAND, linewidth=0.0, label=label)


def limits(axes: Axes, limit: float | None) -> None:
    """Draw plus and minus a limit; nothing where there is none."""
    if limit is None:
        return
    look: dict[str, Any] = {"color": style.LIMIT, "linestyle": (0, (9, 2, 2, 2)), "linewidth": 1.0}
    axes.axhline(limit, label="limit", **look)
    axes.axhline(-limit, **look)


def shade(
    axes: Axes,
    t: Float[np.ndarray, "samples"],
    spans: Sequence[tuple[float, float]],
    color: str,
    label: str,
) -> None:
    """Colour stretches of time, s; those outside the log are cut off."""
    scale, _ = style.time_axis(t)
    for index, (start, end) in enumerate(spans):
        axes.axvspan(
            max(start, float(t[0])) / scale,
            min(end, float(t[-1])) / scale,
            color=color,
            linewidth=0.0,
            zorder=0.5,
            label=label if index == 0 else None,
        )


def hatch(
    axes: Axes, t: Float[np.ndarray, "samples"], mask: Bool[np.ndarray, "samples"], label: str
) -> None:
    """Hatch the stretches of time where `mask` holds."""
    scale, _ = style.time_axis(t)
    for index, (start, end) in enumerate(stretches(t, mask, style.BINS // 4)):
        axes.axvspan(
            start / scale,
            end / scale,
            facecolor="#ffffff",
            edgecolor=style.MEASURED,
            hatch="////",
            linewidth=0.5,
            zorder=1.5,  # above bands, which mean nothing there, and below curves
            label=label if index == 0 else None,
        )


def time_below(axes: Axes, t: Float[np.ndarray, "samples"], clock: Clock | None = None) -> None:
    """Label the time axis and let it span the log; in the log's own time where it has a
    `clock`."""
    scale, unit = style.time_axis(t)
    axes.set_xlabel(style.axis_label("time", unit) if clock is None else clock_label(clock))
    if t.size > 1:
        axes.set_xlim(t[0] / scale, t[-1] / scale)
    if clock is not None and t.size:
        places, labels = clock_ticks(clock, float(t[0]), float(t[-1]))
        axes.set_xticks([place / scale for place in places], labels)


def look_at(axes: Axes, *values: Float[np.ndarray, "_"]) -> None:
    """Let the vertical axis show all the finite values, with a margin."""
    shown = np.concatenate([v[np.isfinite(v)] for v in values])
    if shown.size and np.ptp(shown) > 0.0:
        margin = 0.06 * np.ptp(shown)
        axes.set_ylim(shown.min() - margin, shown.max() + margin)


def look_at_estimate(
    axes: Axes,
    f: Float[np.ndarray, "samples"],
    lo: Float[np.ndarray, "samples"],
    hi: Float[np.ndarray, "samples"],
    seen: Bool[np.ndarray, "samples"],
    *more: Float[np.ndarray, "_"],
) -> None:
    """The same of an estimate where it is `seen`, of as much of its band as is usual, and of all of
    it where it leaves 0 out: where it is as wide as the prior it would leave nothing of the
    estimate."""
    width = (hi - lo)[seen]
    usual = np.nanmedian(width) / 2 if np.isfinite(width).any() else 0.0
    told = seen & ((lo > 0) | (hi < 0))
    look_at(axes, f[seen] - usual, f[seen] + usual, lo[told], hi[told], *more)


def show_at_least(axes: Axes, low: float, high: float) -> None:
    """Let the vertical axis span `low` to `high` too, so that noise looks small; nothing where
    these are one."""
    if low < high:
        bottom, top = axes.get_ylim()
        axes.set_ylim(min(bottom, low), max(top, high))


def dots(
    axes: Axes,
    x: Float[np.ndarray, "points"],
    y: Float[np.ndarray, "points"],
    *,
    color: str,
    size: float,
    label: str,
) -> None:
    """Draw points, `size` in typographic points; of those that cover each other only the first."""
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    cells = np.stack([_cell(x, DOT_CELLS[0]), _cell(y, DOT_CELLS[1])])
    _, kept = np.unique(cells, axis=1, return_index=True)
    gap = np.full(kept.shape, np.nan)
    # Lines of no length with round caps: one path for all dots, a fifth of the size of markers.
    across = np.stack([x[kept], x[kept], gap], axis=1).ravel()
    up = np.stack([y[kept], y[kept], gap], axis=1).ravel()
    axes.plot(across, up, color=color, linewidth=size)
    axes.plot([], [], "o", color=color, markersize=size + 1.0, markeredgewidth=0.0, label=label)


def cloud(
    axes: Axes, x: Float[np.ndarray, "points"], y: Float[np.ndarray, "points"], label: str
) -> None:
    """Draw where points lie: each as a dot while they are few, else a density in greys.

    Any cell with a point in it is at least light grey, so that nothing is hidden.
    """
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    if x.size <= FEW_DOTS:
        dots(axes, x, y, color=style.MEASURED, size=2.6, label=label)
        return
    counts, across, up = np.histogram2d(x, y, bins=CELLS)
    levels = np.geomspace(1.0, max(counts.max(), 2.0), len(SHADES) + 1)
    for shade_of, low in zip(SHADES, levels, strict=False):
        # Darker cells lie on top of lighter ones, so every level is drawn from its floor up.
        patch = PathPatch(_rectangles(counts >= low, across, up), facecolor=shade_of, linewidth=0)
        axes.add_patch(patch)
        if shade_of == SHADES[2]:
            patch.set_label(label)
    axes.autoscale_view()


def cells(axes: Axes, percent: Float[np.ndarray, "rows columns"]) -> None:
    """Fill the cells of a table by their percentage, the first row at the top, the centres at whole
    numbers; as paths, since a report shows no pixel images."""
    rows, columns = percent.shape
    edges = np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5
    axes.pcolormesh(*edges, percent, cmap="Blues", vmin=0.0, vmax=100.0)
    axes.set_ylim(rows - 0.5, -0.5)
    axes.grid(visible=False)


def _cell(values: Float[np.ndarray, "points"], count: int) -> Int[np.ndarray, "points"]:
    """The cell each value falls in, of `count` equal ones over their range."""
    if values.size == 0 or np.ptp(values) == 0.0:
        return np.zeros(values.shape, dtype=int)
    place = (values - values.min()) / np.ptp(values) * count
    return np.minimum(place, count - 1).astype(int)


def _rectangles(
    filled: Bool[np.ndarray, "across up"],
    across: Float[np.ndarray, "edges_x"],
    up: Float[np.ndarray, "edges_y"],
) -> Path:
    """One path over all filled cells, neighbours in a row joined into one rectangle."""
    steps = np.diff(filled.astype(int), axis=0, prepend=0, append=0).T
    row, start = np.nonzero(steps == 1)
    _, end = np.nonzero(steps == -1)
    left, right, low, high = across[start], across[end], up[row], up[row + 1]
    corners = [(left, low), (right, low), (right, high), (left, high), (left, low)]
    vertices = np.stack([np.stack(corner, axis=-1) for corner in corners], axis=1).reshape(-1, 2)
    codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY]
    return Path(vertices, np.tile(np.array(codes, dtype=np.uint8), row.size))
