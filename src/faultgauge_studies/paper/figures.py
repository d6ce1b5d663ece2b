"""Figures of the study, from the curves of one seed."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from faultgauge.reporting.model_figures import bars, envelope, learned_curve
from faultgauge.reporting.relations import relation
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, curves, panels
from faultgauge.simulation.satellite.observatory import AXES
from faultgauge_studies.paper.bench import Traces
from faultgauge_studies.paper.cases import CASES
from faultgauge_studies.paper.tables import LOGS, NAMES, Results

__all__ = [
    "channels",
    "command",
    "coverage",
    "estimate_errors",
    "estimates",
    "flight",
    "friction",
    "log_bars",
    "noisy",
    "references",
    "residual_stack",
    "severity",
    "shadow",
    "torque_form",
]


def _cut(trace: Mapping[str, Any], window: tuple[float, float]) -> dict[str, np.ndarray]:
    inside = (trace["t"] >= window[0]) & (trace["t"] <= window[1])
    return {name: np.asarray(x)[inside] for name, x in trace.items()}


def coverage(traces: Traces) -> tuple[Figure, ...]:
    """What the flight meets, over what noise with the sweep and noise alone have covered."""
    nominal = traces["nominal"]
    found = []
    for key, title in (
        ("training", "Covered by noise with the sweep"),
        ("training_noise_alone", "Covered by noise alone"),
    ):
        if key not in traces:
            continue
        drawn = envelope(
            {name: traces[key][name] for name in ("h", "u")},
            {"h": "N*m*s", "u": "N*m"},
            [("h", "u")],
            other={"h": nominal["h"], "u": nominal["u"]},
            other_name="the fault-free flight",
        )
        found.append(replace(drawn, title=title))
    return tuple(found)


def friction(traces: Traces) -> tuple[Figure, ...]:
    """xi(h) over the whole range, and where the speed changes its sign."""
    curve, data = traces["friction"], traces["training"]
    found = []
    for reach in (np.inf, 12.0):
        shown = np.abs(curve["h"]) <= reach
        near = np.abs(data["h"]) <= reach
        found.append(
            learned_curve(
                curve["h"][shown],
                curve["gbnnm"][shown],
                data["h"][near],
                (data["u"] - data["T"])[near],
                x_name="momentum h",
                x_unit="N*m*s",
                y_name="friction torque",
                y_unit="N*m",
                reference=curve["desired"][shown],
            )
        )
    return tuple(found)


def shadow(traces: Traces) -> float:
    """When the satellite enters the Earth's shadow, s."""
    nominal = traces["nominal"]
    dark = nominal["sunlit"] < 0.5
    return float(nominal["t"][dark][0]) if dark.any() else float("nan")


def flight(traces: Traces) -> tuple[Figure, ...]:
    n = traces["nominal"]
    true = dict(zip(AXES, np.asarray(n["attitude"]).T, strict=True))
    off = dict(zip(AXES, np.asarray(n["attitude_error"]).T, strict=True))
    angles = panels(
        n["t"],
        [
            Panel("attitude", "deg", true),
            Panel("attitude estimate, error", "deg", off),
        ],
        title="Attitude against the orbit frame",
        caption="Above: true. Below: what gyro, earth and sun sensors make of it, less that.",
    )
    torque = panels(
        n["t"],
        [
            Panel("torque T", "N*m", {"wheel": n["T"], "GBNNM": n["yhat_gbnnm"]}),
            Panel(
                "T less free run",
                "N*m",
                {"desired model": n["T"] - n["yhat_desired"], "GBNNM": n["T"] - n["yhat_gbnnm"]},
            ),
            Panel(
                "h less free run",
                "N*m*s",
                {"desired model": n["h"] - n["hhat_desired"], "GBNNM": n["h"] - n["hhat_gbnnm"]},
            ),
        ],
        title="Pitch wheel and models beside it",
        caption="What the desired model leaves is f(t), the disturbance inside the wheel.",
    )
    return angles, torque


def residual_stack(traces: Traces, key: str, number: str, window: tuple[float, float]) -> Figure:
    """The paper's layout: (a) output, (b) model outputs, (c) residuals."""
    x = _cut(traces[key], window)
    return panels(
        x["t"],
        [
            Panel("output T", "N*m", {"wheel": x["y"]}),
            Panel(
                "model output",
                "N*m",
                {"desired model": x["yhat_desired"], "GBNNM": x["yhat_gbnnm"]},
            ),
            Panel(
                "residual",
                "N*m",
                {"desired model": x["r_desired"], "GBNNM": x["r_gbnnm"]},
                np.nan_to_num(x["fault"]),
                "fault",
            ),
        ],
        title=f"{number}: {CASES[key].title}",
        caption="(a) What the wheel gives, (b) what the references give on the same command, "
        "(c) their difference. Dashed: the fault.",
    )


def command(traces: Traces, key: str, window: tuple[float, float]) -> Figure:
    x = _cut(traces[key], window)
    return panels(
        x["t"],
        [
            Panel("command u", "N*m", {"u": x["u"]}),
            Panel("model output", "N*m", {"GBNNM": x["yhat_gbnnm"]}),
        ],
        title=f"The paper's Fig 10: command and model output, {CASES[key].title}",
        caption="Both stay bounded and without jumps while the wheel's output is stuck.",
    )


