"""Figures of condition (13): where the sampled error converges, how fast and how far it goes."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from faultgauge.reporting import style
from faultgauge.reporting.relations import relation
from faultgauge.reporting.svg import Figure, figure
from faultgauge_studies.paper.bench import Traces
from faultgauge_studies.paper.claims.condition_13_error import FORMS

__all__ = ["KINDS", "damping", "where", "zone"]

KINDS = {"bandwidth": "equal ω_o", "noise": "equal gain of noise"}


def where(traces: Traces) -> Figure:
    """Where each form converges, over omega_o T_s and zeta."""
    maps = traces["condition_13_map"]
    step, zeta = maps["omega_T"], maps["zeta"]
    with style.drawing():
        canvas, axes = style.panels((3.2,), len(FORMS))
        for panel, (form, label) in zip(axes, FORMS.items(), strict=True):
            panel.pcolormesh(step, zeta, 1 - maps[form].T, cmap="Greys", vmin=0.0, vmax=1.4)
            panel.plot(step, 1 / step, label="ζ = 1/(ω_o T_s)", **style.TRUTH)
            panel.axhline(1.0, color=style.LIMIT, linewidth=1.4, label="(13) holds above")
            panel.set(xscale="log", yscale="log", ylim=(zeta[0], zeta[-1]))
            for axis in (panel.xaxis, panel.yaxis):
                style.plain_powers(axis)
            panel.grid(visible=False)
            panel.set_title(style.short(label), loc="left")
            panel.set_xlabel("ω_o T_s")
        axes[0].set_ylabel("ζ")
        handles, labels = axes[0].get_legend_handles_labels()
        canvas.legend(handles, labels, loc="outside upper right", ncols=2)
        return figure(
            canvas,
            "Where the sampled observer converges, and where (13) holds",
            "White: converges for every κ, δ and jump; darker: for fewer of them, darkest for "
            "none. (13) holds above the solid line.",
        )


def damping(traces: Traces, jumps: Sequence[float], allowed: float) -> tuple[Figure, ...]:
    """Settling and overshoot over zeta; `allowed` overshoot in %."""
    sweep = traces["condition_13_zeta"]

    def curves(quantity: str, factor: float) -> dict[str, Float[np.ndarray, "points"]]:
        return {
            f"{jump} N·m, {label}": factor * sweep[f"{quantity}_{name}_{jump:g}"]
            for name, label in KINDS.items()
            for jump in jumps
        }

    return (
        relation(
            sweep["zeta"],
            curves("settling", 1.0),
            title="Settling over damping",
            x_name="damping ζ",
            x_unit="",
            y_name="settling to 5 %",
            y_unit="s",
            caption="(13) holds right of ζ = 1. Steps are where an overshoot leaves the 5 %.",
        ),
        relation(
            sweep["zeta"],
            curves("overshoot", 100.0),
            title="Overshoot over damping",
            x_name="damping ζ",
            x_unit="",
            y_name="overshoot",
            y_unit="%",
            limit=allowed,
            limit_name="allowed",
            caption="(13) holds right of ζ = 1.",
        ),
    )


def zone(traces: Traces) -> Figure:
    """Settling over delta."""
    curves = dict(traces["condition_13_zone"])
    return relation(
        curves.pop("delta"),
        curves,
        title="Settling over the width of the linear zone",
        x_name="half width δ of the linear zone",
        x_unit="N*m*s",
        y_name="settling to 5 %",
        y_unit="s",
        logarithmic="xy",
        caption="(13) holds everywhere here. κ = 1 is linear and knows no δ.",
    )
