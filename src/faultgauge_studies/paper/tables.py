"""Tables and sentences of the study, from its numbers over all seeds."""

from collections.abc import Mapping
from typing import Any

from faultgauge.reporting.report import Table
from faultgauge_studies.paper.cases import MODE_1

__all__ = [
    "LOGS",
    "NAMES",
    "Results",
    "channel_table",
    "continuity",
    "estimate_table",
    "jump_table",
    "log_table",
    "milli",
    "noise_table",
    "reach",
    "severity_table",
    "span",
]

Results = Mapping[str, Any]
NAMES = {
    "eso": "ESO (true wheel)",
    "iesonn": "IESONN (learned)",
    "kalman": "Kalman filter, equal noise",
    "residual": "residual, free reference",
    "residual_measured_state": "residual, measured state",
}
SHORT = {
    "mode1_sustained": "mode 1",
    "mode1_intermittent": "eq (17)",
    "mode2_sustained": "mode 2",
    "mode2_intermittent": "eq (19)",
}
LOGS = {
    "gbnnm": "noise with sweep, 1000 s",
    "gbnnm_multisine_with_sweep": "multisine with sweep, 1000 s",
    "gbnnm_gradient_descent": "noise with sweep, by gradient descent",
    "gbnnm_noise_alone": "noise alone, 1000 s",
    "gbnnm_normal_1day": "normal operation, 1 day",
    "gbnnm_normal_1h": "normal operation, 1 hour",
    "gbnnm_normal_10min": "normal operation, 10 minutes",
}


def span(values: Mapping[str, float | None], form: str = ".3g", unit: str = "") -> str:
    """Median [smallest, largest], or what all of them are."""
    each = ["never" if x is None else format(x, form) for x in values.values()]
    reach = "" if len(set(each)) == 1 else f" [{each[1]}, {each[2]}]"
    return f"{each[0]}{reach} {unit}".strip()


def milli(values: Mapping[str, float | None]) -> dict[str, float | None]:
    """A figure and its range in thousandths of the unit."""
    return {name: None if x is None else 1e3 * x for name, x in values.items()}


def reach(results: Results) -> str:
    """The envelope covered, and what it is worth, in a sentence."""
    sweep, r2 = results["coverage"]["noise_with_sweep"], results["identification"]["gbnnm"]["r2"]
    text = (
        f"The experiment reaches {sweep['h_share']['median']:.0%} of |h| ≤ 150 N·m·s and fills "
        f"{sweep['cells']['median']:.0%} of the cells of (h, u); free run on the flight below: "
        f"R² {r2['median']:.6f}."
    )
    if "noise_alone" not in results["coverage"]:
        return text
    noise, r2 = results["coverage"]["noise_alone"], results["identification"]["gbnnm_noise_alone"]
    return (
        f"{text} The same noise without the sweep reaches {noise['h_share']['median']:.0%} and "
        f"fills {noise['cells']['median']:.0%}; R² {r2['r2']['median']:.6f}."
    )


def continuity(results: Results) -> str:
    """Fig 10's claim, in numbers."""
    steps = results["residual"]["mode2_sustained"]["largest_step"]
    u, yhat, y = (steps[name]["median"] for name in ("u", "yhat", "y"))
    return (
        f"From one control period to the next (0.25 s) the command changes by at most {u:.3g} "
        f"N·m and the model's output by {yhat:.3g} N·m, while the wheel's output jumps by "
        f"{y:.3g} N·m: the paper's claim that u and yhat stay bounded and continuous holds."
    )