def references(traces: Traces, key: str) -> Figure:
    x = traces[key]
    return curves(
        x["t"],
        {"free-running": x["r_gbnnm"], "measured state": x["r_measured"]},
        title="Residual against the two references",
        name="residual of T",
        unit="N*m",
        truth=x["fault"],
        truth_name="fault d1",
    )


def estimates(traces: Traces, key: str, number: str) -> Figure:
    x = _cut(traces[f"estimate_{key}"], (400.0, 1000.0))
    return curves(
        x["t"],
        {NAMES["iesonn"]: x["iesonn"], NAMES["eso"]: x["eso"]},
        title=f"{number}: estimates, {CASES[key].title}",
        name="friction fault",
        unit="N*m",
        truth=x["fault"],
        truth_name="fault d1",
    )


def estimate_errors(traces: Traces, key: str) -> Figure:
    x = _cut(traces[f"estimate_{key}"], (400.0, 1000.0))
    error = {name: x[name] - x["fault"] for name in ("iesonn", "eso", "residual_measured_state")}
    jumping = np.zeros(len(x["t"]), bool)
    for start in CASES[key].jumps:
        jumping |= (x["t"] >= start) & (x["t"] < start + 30.0)
    return curves(
        x["t"],
        {NAMES[name]: np.where(jumping, np.nan, each) for name, each in error.items()},
        title="Errors of the estimates, 30 s after each jump left out",
        name="estimate less fault",
        unit="N*m",
    )


def noisy(traces: Traces, key: str) -> Figure:
    x = _cut(traces[f"noisy_{key}"], (400.0, 1000.0))
    return curves(
        x["t"],
        {NAMES[name]: x[name] for name in ("iesonn", "kalman")},
        title="Estimates with 0.05 N·m·s noise in the momentum",
        name="friction fault",
        unit="N*m",
        truth=x["fault"],
        truth_name="fault d1",
    )


def log_bars(results: Results) -> Figure:
    names = [name for name in LOGS if name in results["identification"]]
    values = [list(results["identification"][name]["rmse"].values()) for name in names]
    return bars(
        [LOGS[name] for name in names],
        np.array(values, float),
        title="Free-run error by the log learned from",
        name="RMSE of torque",
        unit="N*m",
    )


def severity(traces: Traces) -> Figure:
    x = _cut(traces["severity"], (450.0, 1000.0))
    sizes = [name for name in x if name not in ("t", "output")]
    return curves(
        x["t"],
        {
            **{f"input fault {size} N·m": x[size] for size in sizes},
            "output fault 0.1 N·m": x["output"],
        },
        title="Residual over time for faults of several sizes",
        name="residual of T",
        unit="N*m",
    )


def channels(traces: Traces) -> Figure:
    window = (450.0, 700.0)
    written, said = (_cut(traces[f"mode2_{name}"], window) for name in ("as_written", "as_said"))
    pairs = {
        "torque_residual": ("torque residual", "N*m"),
        "momentum_residual": ("momentum residual", "N*m*s"),
        "iesonn": ("IESONN", "N*m"),
    }
    return panels(
        written["t"],
        [
            Panel(label, unit, {"output stuck": written[name], "d(h)/dt stuck": said[name]})
            for name, (label, unit) in pairs.items()
        ],
        title="Two readings of mode 2, three channels",
    )


def torque_form(traces: Traces) -> tuple[Figure, ...]:
    m, c = traces["torque_map"], traces["torque_curves"]
    clip = 0.4  # 1/s: beyond it only the sign matters

    def shown(rate: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        return np.where(np.abs(rate) > clip, np.nan, rate)

    stability = relation(
        m["beta_1"],
        {
            "c = +1, closed form": shown(m["closed_form_plus"]),
            "c = -1, closed form": shown(m["closed_form_minus"]),
        },
        measured={
            "c = +1, simulated": shown(m["simulated_plus"]),
            "c = -1, simulated": shown(m["simulated_minus"]),
        },
        title="Stability of eq (11) closed on torque, beta_2 = 0.04",
        x_name="beta_1",
        x_unit="",
        y_name="growth rate of the fault's error",
        y_unit="1/s",
        limit=0.0,
        limit_name="stable below",
        caption="For c = -1 the rate runs to infinity on either side of beta_1 = 1, where the "
        "algebraic loop cannot be solved: below it grows, above it decays.",
    )
    times = curves(
        c["t"],
        {
            "c = +1, beta_1 = 0.4": c["f_plus_0.4"],
            "c = +1, beta_1 = 1.6": c["f_plus_1.6"],
            "c = -1, beta_1 = 1.6": c["f_minus_1.6"],
            "c = -1, beta_1 = 0.4": np.clip(c["f_minus_0.4"], -0.15, None),
        },
        title="Estimates by eq (11) closed on torque",
        name="estimate",
        unit="N*m",
        truth=np.full(len(c["t"]), 0.1),
        truth_name="fault",
    )
    return stability, times
