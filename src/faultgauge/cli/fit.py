"""`faultgauge fit`"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import READS, Writes

if TYPE_CHECKING:
    from faultgauge.identification.fit import FitReport
    from faultgauge.plants.model import Model

__all__ = ["fit"]


def fit(
    plant: Annotated[str, typer.Argument(help="Plant file, or the name of a preset."), READS],
    logs: options.Logs,
    out: Annotated[
        Path, typer.Option("--out", metavar="MODEL", help="Model file to write."), Writes()
    ],
    validate: Annotated[
        list[Path] | None,
        typer.Option("--validate", metavar="LOG", help="Log to stop and select on, never to fit."),
        READS,
    ] = None,
    refine: Annotated[
        bool | None,
        typer.Option(
            "--refine/--no-refine",
            help="Go on to the simulation error [default: where a state is hidden, a parameter "
            "varies or a sensor is slower than the rows, and with --robust or --ensemble].",
        ),
    ] = None,
    robust: Annotated[
        bool, typer.Option("--robust", help="Refine, and bound what an outlier can do to it.")
    ] = False,
    ensemble: Annotated[
        bool, typer.Option("--ensemble", help="Refine, and keep the next best models in MODEL too.")
    ] = False,
    restarts: Annotated[
        int, typer.Option("--restarts", min=1, max=1000, help="How many starts.")
    ] = 10,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the starts.")] = 0,
    seeds: Annotated[
        int,
        typer.Option(
            "--seeds",
            min=1,
            max=100,
            help="Fit with so many seeds, from --seed on, to see how much they matter; MODEL is of "
            "the first.",
        ),
    ] = 1,
    despite_alarms: Annotated[
        bool,
        typer.Option("--despite-alarms", help="Fit logs under alarm too, which are refused."),
    ] = False,
    time: options.Time = None,
    map: options.Map = None,
    where: options.Where = None,
    resample: options.Resample = None,
    report: options.ReportFile = None,
    json: options.Json = False,
) -> None:
    """Learn a plant's unknowns from healthy logs and write a model file."""
    from faultgauge.plants.gray_box import load_plant
    from faultgauge.telemetry import check_same_units

    untrained = load_plant(plant)
    spec = untrained.spec
    runs = options.read_logs(spec, logs, time, map, where, resample, fitting=True)
    held = options.read_logs(spec, validate, time, map, where, resample) if validate else []
    check_same_units([*runs, *held], map or ())
    if not despite_alarms:
        from faultgauge.detection.alarmed import refuse_alarms

        refuse_alarms([*runs, *held], [*logs, *(validate or [])], time, map, where, out)
    from faultgauge.identification.fit import fit as identify
    from faultgauge.identification.unseen import on_unseen
    from faultgauge.plants.model import save_model

    with options.narrate("fitting") as progress:
        fits = [
            identify(
                untrained,
                runs,
                held,
                seed=seed + k,
                restarts=restarts,
                refine=refine,
                robust=robust,
                ensemble=ensemble,
                progress=progress,
            )
            for k in range(seeds)
        ]
        (model, account), *others = fits
        save_model(model, out)
        progress("validating")
        unseen = None
        if json or report is not None:
            unseen = on_unseen(model, account, runs, held, others)
    options.warn(account.warnings)
    if report is not None:
        from faultgauge.reporting.chapters import fit_report
        from faultgauge.reporting.report import write

        write(fit_report(model, account, unseen, given=bool(held)), report)
    if json:
        checked = unseen.validation.to_dict() if unseen else None
        options.print_json({"model": str(out), **_content(model, account), "validation": checked})
        return
    for line in (*_parameters(model, account), *_errors(fits)):
        options.tell(line)
    options.say(f"wrote {out}; next: faultgauge calibrate {out} HEALTHY_LOG")


def _errors(fits: "list[tuple[Model, FitReport]]") -> list[str]:
    """The free run's error on held-out data, of the model and over the seeds."""
    model, account = fits[0]
    error = model.record["metrics"]["validation_free_run_nrmse"]
    refitted = account.refinement is not None and account.refinement.refitted
    before = ", before the model was fitted to them, too" if refitted else ""
    lines = [
        f"free run on held-out data: error {error:.2%} of each output's standard deviation{before}"
    ]
    if len(fits) > 1:
        errors = [each.record["metrics"]["validation_free_run_nrmse"] for each, _ in fits]
        lines.append(f"over {len(fits)} seeds: {min(errors):.2%} to {max(errors):.2%}")
    return lines


def _content(model: "Model", account: "FitReport") -> dict[str, Any]:
    record = model.record
    return {
        "parameters": {name: float(value) for name, value in model.plant.parameters.items()},
        "metrics": record["metrics"],
        "derivatives": record["derivatives"],
        "noise": record["noise"],
        "envelope": record["envelope"],
        "choices": record.get("choices", {"hold": {}, "hidden": {}}),
        "refinement": record["metrics"].get("refinement"),
        "equation_error": account.information.to_dict() if account.information else None,
        "members": len(model.members),
        "warnings": account.warnings,
    }


def _parameters(model: "Model", account: "FitReport") -> list[str]:
    """A line for every fitted parameter: value, standard error where it is known, unit."""
    known = account.refinement.information if account.refinement else account.information
    errors = {each.name: each.standard_error for each in known.constants} if known else {}
    lines = []
    for p in model.plant.spec.parameters:
        if not p.fixed:
            # of what varies the runs tell their own values; the common one leans on the prior
            error = None if p.vary else errors.get(p.name)
            width = "" if error is None else f" +- {error:.2g}"
            value = float(model.plant.parameters[p.name])
            lines.append(f"{p.name} = {value:.6g}{width} {p.unit}".rstrip())
            own = account.refinement.per_run.get(p.name, {}) if account.refinement else {}
            lines += [f"  run {run}: {each:.6g} {p.unit}".rstrip() for run, each in own.items()]
    return lines
