"""Figures of a model: the data behind it, what it learned, how the fit went, how models compare."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from faultgauge.reporting import marks, style
from faultgauge.reporting.coverage import outside
from faultgauge.reporting.svg import Figure, figure
from faultgauge.reporting.thinning import thin

__all__ = ["bars", "envelope", "fit_history", "learned_curve"]

NO_DATA = 1 / 25  # a stretch this long without data, as a share of the axis, is greyed out


def envelope(
    training: Mapping[str, Float[np.ndarray, "points"]],
    units: Mapping[str, str],
    pairs: Sequence[tuple[str, str]],
    *,
    other: Mapping[str, Float[np.ndarray, "others"]] | None = None,
    other_name: str = "this log",
) -> Figure:
    """Draw what the training log covered and, on top, the points of another log outside it.

    Args:
        training: values of each network argument or input in the healthy log.
        units: unit by name, as declared.
        pairs: the names drawn against each other, one panel per pair, horizontal axis first.
        other: the same names in the log to judge; see `coverage.outside` for what counts.
        other_name: that log's name.
    """
    columns = min(len(pairs), 2)
    rows = -(-len(pairs) // columns)
    shares: list[str] = []
    with style.drawing():
        canvas, axes = style.panels((2.9,) * rows, columns)
        for spare in axes[len(pairs) :]:
            spare.remove()
        for panel, (x, y) in zip(axes, pairs, strict=False):
            marks.cloud(panel, training[x], training[y], label="training data")
            if other is not None:
                share = _strangers(panel, training, other, (x, y))
                shares.append(f"{100 * share:.1f} % of ({style.short(x)}, {style.short(y)})")
            panel.set_xlabel(style.axis_label(x, units.get(x, "")))
            panel.set_ylabel(style.upright_label(y, units.get(y, "")))
            panel.margins(0.04)
            style.legend(panel)
        caption = "Grey: where the training data lie, darker where there are more."
        if other is not None:
            caption += (
                f" Of {style.short(other_name)}, {' and '.join(shares)} lies outside (orange), "
                "where the model extrapolates."
            )
        return figure(canvas, "What the training data cover", caption)


def learned_curve(
    x: Float[np.ndarray, "grid"],
    mean: Float[np.ndarray, "grid"],
    data_x: Float[np.ndarray, "points"],
    data_y: Float[np.ndarray, "points"],
    *,
    x_name: str,
    x_unit: str,
    y_name: str,
    y_unit: str,
    reference: Float[np.ndarray, "grid"] | None = None,
    band: tuple[Float[np.ndarray, "grid"], Float[np.ndarray, "grid"]] | None = None,
) -> Figure:
    """Draw a learned relation, such as friction against speed, over the data behind it.

    Args:
        x: increasing argument, `x_unit`.
        mean: the learned curve, `y_unit`.
        data_x: argument of the data, `x_unit`; none where no data stand for it alone.
        data_y: what the data say the curve is, `y_unit`.
        x_name: the argument's name.
        x_unit: its unit as declared.
        y_name: the learned quantity's name.
        y_unit: its unit as declared.
        reference: known physics at `x`, `y_unit`; dashed.
        band: lower and upper end of its 95 % band at `x`, `y_unit`.
    """
    with style.drawing():
        canvas, (axes,) = style.panels((3.1,))
        empty = _empty_stretches(x, data_x) if data_x.size else []
        for index, (start, end) in enumerate(empty):
            label = "no data" if index == 0 else None
            axes.axvspan(start, end, color=style.BLANK, linewidth=0.0, zorder=0.5, label=label)
        if band is not None:
            axes.fill_between(x, *band, color=style.BAND, linewidth=0.0, label="95 % band")
        if data_x.size:
            marks.cloud(axes, data_x, data_y, label="data")
        axes.plot(x, mean, color=style.PREDICTED, linewidth=1.8, label="learned")
        if reference is not None:
            axes.plot(x, reference, label="known physics", **style.TRUTH)
        axes.set_xlim(x[0], x[-1])
        axes.margins(y=0.06)
        axes.set_xlabel(style.axis_label(x_name, x_unit))
        axes.set_ylabel(style.upright_label(y_name, y_unit))
        style.legend(axes)
        caption = "The learned curve" + (" and the data behind it." if data_x.size else ".")
        if empty:
            caption += " Grey ranges hold no data: there the curve is a guess."
        title = f"Learned: {style.short(y_name)} against {style.short(x_name)}"
        return figure(canvas, title, caption)


def fit_history(
    training: Sequence[Float[np.ndarray, "_"]],
    validation: Sequence[Float[np.ndarray, "_"]],
    *,
    chosen: int,
    cost_unit: str = "1",
) -> Figure:
    """Draw the cost of every trial of every restart, on the data fitted and on those held out.

    Args:
        training: cost per trial of each restart, on the data that were fitted.
        validation: the same on the data held out; the lowest value ends up in the model.
        chosen: index of the restart that was selected.
        cost_unit: unit of the cost; "1" where it is scaled.
    """
    with style.drawing():
        canvas, axes = style.panels((2.6,), 2)
        axes[1].sharey(axes[0])
        for panel, costs, name in zip(
            axes, (training, validation), ("training", "validation"), strict=True
        ):
            others = [cost for index, cost in enumerate(costs) if index != chosen]
            for index, cost in enumerate(others):
                label = "other restarts" if index == 0 else None
                _cost(panel, cost, color=style.MEASURED, linewidth=0.9, label=label)
            _cost(panel, costs[chosen], color=style.PREDICTED, linewidth=1.9, label="selected")
            panel.set_yscale("log")
            style.plain_powers(panel.yaxis)
            panel.xaxis.set_major_locator(MaxNLocator("auto", integer=True))
            panel.set_xlabel("trial (number)")
            panel.set_ylabel(style.upright_label(f"{name} cost", cost_unit))
        best = int(np.nanargmin(validation[chosen]))
        axes[1].plot(
            best + 1, validation[chosen][best], "o", color=style.PREDICTED, label="kept trial"
        )
        style.legend(axes[1])
        caption = (
            f"Cost of all {len(training)} restarts; the selected one is dark. "
            f"Its weights are those of trial {best + 1}, best on the data held out."
        )
        return figure(canvas, "How the fit went", caption)


def bars(
    labels: Sequence[str],
    values: Float[np.ndarray, "labels 3"],
    *,
    title: str,
    name: str,
    unit: str,
    reference: Float[np.ndarray, "labels"] | None = None,
    reference_name: str = "reference",
) -> Figure:
    """Compare medians and their ranges, one row per label, the first on top.

    The axis is logarithmic where positive values span more than a factor of thirty.

    Args:
        labels: name of each row.
        values: median, smallest and largest value of each row, `unit`.
        title: what is compared, a few words.
        name: the quantity.
        unit: its unit as declared.
        reference: a value to hold beside each row, `unit`, such as a published one; NaN for none.
        reference_name: where it comes from.
    """
    rows = np.arange(len(labels), dtype=float)
    median, low, high = values.T
    with style.drawing():
        canvas, (axes,) = style.panels((0.75 + 0.31 * len(labels),))
        axes.hlines(rows, low, high, color=style.MEASURED, linewidth=5.0, label="range")
        axes.plot(median, rows, "o", markersize=6.0, color=style.PREDICTED, label="median")
        if reference is not None:
            axes.plot(
                reference,
                rows,
                "D",
                markersize=5.0,
                markerfacecolor="#ffffff",
                markeredgecolor=style.INK,
                label=style.short(reference_name),
            )
        positive = values[np.isfinite(values)]
        if positive.size and positive.min() > 0.0 and positive.max() > 30.0 * positive.min():
            axes.set_xscale("log")
            style.plain_powers(axes.xaxis)
        axes.set_yticks(rows, [style.short(label) for label in labels])
        axes.set_ylim(len(labels) - 0.4, -0.6)
        axes.margins(x=0.04)
        axes.grid(visible=False, axis="y")
        for row, (middle, least, most) in zip(rows, values, strict=True):
            text = f"{middle:.4g} [{least:.4g}, {most:.4g}]" if np.isfinite(middle) else "no value"
            axes.annotate(
                text, (1.02, row), xycoords=("axes fraction", "data"), va="center", fontsize=8.5
            )
        axes.set_xlabel(style.axis_label(name, unit))
        style.legend(axes)
        return figure(canvas, title, "At the right: median [smallest, largest].")


def _strangers(
    axes: Axes,
    training: Mapping[str, Float[np.ndarray, "points"]],
    other: Mapping[str, Float[np.ndarray, "others"]],
    pair: tuple[str, str],
) -> float:
    """Draw the other log's points outside the training data; return their share."""
    points = np.stack([other[name] for name in pair], axis=1)
    known = np.isfinite(points).all(axis=1)
    mask = outside(np.stack([training[name] for name in pair], axis=1), points)
    strange = points[mask]
    marks.dots(axes, *strange.T, color=style.STRANGE, size=3.2, label="outside")
    return float(mask.sum() / max(known.sum(), 1))


def _empty_stretches(
    x: Float[np.ndarray, "grid"], data_x: Float[np.ndarray, "points"]
) -> list[tuple[float, float]]:
    """The ranges of x, from its first to its last value, where no data lie."""
    inside = data_x[(data_x >= x[0]) & (data_x <= x[-1])]
    known = np.concatenate([x[:1], np.sort(inside), x[-1:]])
    wide = np.flatnonzero(np.diff(known) > NO_DATA * (x[-1] - x[0]))
    return [(float(known[i]), float(known[i + 1])) for i in wide]


def _cost(
    axes: Axes, cost: Float[np.ndarray, "trials"], color: str, linewidth: float, label: str | None
) -> None:
    trials = np.arange(1.0, len(cost) + 1.0)
    kept, drawn = thin(trials, np.where(cost > 0.0, cost, np.nan), style.BINS // 3)
    axes.plot(kept, drawn, color=color, linewidth=linewidth, label=label)
