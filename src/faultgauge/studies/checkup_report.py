"""The report of `check`."""

from faultgauge.identification.evaluation import evaluate
from faultgauge.reporting.chapters import (
    calibration_report,
    estimate_section,
    evaluation_section,
    fit_sections,
)
from faultgauge.reporting.report import Report
from faultgauge.studies.checkup import Checkup

__all__ = ["checkup_report"]


def checkup_report(checkup: Checkup) -> Report:
    """The answer first, then the estimates, then why to believe them."""
    model = checkup.model
    found, predictions = evaluate(model.plant, checkup.held_out, model.max_step)
    calibration = calibration_report(checkup.calibration)
    warnings = (*checkup.account.warnings, *checkup.calibration.warnings)
    return Report(
        f"Check: {model.plant.spec.name}",
        (*checkup.sentences[:5], *calibration.summary_sentences[:1], *(f"{w}." for w in warnings)),
        (
            estimate_section(model, checkup.judgements, checkup.bank, "free"),
            evaluation_section(model, found, predictions),
            *calibration.sections,
            *fit_sections(model, checkup.account),
        ),
    )