def jump_table(results: Results) -> Table:
    wanted = {
        "mode1_sustained": ("500s",),
        "mode1_intermittent": ("500s", "600s", "700s", "800s"),
        "mode2_sustained": ("500s",),
        "mode2_intermittent": ("500s", "550s", "600s", "650s"),
    }
    injected = {
        "mode1_sustained": (0.1,),
        "mode1_intermittent": (0.1, 0.05, 0.05, -0.2),
        "mode2_sustained": (0.1,),
        "mode2_intermittent": (0.05, 0.03, 0.02, -0.1),
    }
    rows = []
    for key, times in wanted.items():
        entry = results["residual"][key]
        for time, size in zip(times, injected[key], strict=True):
            grows = span(entry["growth_in_100s"]) if key.endswith("sustained") else "-"
            rows.append(
                (
                    SHORT[key],
                    f"{time[:-1]} s",
                    f"{size:+.2f}",
                    span(entry["jump"][time], "+.4f"),
                    grows,
                )
            )
    return Table(
        (
            "fault",
            "at",
            "change of d (N·m)",
            "jump of the residual (N·m)",
            "|r| 100 s on / at onset",
        ),
        tuple(rows),
        "An output stuck at d2 jumps by d2 less the torque that it overwrites. The text's claim "
        "that a full loss grows and a partial one decays is the last column.",
    )


def estimate_table(results: Results) -> Table:
    rows = []
    for key in MODE_1:
        for name, label in NAMES.items():
            q = results["fault_estimate"][key][name]
            rows.append(
                (
                    SHORT[key],
                    label,
                    span(q["rmse"]),
                    span(q["settling_s"], ".1f"),
                    span(q["overshoot"], ".2%"),
                )
            )
    return Table(
        ("fault", "estimator", "RMSE (N·m)", "settling to 5 % (s)", "overshoot"),
        tuple(rows),
        "Without measurement noise. RMSE from 50 s after each jump; settling and overshoot are the "
        "worst of all jumps, in units of the jump.",
    )


def noise_table(results: Results) -> Table:
    noise = results["fault_estimate_noisy"]
    rows = [
        (SHORT[key], NAMES[name], span(noise[key][name]["rmse"]))
        for key in MODE_1
        for name in ("eso", "iesonn", "kalman")
    ]
    bound = noise["cramer_rao_50s"]["median"]
    return Table(
        ("fault", "estimator", "RMSE (N·m)"),
        tuple(rows),
        f"With 0.05 N·m·s white noise in the momentum at 4 Hz. No unbiased estimate from a window "
        f"of 50 s can be better than {bound:.3g} N·m (Cramér-Rao, constant fault, unknown start): "
        "what lies between is the price of following jumps.",
    )


def log_table(results: Results) -> Table:
    rows = []
    for name, label in LOGS.items():
        if name not in results["identification"]:
            continue
        log = name.removeprefix("gbnnm_") if name != "gbnnm" else "noise_with_sweep"
        seen, score = results["coverage"][log], results["identification"][name]
        rows.append(
            (
                label,
                span(seen["h_share"], ".1%"),
                span(seen["cells"], ".1%"),
                span(score["r2"], ".6f"),
            )
        )
    return Table(("log", "of |h| ≤ 150", "cells of (h, u)", "R² of torque"), tuple(rows))


def severity_table(results: Results) -> Table:
    rows = tuple(
        (f"{size} N·m", span(entry["at_onset"], ".4f"), span(entry["after_400s"], ".4f"))
        for size, entry in results["severity"]["input_fault"].items()
    )
    return Table(("input fault", "r at the onset (N·m)", "r 400 s later (N·m)"), rows)


def channel_table(results: Results) -> Table:
    labels = {
        "torque_residual": ("torque residual, free reference", "N·m"),
        "momentum_residual": ("momentum residual, free reference", "N·m·s"),
        "iesonn": ("IESONN, closed on momentum", "N·m"),
    }
    seen = results["mode2_channels"]
    rows = tuple(
        (
            label,
            span(seen["as_written"][name], ".4g", unit),
            span(seen["as_said"][name], ".4g", unit),
        )
        for name, (label, unit) in labels.items()
    )
    return Table(
        ("100 s after the onset", "output stuck (eq 18)", "d(h)/dt stuck (text)"),
        rows,
        "Change against the time before the onset.",
    )
