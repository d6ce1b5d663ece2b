"""The report of the demonstration."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from faultgauge.detection.answer.evidence import evidence
from faultgauge.detection.posterior.verdicts import NOT_JUDGED, STALE
from faultgauge.reporting.calibration_chapter import calibration_section
from faultgauge.reporting.chapters import (
    envelope_figure,
    estimate_section,
    evaluation_section,
    fit_sections,
)
from faultgauge.reporting.decision_chapter import decision_report, leading
from faultgauge.reporting.model_figures import learned_curve
from faultgauge.reporting.network_curves import curve
from faultgauge.reporting.report import Report, Section, Table
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import fault_estimate
from faultgauge_studies.drive import FAULT, PULSE, Drive, DriveLogs

__all__ = ["drive_report", "friction_figure", "rows", "told"]

GIVEN = (
    "Here the pulse is part of the inputs, so that what is off is the model's own error; the "
    "healthy model beside the measured position, elsewhere, does not know of it."
)


def rows(drives: Mapping[str, Drive]) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """The short table: what was asked, and each body's answer."""
    first = next(iter(drives.values())).figures
    labels = {
        "free_run_rmse_mm": ("free-run position RMSE, pulse given", "mm", ".2f"),
        "pulse_rmse_v": ("pulse estimate, RMSE after settling", "V", ".3f"),
        "pulse_rmse_share": (f"... as a share of {PULSE:g} V", "%", ".2f"),
        "settling_median_s": ("settling to 5 %, median", "s", ".3f"),
        "settling_max_s": ("settling to 5 %, worst", "s", ".3f"),
        "half_periods_wrong": (f"half periods judged wrong, of {first['half_periods']}", "", "d"),
        "events_on_held_out_nominal": ("false alarms on the held-out healthy part", "", "d"),
        "eso_pulse_rmse_v": ("an ESO alone: RMSE after settling", "V", ".3f"),
        "eso_settling_max_s": ("an ESO alone: settling to 5 %, worst", "s", ".3f"),
    }
    body = tuple(
        (
            label,
            *(_shown(drive.figures[key], unit, form) for drive in drives.values()),
        )
        for key, (label, unit, form) in labels.items()
    )
    return ("", *(f"friction by {name}" for name in drives)), body


def _shown(value: float, unit: str, form: str) -> str:
    value = 100 * value if unit == "%" else value
    return f"{value:{form}} {unit}".rstrip() if np.isfinite(value) else "not at every edge"


def told(drive: Drive) -> str:
    """The first answer, and how many there are."""
    first, *_ = leading(drive.bank, [drive.decision])
    more = len(drive.decision.events) - 1
    return f"{first}, and {more} more events" if more > 0 else first


def drive_report(logs: DriveLogs, drives: Mapping[str, Drive]) -> Report:
    """The answer, the estimates against the truth, the free runs, what was learned."""
    header, body = rows(drives)
    network = drives["network"]
    summary = (
        f"Positioning drive, {logs.source}, a {PULSE:g} V pulse hidden every second: "
        f"{told(network)}.",
        f"The pulse was estimated to {network.figures['pulse_rmse_v']:.3f} V (RMSE after "
        f"settling, {100 * network.figures['pulse_rmse_share']:.2f} %), {_settled(network)}.",
        f"{network.figures['half_periods'] - network.figures['half_periods_wrong']} of "
        f"{network.figures['half_periods']} half periods were judged right; "
        f"{network.figures['events_on_held_out_nominal']} false alarms on the healthy part that "
        "neither fit nor calibration had seen.",
    )
    chapters = {name: _chapters(logs, drive, name) for name, drive in drives.items()}
    seen = {"q": network.predictions[0].x[:, 0], "v": network.predictions[0].x[:, 1]}
    seen["u"] = logs.faulty.columns["u"] + logs.pulse
    covered = envelope_figure(network.whole, network.account, seen)
    first, *others = chapters.pop("network")
    sections = (
        first,
        Section("In newtons", (), (), (newtons_figure(logs, network),)),
        Section("What was learned", (), (), (friction_figure(drives),)),
        *others,
        *(replace(each, folded=True) for found in chapters.values() for each in found),
        Section("Envelope: training against the faulty record", (), (), covered, folded=True),
    )
    return Report(
        "A fault in a real drive, in volts and newtons",
        summary,
        sections,
        Table(header, body),
    )


def _chapters(logs: DriveLogs, drive: Drive, name: str) -> list[Section]:
    """One body's: what was decided, and folded, why to believe it."""
    truth = {FAULT: logs.pulse}
    windows = [evidence(drive.bank, drive.decision, e) for e in drive.decision.events[:1]]
    decided = decision_report(drive.bank, [drive.decision], (), windows, truth)
    alone = estimate_section(drive.observers.model, [drive.alone], drive.observers, "free", truth)
    free = evaluation_section(drive.whole, drive.scores, drive.predictions)
    believed = (
        calibration_section(drive.bank, drive.calibration.blocks),
        replace(free, paragraphs=(*free.paragraphs, GIVEN)),
        fit_sections(drive.whole, drive.account)[0],
        replace(alone, title="An ESO alone"),
    )
    sections = (*decided.sections, *(replace(each, folded=True) for each in believed))
    return [replace(each, title=f"{each.title}: friction by {name}") for each in sections]


def _settled(drive: Drive) -> str:
    """How soon the edges are followed."""
    longest = drive.figures["settling_max_s"]
    return (
        f"each edge within {longest:.3f} s"
        if np.isfinite(longest)
        else "but some edges did not settle"
    )


def newtons_figure(logs: DriveLogs, drive: Drive) -> Figure:
    """The pulse as a force: the motor's constant times its voltage."""
    gtau = float(drive.whole.plant.parameters["gtau"])
    found = drive.decision.posterior
    return fault_estimate(
        logs.faulty.t,
        gtau * found.f[:, 0],
        gtau * found.lo[:, 0],
        gtau * found.hi[:, 0],
        limit=None,
        name="force of the pulse",
        unit="N",
        truth=gtau * logs.pulse,
        events=[(e.onset, e.end) for e in drive.decision.events],
        not_judged=np.isin(drive.decision.status, [NOT_JUDGED, STALE]),
        probable=True,
    )


def friction_figure(drives: Mapping[str, Drive]) -> Figure:
    """Friction against speed: the network's, the physics' dashed, the data behind."""
    physics, network = drives["physics"].whole.plant, drives["network"].whole.plant
    samples = drives["network"].account.training
    p = {name: float(value) for name, value in physics.parameters.items()}
    n = {name: float(value) for name, value in network.parameters.items()}
    speed = samples.x[:, network.signals.state_names.index("v")]
    pull = samples.dx[:, network.signals.state_names.index("v")]
    data = n["gtau"] * samples.u[:, 0] - n["M"] * pull
    grid = np.linspace(speed.min(), speed.max(), 400)
    learned = n["Fv"] * grid - n["M"] * curve(network, "friction", grid[:, None])
    known = p["Fv"] * grid + p["Fc"] * np.sign(grid) + p["offset"]
    return learned_curve(
        grid,
        learned,
        speed,
        data,
        x_name="speed v",
        x_unit="m/s",
        y_name="friction force",
        y_unit="N",
        reference=known,
    )
