"""Figures of single and multiple component failures."""

from typing import Any

import numpy as np

from faultgauge.reporting.relations import relation
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, panels
from faultgauge_studies.paper.cases import ONSET
from faultgauge_studies.paper.claims.components_naming import NAMED, WATCHED
from faultgauge_studies.paper.tables import Results

__all__ = ["residual_figure", "size_figure", "talk_figure"]


def residual_figure(x: Any, limit: Results) -> Figure:
    """The residuals [N*m] of both wheels where one or both are at fault."""
    stack = [
        Panel(
            f"residual, {truth} at fault",
            "N*m",
            {f"{axis} wheel": x[f"{axis}_r_{truth}"] for axis in WATCHED},
        )
        for truth in NAMED[1:]
    ]
    worst = max(limit[axis]["max"] for axis in WATCHED)
    return panels(
        x["t"],
        stack,
        title="Residual of each wheel: single and multiple failures",
        caption=f"0.1 N·m of friction from {ONSET:g} s on. The limits, at most ±{worst:.1g} N·m, "
        "are no wider than the line.",
    )


def size_figure(judged: Results, asked: float) -> Figure:
    """How often the names are right over the size of the fault; `asked` is a share."""
    sizes = [s for s in judged if float(s) > 0]
    names = {
        "right": "all wheels right",
        "missed": "a fault missed",
        "sound_named": "a sound wheel named",
    }
    curves = {
        label: np.array([100 * judged[s][key]["median"] for s in sizes])
        for key, label in names.items()
    }
    return relation(
        np.array([float(s) for s in sizes]),
        curves,
        title="How small a fault is still told",
        x_name="fault",
        x_unit="N*m",
        y_name="flights",
        y_unit="%",
        caption="Median over seeds, single and multiple failures together.",
        logarithmic="x",
        limit=100 * asked,
        limit_name="asked for right",
    )


def talk_figure(x: Any) -> Figure:
    """What a fault in pitch changes in each wheel's torque and residual [N*m]."""
    kinds = (("torque", "change of torque"), ("residual", "change of residual"))
    stack = [
        Panel(name, "N*m", {f"{a} wheel": x[f"{a}_{key}"] for a in WATCHED}) for key, name in kinds
    ]
    return panels(
        x["t"],
        stack,
        title="What a fault in pitch does to both wheels",
        caption="The flight with the fault less the same flight without it.",
    )
