"""Figures of the wavelet claim: residuals beside their energy maps, and confusion matrices."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from faultgauge.reporting import marks, style
from faultgauge.reporting.relations import relation
from faultgauge.reporting.svg import Figure, figure
from faultgauge.simulation.satellite.observatory import PERIOD
from faultgauge_studies.paper.bench import Traces
from faultgauge_studies.paper.claims.wavelets_faults import ORDER
from faultgauge_studies.paper.claims.wavelets_features import BANDS, PARTS, SETS
from faultgauge_studies.paper.tables import Results

__all__ = ["example_figure", "level_figure", "matrix_figure", "size_figure"]

NYQUIST = 0.5 / PERIOD


def example_figure(traces: Traces) -> Figure:
    """Residuals of the first case beside their energy maps."""
    x = traces["wavelet_residuals"]
    return _examples(
        x["t"],
        {kind: x[kind] for kind in ORDER},
        {kind: traces["wavelet_maps"][kind] for kind in ORDER},
        title="Six faults of the same values, and their energy by wavelets",
        caption="Left: the residual. Right: the root of each cell's share of the energy, darker "
        "for more; a level reaches from its mark to half that frequency, the last to 0.",
    )


def level_figure(traces: Traces) -> Figure:
    """Mean share of the energy by level and kind."""
    edges = NYQUIST / 2.0 ** np.arange(BANDS)
    return relation(
        edges,
        {kind: 100 * np.asarray(traces["wavelet_levels"][kind]) for kind in ORDER},
        title="Energy of the levels",
        x_name="upper edge of the level",
        x_unit="Hz",
        y_name="share of the energy",
        y_unit="%",
        caption="Mean over the judged runs. The first three kinds differ in when, not in where.",
        logarithmic="x",
    )


def matrix_figure(found: Results) -> Figure:
    """The confusion matrices of the first case."""
    shares = {
        SETS[name]: np.array([[row[n]["median"] for n in ORDER] for row in matrix.values()])
        for name, matrix in found["confusion"].items()
    }
    return _matrices(
        shares,
        ORDER,
        title="Confusion matrices by set of features",
        caption="Percent of the runs of a true kind (down) that are found as each kind (across); "
        "median over seeds.",
    )


def size_figure(found: Results) -> Figure:
    """Share judged right over the size of the fault."""
    sizes = found["by_size"]
    curves = {
        label: np.array([100 * s[name]["median"] for s in sizes.values()])
        for name, label in SETS.items()
    }
    return relation(
        np.array([float(size) for size in sizes]),
        curves,
        title="How large the fault must be",
        x_name="RMS of the fault",
        x_unit="N*m",
        y_name="runs judged right",
        y_unit="%",
        caption="The six faults of the same values; f(t), unknown to the model, has an RMS of "
        f"{found['rms_f']['median']:.2g} N·m. Median over seeds.",
        logarithmic="x",
        limit=100 / len(ORDER),
        limit_name="chance",
    )


def _examples(
    t: Float[np.ndarray, "samples"],
    residuals: Mapping[str, Float[np.ndarray, "samples"]],
    maps: Mapping[str, Float[np.ndarray, "bands parts"]],
    *,
    title: str,
    caption: str,
) -> Figure:
    """One residual [N*m] of each kind; at its right its energy by level and part of the record.

    Args:
        t: increasing time, s.
        residuals: by kind.
        maps: shares of the energy by kind, the highest band first.
        title: what is shown, a few words.
        caption: what to see in it.
    """
    with style.drawing():
        canvas, axes = style.panels((1.15,) * len(residuals), 2)
        ends = np.linspace(t[0], t[-1], PARTS + 1)
        for row, (kind, r) in enumerate(residuals.items()):
            left, right = axes[2 * row : 2 * row + 2]
            marks.line(left, t, 1e3 * r, color=style.PREDICTED, linewidth=0.7)
            left.set_title(style.short(kind), loc="left")
            left.set_ylabel("r (mN·m)")
            _shaded(right, ends, np.arange(BANDS + 1.0), np.sqrt(maps[kind]))
            edges = [0, 2, 4, 6]
            right.set_yticks(edges, [f"{NYQUIST / 2**k:.3g}" for k in edges])
            right.set_ylabel("band (Hz)")
            if row < len(residuals) - 1:
                left.tick_params(labelbottom=False)
                right.tick_params(labelbottom=False)
        for below in axes[-2:]:
            below.set_xlabel("time (s)")
        return figure(canvas, title, caption)


def _matrices(
    shares: Mapping[str, Float[np.ndarray, "classes classes"]],
    names: Sequence[str],
    *,
    title: str,
    caption: str,
) -> Figure:
    """Confusion matrices in grey with their percentages, true classes down, found ones across."""
    rows, ends = -(-len(shares) // 2), np.arange(len(names) + 1.0)
    with style.drawing():
        canvas, axes = style.panels((3.4,) * rows, 2)
        for spare in axes[len(shares) :]:
            spare.remove()
        for place, (panel, (name, each)) in enumerate(zip(axes, shares.items(), strict=False)):
            _shaded(panel, ends, ends, each)
            for (row, column), share in np.ndenumerate(each):
                ink = "#ffffff" if share > 0.5 else style.INK
                at = (column + 0.5, row + 0.5)
                panel.annotate(f"{100 * share:.0f}", at, ha="center", va="center", color=ink)
            panel.set_title(style.short(name), loc="left")
            middle = ends[:-1] + 0.5
            panel.set_xticks(middle, names, rotation=35.0, ha="right", rotation_mode="anchor")
            panel.set_yticks(middle, names if place % 2 == 0 else [""] * len(names))
            panel.set_xlabel("found")
            if place % 2 == 0:
                panel.set_ylabel("true")
        return figure(canvas, title, caption)


def _shaded(
    axes: Axes,
    across: Float[np.ndarray, "across"],
    down: Float[np.ndarray, "down"],
    values: Float[np.ndarray, "rows columns"],
) -> None:
    """Cells from white at 0 to dark at 1, the first row on top."""
    axes.pcolormesh(across, down, values, cmap="Greys", vmin=0.0, vmax=1.15)
    axes.invert_yaxis()
    axes.grid(visible=False)
