"""Four policies under eq (17), and the same four without a fault."""

from dataclasses import replace
from typing import Any

import numpy as np

from faultgauge.accommodation.policy import POLICIES
from faultgauge.plants.model import Model
from faultgauge.reporting.report import Section, Table
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, curves, panels
from faultgauge.simulation.satellite.loop import Telemetry
from faultgauge.simulation.schedules import truth
from faultgauge_studies.paper.accommodating.setting import (
    adrc,
    beneath,
    by_posterior,
    calibrated,
    fly,
)
from faultgauge_studies.paper.bench import Bench, Traces
from faultgauge_studies.paper.cases import CASES, ONSET
from faultgauge_studies.paper.learning import PITCH, rms
from faultgauge_studies.paper.tables import Results, milli, span

__all__ = ["CASE", "NAMES", "measure", "pitch", "section"]

NAMES = {
    "none": "none",
    "estimate": "-fhat",
    "estimate_and_friction": "-fhat and friction",
    "adrc": "ADRC",
}
CASE = CASES["mode1_intermittent"]
QUIET = 400.0  # s: the slew is over, and all estimates have settled


def pitch(flown: Telemetry) -> np.ndarray:
    """The true pitch angle, deg."""
    return np.rad2deg(np.asarray(flown.attitude[:, PITCH]))


def measure(bench: Bench, model: Model) -> tuple[dict[str, Any], Traces]:
    """Pitch from the onset on, and what the estimates look like when nothing is wrong."""
    figures: dict[str, Any] = {}
    drawn: dict[str, Any] = {}
    for name in POLICIES:
        policy = beneath(adrc(bench) if name == "adrc" else by_posterior(model, name))
        flown = fly(bench, policy, CASE.fault)
        healthy = fly(bench, policy)
        figures[name] = {**_scores(flown), **_healthy(healthy)}
        drawn |= {
            f"pitch_{name}": pitch(flown),
            f"u_{name}": np.asarray(flown.u[:, PITCH]),
            f"f_{name}": np.asarray(flown.info.f[:, PITCH, 0]),
            f"engaged_{name}": np.asarray(flown.info.engaged[:, PITCH, 0], float),
        }
        drawn["t"] = np.asarray(flown.t)
    true = replace(bench.learned.model, plant=bench.wheel)
    physics = calibrated(true, bench.wheel, bench.seed)
    policy = beneath(by_posterior(physics, "estimate_and_friction"))
    over_physics = fly(bench, policy, CASE.fault)
    figures["estimate_and_friction_over_physics"] = _scores(over_physics)
    drawn["fault"] = truth(CASE.fault, drawn["t"])
    return {"accommodation": figures}, {"accommodation": drawn}


def _scores(flown: Telemetry) -> dict[str, float]:
    after = flown.t >= ONSET
    angle = pitch(flown)[after]
    acted = np.flatnonzero(flown.info.engaged[after, PITCH, 0])
    late = float(flown.t[after][acted[0]] - ONSET) if acted.size else np.inf
    return {
        "peak_deg": float(np.abs(angle).max()),
        "rms_deg": rms(angle),
        "acted_after_s": late,
        "largest_compensation": float(np.abs(flown.info.c[after, PITCH, 0]).max()),
    }


def _healthy(flown: Telemetry) -> dict[str, float]:
    """RMS without a fault, how long any fault was acted upon, and the largest estimate."""
    after = flown.t >= QUIET
    step = float(flown.t[1] - flown.t[0])
    return {
        "healthy_rms_deg": rms(pitch(flown)[flown.t >= ONSET]),
        "healthy_acted_s": float(flown.info.engaged[:, PITCH, 0].sum() * step),
        "healthy_estimate": float(np.abs(flown.info.f[after, PITCH, 0]).max()),
    }


def section(results: Results, traces: Traces) -> Section:
    found = results["accommodation"]
    hidden = found["adrc"]["healthy_estimate"]["median"]
    seen = found["estimate"]["healthy_estimate"]["median"]
    return Section(
        "Accommodation: four policies under eq (17)",
        (
            "The posterior over the learned plant, which knows of friction and of a loss of "
            "effectiveness, is acted upon inside the loop, by every wheel for itself. With -fhat "
            "the wheel does what it would do without the fault; its known friction still holds the "
            "satellite off, because the controller has no integral. With the learned friction fed "
            "forward as well that goes too. A fault is acted upon while it is named; what that "
            "may do is bounded in size and slope.",
            "ADRC cancels whatever differs from an ideal wheel, at once and without a decision, by "
            "an observer of its own. It hides degradation: with nothing wrong its "
            f"estimate stands at {1e3 * (hidden or 0):.2g} mN·m, friction and all, where the "
            f"learned reference shows {1e3 * (seen or 0):.2g} mN·m. A fault of that size would "
            "pass unnamed.",
        ),
        (_table(found),),
        _figures(traces["accommodation"]),
    )


def _table(found: Results) -> Table:
    rows = []
    for name, label in {**NAMES, "estimate_and_friction_over_physics": "... over physics"}.items():
        each = found[name]
        late = "-" if name == "adrc" else span(each["acted_after_s"], ".3g")
        idle = each.get("healthy_estimate")
        rows.append(
            (
                label,
                span(each["rms_deg"], ".3f"),
                span(each["peak_deg"], ".3f"),
                late,
                span(each["healthy_rms_deg"], ".3f") if idle else "-",
                span(milli(idle), ".2g") if idle else "-",
            )
        )
    header = (
        "policy",
        "RMS (deg)",
        "peak (deg)",
        "acted after (s)",
        "healthy: RMS (deg)",
        "fhat (mN·m)",
    )
    return Table(header, tuple(rows), "Pitch from 500 s on.")


def _figures(x: Any) -> tuple[Figure, ...]:
    late = x["t"] >= ONSET - 50
    angle = {label: x[f"pitch_{name}"][late] for name, label in NAMES.items()}
    torque = {label: x[f"u_{name}"][late] for name, label in NAMES.items()}
    estimate = {NAMES[name]: x[f"f_{name}"][late] for name in ("estimate_and_friction", "adrc")}
    acted = {"acted upon": x["engaged_estimate_and_friction"][late]}
    t, fault = x["t"][late], x["fault"][late]
    return (
        curves(t, angle, title="Pitch under eq (17), four policies", name="pitch", unit="deg"),
        panels(
            t,
            [
                Panel("command u", "N*m", torque),
                Panel("estimate", "N*m", estimate, fault, "fault d1"),
                Panel("decision", "", acted),
            ],
            title="Command, estimate and decision",
            caption="ADRC's estimate is the fault and the wheel's friction together.",
        ),
    )
