"""What the study set out to reach, beside what the paper states, checked against results.json."""

from dataclasses import dataclass
from typing import Any, Literal

__all__ = ["GOALS", "Goal", "found", "met"]


@dataclass(frozen=True)
class Goal:
    """`statistic` of the figure at `path` is to be at most (or least) `bound`; where `times`
    names another figure, `bound` is in units of its median."""

    label: str
    path: str
    statistic: Literal["median", "min", "max"]
    sense: Literal["<=", ">="]
    bound: float
    unit: str = "N*m"
    times: str = ""
    paper: str = ""


GOALS = (
    Goal(
        "free-run RMSE of torque",
        "identification.gbnnm.rmse",
        "median",
        "<=",
        1.05,
        times="floor.rms_f",
        paper="2.7e-3",
    ),
    Goal("... R²", "identification.gbnnm.r2", "median", ">=", 0.99999, "", paper="0.9999"),
    Goal("... R², worst seed", "identification.gbnnm.r2", "min", ">=", 0.9999, ""),
    Goal("model error without f(t)", "without_f.model_error.gbnnm.rmse", "median", "<=", 2e-4),
    *(
        Goal(
            f"residual against the desired one, {name}",
            f"residual.{key}.rmse_to_desired.gbnnm",
            "median",
            "<=",
            bound,
        )
        for key, name, bound in (
            ("mode1_sustained", "mode 1 sustained", 5e-4),
            ("mode1_intermittent", "mode 1 intermittent", 5e-4),
            ("mode2_sustained", "mode 2 sustained", 2e-4),
            ("mode2_intermittent", "mode 2 intermittent", 2e-4),
        )
    ),
    *(
        Goal(
            f"... {name}, worst seed",
            f"residual.{key}.rmse_to_desired.gbnnm",
            "max",
            "<=",
            2e-3,
        )
        for key, name in (
            ("mode1_sustained", "mode 1 sustained"),
            ("mode1_intermittent", "mode 1 intermittent"),
            ("mode2_sustained", "mode 2 sustained"),
            ("mode2_intermittent", "mode 2 intermittent"),
        )
    ),
    *(
        Goal(label.format(name), path.format(key), "median", "<=", bound, unit)
        for key, name in (("mode1_sustained", "sustained"), ("mode1_intermittent", "intermittent"))
        for label, path, bound, unit in (
            ("IESONN from 50 s after a jump, {}", "fault_estimate.{}.iesonn.rmse", 5e-4, "N*m"),
            ("... less ESO, {}", "fault_estimate.{}.iesonn_minus_eso.rmse", 1.5e-4, "N*m"),
            ("... settling to 5 %, {}", "fault_estimate.{}.iesonn.settling_s", 30.0, "s"),
            ("... overshoot, {}", "fault_estimate.{}.iesonn.overshoot", 0.01, ""),
            (
                "... with 0.05 N*m*s noise in h, {}",
                "fault_estimate_noisy.{}.iesonn.rmse",
                3e-3,
                "N*m",
            ),
        )
    ),
    *(
        Goal(label, f"accommodation.estimate_and_friction.{key}", "max", "<=", bound, "deg")
        for label, key, bound in (
            ("pitch under eq (17), accommodated, RMS, worst seed", "rms_deg", 0.04),
            ("... peak, worst seed", "peak_deg", 0.15),
        )
    ),
)


def found(results: dict[str, Any], path: str) -> dict[str, float | None]:
    """The {median, min, max} at a dotted path of results.json."""
    value: Any = results
    for key in path.split("."):
        value = value[key]
    return value


def met(goal: Goal, results: dict[str, Any]) -> bool:
    value = found(results, goal.path)[goal.statistic]
    if value is None:
        return False
    bound = goal.bound
    if goal.times:
        bound *= found(results, goal.times)["median"] or 0.0
    return value <= bound if goal.sense == "<=" else value >= bound
