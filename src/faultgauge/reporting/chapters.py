"""What each command puts into its report, from the results that it has anyway."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from faultgauge.detection.answer.estimation import Estimated
from faultgauge.detection.bank.bank import build_fault_bank
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.calibration.calibration import Calibration
from faultgauge.detection.rows.judged import Bank
from faultgauge.detection.rows.residual import Reference
from faultgauge.detection.words import duration
from faultgauge.identification.fit import FitReport
from faultgauge.identification.unseen import Unseen
from faultgauge.identification.validation.evaluation import Prediction, at_samples, divergence
from faultgauge.plants.model import Model
from faultgauge.reporting.calibration_chapter import calibration_section, intervals_section
from faultgauge.reporting.model_figures import envelope, fit_history
from faultgauge.reporting.network_curves import network_figures
from faultgauge.reporting.refinement_chapter import (
    correlation_table,
    parameter_table,
    refinement_section,
)
from faultgauge.reporting.report import Report, Section, Table
from faultgauge.reporting.scales import noise_scales
from faultgauge.reporting.style import quantity
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import fault_estimate, free_run, residual
from faultgauge.reporting.validation_chapter import noise_table, validation_section
from faultgauge.reporting.words.calibration import errors
from faultgauge.reporting.words.unjudged import observer_sentence
from faultgauge.telemetry import Run

__all__ = [
    "calibration_report",
    "envelope_figure",
    "estimate_report",
    "estimate_section",
    "evaluation_report",
    "evaluation_section",
    "fit_report",
    "fit_sections",
]

REFITTED = (
    "Since the log is short, the model in the file was then fitted to these data as well; all that "
    "is said of unseen data here is about the model before that."
)
CROWDED = (
    "{}: arguments seldom leave a small part of their range, and every other start has its units "
    "there; the one that was kept {}."
)
KEPT = {True: "has", False: "has them over the whole range"}
PARAMETERS = (
    "By equation error: how far other logs would scatter the parameters, not the bias that noise "
    "in the states leaves. A parameter at its bound has the file's value, not the data's; one that "
    "a network can imitate is not identifiable."
)
WEAK_FORM = (
    "Fitted in the weak form, which averages an equation over the smoothing's kernel, as its free "
    "run was the better one: {}."
)
MOST_FIGURES = 12  # per section: a report is read, not scrolled


def fit_report(
    model: Model, account: FitReport, unseen: Unseen | None, *, given: bool = False
) -> Report:
    """The report of `fit`; `unseen` are its free runs over held-out data, `given` for validation
    or cut from the logs."""
    error = model.record.metrics.free_run_error
    summary = (
        f"{model.plant.spec.name}: on data that it was not fitted to, the model's free run is off "
        f"by {account.free_run(error)}.",
        *(f"Warning: {warning}." for warning in account.warnings),
    )
    sections = fit_sections(model, account)
    if unseen is not None:
        runs = evaluation_section(model, unseen.scores, unseen.predictions)
        checked = validation_section(model.plant, unseen.validation, unseen.predictions)
        origin = "the logs given for validation" if given else "the last 15 % of every stretch"
        note = (
            f"The unseen data are {origin}. No weight was fitted to them, but they chose among "
            "the starts; a log that had no part at all is a harder test: `faultgauge evaluate`."
        )
        if account.refinement is not None and account.refinement.refitted:
            note += f" {REFITTED}"
        floor = noise_table(model, unseen.validation)
        checked = replace(
            checked, paragraphs=(note, *checked.paragraphs), tables=(*checked.tables, *floor)
        )
        sections = (runs, checked, *sections)
    return Report(f"Fit: {model.plant.spec.name}", summary, sections, _parameters(model))


def fit_sections(model: Model, account: FitReport) -> tuple[Section, ...]:
    """Training: cost per trial, the points that were covered, what the networks learned."""
    histories = []
    for each in account.groups:
        costs = [h[np.isfinite(h[:, 0])] for h in each.solution.history]
        figure = fit_history([h[:, 0] for h in costs], [h[:, 1] for h in costs], chosen=each.chosen)
        histories.append(replace(figure, title=f"{figure.title}: {each.group.name}"))
    noise = tuple(
        (
            f"d({state})",
            quantity(row["window_s"], "s"),
            f"{row['derivative_noise']:.3g}",
            f"{100 * row['derivative_noise_share']:.2f} %",
        )
        for state, row in account.noise.items()
    )
    header = ("derivative", "kernel's width", "noise left", "share of its spread")
    known = account.information
    found = (*parameter_table(known, PARAMETERS), *correlation_table(known)) if known else ()
    smoothing = Table(header, noise, "Derivatives by smoothing, and the noise it leaves.")
    tables = (*((smoothing,) if noise else ()), *found)
    starts = (
        "Every start is drawn; the one with the best free run on held-out data is kept, not the "
        "one with the lowest cost.",
        *(
            CROWDED.format(each.group.name, KEPT[each.crowded])
            for each in account.groups
            if each.crowded is not None
        ),
    )
    weak = ", ".join(each.group.name for each in account.groups if each.form == "weak")
    training = Section(
        "Training",
        (*(starts if histories else ()), *((WEAK_FORM.format(weak),) if weak else ())),
        tables,
        (*histories, *envelope_figure(model, account)),
    )
    refined = (refinement_section(account.refinement),) if account.refinement else ()
    learned = network_figures(model, account)
    curves = (Section("What was learned", (), (), learned),) if learned else ()
    return (training, *refined, *curves)


def envelope_figure(
    model: Model, account: FitReport, other: Mapping[str, Float[np.ndarray, "others"]] | None = None
) -> tuple[Figure, ...]:
    """The points that training covered, inputs against states."""
    signals = model.plant.signals
    columns = dict(zip(signals.state_names, account.training.x.T, strict=True))
    columns |= dict(zip(signals.input_names, account.training.u.T, strict=True))
    units = {s.name: s.unit for s in (*signals.states, *signals.inputs)}
    names = list(columns)
    pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]][:4]
    if not pairs:
        return ()
    return (envelope(columns, units, pairs, other=other),)


def evaluation_report(
    model: Model, found: dict[str, Any], predictions: Sequence[Prediction]
) -> Report:
    """The report of `evaluate`."""
    units = {output.name: output.unit for output in model.plant.signals.outputs}
    summary = tuple(
        f"{name}: {divergence(model.plant, predictions)}."
        if s["rmse"] is None
        else f"{name}: free-run RMSE {quantity(s['rmse'], units[name])}"
        + ("." if s["r2"] is None else f", R2 {100 * s['r2']:.4f} %.")
        for name, s in found["outputs"].items()
    )
    summary += tuple(
        f"{name}, mean of the ensemble: free-run RMSE {quantity(s['rmse'], units[name])}; its "
        f"members spread by {quantity(s['spread'], units[name])}."
        for name, s in found.get("ensemble", {}).items()
        if s["rmse"] is not None
    )
    summary += tuple(f"Warning: {warning}." for warning in found["warnings"])
    section = evaluation_section(model, found, predictions)
    return Report(f"Evaluation: {model.plant.spec.name}", summary, (section,), _parameters(model))


def evaluation_section(
    model: Model, found: dict[str, Any], predictions: Sequence[Prediction]
) -> Section:
    """Free runs against the log."""
    outputs, noise = model.plant.signals.outputs, noise_scales(model)
    rows = tuple(
        (
            run["run"],
            name,
            "diverges" if s["rmse"] is None else quantity(s["rmse"], outputs[j].unit),
            "" if s["r2"] is None else f"{s['r2']:.5f}",
            str(run["samples"]),
        )
        for run in found["runs"]
        for j, output in enumerate(outputs)
        for name, s in run["outputs"].items()
        if name == output.name
    )
    figures = [
        free_run(
            p.t,
            p.measured[:, j],
            p.predicted[:, j],
            name=output.name,
            unit=output.unit,
            run=p.run,
            warmup=p.warmup,
            noise=noise[output.name],
            clock=p.clock,
        )
        for whole in predictions
        for j, output in enumerate(outputs)
        if len((p := at_samples(whole, j)).t) > p.warmup
    ]
    header = ("run", "output", "RMSE", "R2", "samples scored")
    anew = _started_anew(model, found)
    said = ["The model runs on the log's inputs alone; its outputs are compared with the log's."]
    tables = [Table(header, rows)]
    if anew:
        said.append(
            "Where a plant integrates or is unstable, small errors add up: the second table has "
            "the errors of free runs that start anew from what is measured."
        )
        tables.append(Table(("run", "output", "starts anew every", "RMSE", "R2"), anew))
    return Section(
        "Free run",
        tuple(said),
        tuple(tables),
        tuple(figures[:MOST_FIGURES]),
    )


def _started_anew(model: Model, found: dict[str, Any]) -> tuple[tuple[str, ...], ...]:
    """Rows of the free runs that start anew, where they were tried."""
    units = {output.name: output.unit for output in model.plant.signals.outputs}
    return tuple(
        (
            run["run"],
            name,
            quantity(run["restarted"]["horizon_s"], "s"),
            "diverges" if s["rmse"] is None else quantity(s["rmse"], units[name]),
            "" if s["r2"] is None else f"{s['r2']:.5f}",
        )
        for run in found["runs"]
        for name, s in run.get("restarted", {}).get("outputs", {}).items()
    )


def calibration_report(found: Calibration, runs: Sequence[Run]) -> Report:
    """The report of `calibrate` on `runs`: the healthy blocks' peaks, the level above them and how
    well each fault can be known; of an observer the intervals of its estimates."""
    known = found.model.calibration
    assert known is not None
    warnings = tuple(f"Warning: {warning}." for warning in found.warnings)
    if known.bank is not None:
        bank = build_fault_bank(found.model, runs, noise_of(found.model))
        section = calibration_section(bank, found.blocks)
        said = (f"{line[0].upper()}{line[1:]}." for line in errors(found.model))
        head = (*section.paragraphs[:1], *said, *warnings)
        section = replace(section, paragraphs=section.paragraphs[1:])
        return Report(f"Calibration: {found.model.plant.spec.name}", head, (section,))
    summary = (f"From {duration(known.judged_s or 0.0)} of healthy logs.", *warnings)
    section = intervals_section(found.model, known.channels or {})
    return Report(f"Calibration: {found.model.plant.spec.name}", summary, (section,))


def estimate_report(
    model: Model, estimated: Sequence[Estimated], bank: Bank, reference: Reference
) -> Report:
    """The report of `estimate --observer`: estimates with their intervals, residuals."""
    section = estimate_section(model, estimated, bank, reference)
    return Report(
        f"Fault estimates: {model.plant.spec.name}", (observer_sentence(model),), (section,)
    )


def estimate_section(
    model: Model,
    estimated: Sequence[Estimated],
    bank: Bank,
    reference: Reference,
    truth: Mapping[str, Float[np.ndarray, "samples"]] | None = None,
) -> Section:
    """Estimates and residuals of every run; `truth` (fault: size) where it is known."""
    signals, noise = model.plant.signals, noise_scales(model)
    figures = []
    for each in estimated:
        for fault in signals.faults:
            if fault.name not in bank.designs:
                continue
            f = each.f[fault.name]
            width = each.half_width.get(fault.name, np.nan)
            figures.append(
                fault_estimate(
                    each.run.t,
                    f,
                    f - width,
                    f + width,
                    limit=None,
                    name=fault.name,
                    unit=fault.unit,
                    truth=None if truth is None else truth.get(fault.name),
                    not_judged=~each.settled,
                    probable=True,
                    least=float(np.nan_to_num(width)),
                    clock=each.run.clock,
                )
            )
        figures += [
            residual(
                each.run.t[each.run.sampled.get(output.name, slice(None))],
                each.residuals[output.name][each.run.sampled.get(output.name, slice(None))],
                name=output.name,
                unit=output.unit,
                reference=reference,
                noise=noise[output.name],
                clock=each.run.clock,
            )
            for output in signals.outputs
            if output.name in each.residuals
        ]
    notes = tuple(
        f"{name}: observer of order {d.order} on output {d.output}, bandwidth "
        f"{bank.bandwidth:.4g} rad/s, "
        + ("all poles real" if d.real_poles else "a complex pair of poles")
        + f", largest discrete pole over the envelope {d.radius:.4f}."
        for name, d in bank.designs.items()
    )
    paragraphs = (*notes, *(f"Not estimated: {why}" for why in bank.refused.values()))
    return Section("Fault estimates", paragraphs, (), tuple(figures[:MOST_FIGURES]))


def _parameters(model: Model) -> Table | None:
    parameters = model.plant.spec.parameters
    if not parameters:
        return None
    rows = tuple(
        (
            p.name,
            quantity(float(model.plant.parameters[p.name]), p.unit or "1", 5),
            "given" if p.fixed else "fitted",
        )
        for p in parameters
    )
    return Table(("parameter", "value", ""), rows)
