"""The report of `check`."""

from dataclasses import replace

from faultgauge.detection.answer.evidence import evidence
from faultgauge.identification.validation.evaluation import evaluate
from faultgauge.reporting.calibration_chapter import calibration_section, proof
from faultgauge.reporting.chapters import evaluation_section, fit_sections
from faultgauge.reporting.decision_chapter import decision_report, unjudged_report
from faultgauge.reporting.report import Report
from faultgauge.reporting.words.answer import shown_first
from faultgauge.verbs.checkup import Checkup

__all__ = ["checkup_report"]


def checkup_report(checkup: Checkup) -> Report:
    """The answer and its evidence; why to believe them is folded."""
    model = checkup.model
    decided = _decided(checkup)
    found, predictions = evaluate(
        model.plant, checkup.held_out, model.max_step, between=model.record.between
    )
    warnings = (*checkup.account.warnings, *checkup.calibration.warnings)
    believed = [evaluation_section(model, found, predictions)]
    if checkup.bank:
        believed.append(calibration_section(checkup.bank, checkup.calibration.blocks))
    believed += fit_sections(model, checkup.account)
    return Report(
        f"Check: {model.plant.spec.name}",
        (
            *decided.summary_sentences,
            *((proof(model),) if checkup.bank else ()),
            *(f"Warning: {warning}." for warning in warnings),
        ),
        (
            *decided.sections,
            *(replace(each, folded=True) for each in believed),
        ),
    )


def _decided(checkup: Checkup) -> Report:
    """What `estimate` would report."""
    bank = checkup.bank
    if bank is None:
        return unjudged_report(checkup.model, checkup.decisions, checkup.sentences[0])
    shown = shown_first(bank, checkup.decisions)
    windows = [evidence(bank, each, event) for each, event in shown]
    return decision_report(bank, checkup.decisions, (), windows)
