"""The demonstration's report: a real drive first, then the satellite's wheel."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from faultgauge.reporting.report import Report
from faultgauge_studies.drive import Drive, DriveLogs
from faultgauge_studies.drive_report import drive_report
from faultgauge_studies.paper.bench import Traces
from faultgauge_studies.paper.report import wheel_sections

__all__ = ["demonstration_report", "wheel_rows"]

Results = dict[str, Any]


def demonstration_report(
    logs: DriveLogs, drives: Mapping[str, Drive], results: Results, traces: Traces
) -> Report:
    """The drive's report with the wheel's estimates behind it, and behind both what is folded."""
    drive = drive_report(logs, drives)
    quality = results["fault_estimate"]["mode1_intermittent"]["iesonn"]
    wheel = (
        "Reaction wheel of a simulated satellite in closed loop: friction faults of 0.1 to 0.2 "
        f"N·m were estimated to {1e3 * quality['rmse']['median']:.2f} mN·m (RMSE from 50 s after "
        f"each jump), each jump within {quality['settling_s']['median']:.1f} s."
    )
    sections = [replace(s, title=f"Drive: {s.title}") for s in drive.sections]
    *before, estimates = wheel_sections(results, traces)
    folded = [replace(s, folded=True) for s in before]
    sections += [replace(s, title=f"Wheel: {s.title}") for s in (estimates, *folded)]
    return replace(
        drive,
        title="Two faults under closed loops, in volts, newtons and newton metres",
        summary_sentences=(*drive.summary_sentences, wheel),
        sections=tuple(sorted(sections, key=lambda s: s.folded)),
    )


def wheel_rows(results: Results) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """The short table: what was asked, and the answer."""
    model, floor = results["identification"]["gbnnm"], results["floor"]["rms_f"]["median"]
    estimates = results["fault_estimate"]["mode1_intermittent"]
    body = (
        ("free-run torque RMSE, fault-free flight", f"{1e3 * model['rmse']['median']:.3f} mN·m"),
        ("... of it a disturbance that no model can know", f"{1e3 * floor:.3f} mN·m"),
        *(
            (f"fault estimate, RMSE, {label}", f"{1e3 * estimates[key]['rmse']['median']:.3f} mN·m")
            for key, label in (("eso", "true wheel (ESO)"), ("iesonn", "learned wheel (IESONN)"))
        ),
        ("settling to 5 %, worst jump", f"{estimates['iesonn']['settling_s']['median']:.1f} s"),
    )
    return ("", "seed 0"), body
