"""The chapters on the model that judged: what was fitted, to which logs, and what calibration
found."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.identification.constants import ConstantsInformation, FittedConstant
from faultgauge.identification.fit_record import of_spread
from faultgauge.plants.model import Model
from faultgauge.reporting.calibration_chapter import calibration_section, intervals_section
from faultgauge.reporting.refinement_chapter import correlation_table, parameter_table
from faultgauge.reporting.report import Report, Section, Table

__all__ = ["with_model"]

HASH = 12  # hexadecimal digits of a run's hash, enough to tell any two runs apart
MOST_RUNS = 12  # rows of the table of runs
PARAMETERS = (
    "Fitted parameters, with their standard errors. Which of them stand at a bound, and which a "
    "network can imitate, the report of `faultgauge fit` tells."
)


def with_model(report: Report, model: Model, bank: FaultBank | None = None) -> Report:
    """`report` with folded chapters behind it on the `model`, and on its calibration, which that of
    its `bank` is where it has one."""
    known = model.calibration
    sections = [_model_section(model)]
    if bank is not None:
        sections.append(calibration_section(bank))
    elif known is not None and known.channels is not None:
        sections.append(intervals_section(model, known.channels))
    folded = (replace(each, folded=True) for each in sections)
    return replace(report, sections=(*report.sections, *folded))


def _model_section(model: Model) -> Section:
    """What was fitted, how well, and to which logs."""
    known, error = _constants(model), model.record.metrics.free_run_error
    said = "Nobody fitted it: its values are those of the plant file."
    if np.isfinite(error):
        said = (
            "On data that it was not fitted to, its free run is off by "
            f"{of_spread(error, len(model.plant.signals.outputs))}."
        )
    tables = (*parameter_table(known, PARAMETERS), *correlation_table(known), *_runs(model))
    return Section("The model", (said,), tables)


def _constants(model: Model) -> ConstantsInformation:
    """What the record tells of the fitted constants."""
    told, plant = model.record.constants, model.plant
    errors = told.standard_errors or told.errors
    spec = {each.name: each for each in plant.spec.parameters}
    # how far runs have their own of what varies from run to run is told elsewhere
    rows = tuple(
        FittedConstant(
            name,
            spec[name].unit,
            float(plant.parameters[name]),
            None if spec[name].vary == "run" else error,
            None,
            None,
        )
        for name, error in zip(told.names, errors, strict=True)
    )
    correlation = np.array(told.correlation, dtype=float).reshape(len(rows), len(rows))
    return ConstantsInformation(rows, correlation, (), 1.0)


def _runs(model: Model) -> tuple[Table, ...]:
    """Which runs it comes from, by their hashes: those of the same samples are the same."""
    data, known = model.record.data, model.calibration
    used = (
        ("fitted to", data.fit),
        ("validated on", data.validate_),
        ("calibrated on", [] if known is None else known.data),
    )
    rows = [row for what, hashes in used for row in _hashes(what, hashes)]
    caption = "The runs behind it; runs of the same samples have the same hash."
    return (Table(("", "hash of the run"), tuple(rows), caption),) if rows else ()


def _hashes(what: str, hashes: Sequence[str]) -> list[tuple[str, str]]:
    shown = [(what, each[:HASH]) for each in hashes[:MOST_RUNS]]
    more = len(hashes) - len(shown)
    return [*shown, (what, f"{more} more")] if more > 0 else shown
