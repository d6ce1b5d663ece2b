"""`faultgauge fit`"""

from pathlib import Path
from typing import Annotated

import typer

from faultgauge.cli import options

__all__ = ["fit"]


def fit(
    plant: Annotated[str, typer.Argument(help="Plant file, or the name of a preset.")],
    logs: options.Logs,
    out: Annotated[Path, typer.Option("--out", metavar="MODEL", help="Model file to write.")],
    validate: Annotated[
        list[Path] | None,
        typer.Option("--validate", metavar="LOG", help="Log to stop and select on, never to fit."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the starts.")] = 0,
    time: options.Time = None,
    map: options.Map = None,
    report: options.ReportFile = None,
    json: options.Json = False,
) -> None:
    """Learn a plant's unknowns from healthy logs and write a model file."""
    from faultgauge.cli.writing import check_folder
    from faultgauge.plants.gray_box import load_plant

    check_folder(out, report)
    untrained = load_plant(plant)
    runs = options.read_logs(untrained.signals, logs, time, map)
    held = options.read_logs(untrained.signals, validate, time, map) if validate else []
    from faultgauge.identification.fit import fit as identify
    from faultgauge.plants.model import save_model

    with options.narrate("fitting") as progress:
        model, account = identify(untrained, runs, held, seed=seed, progress=progress)
    save_model(model, out)
    options.warn(account.warnings)
    if report is not None:
        from faultgauge.reporting.chapters import fit_report
        from faultgauge.reporting.report import write

        write(fit_report(model, account, held or runs), report)
    parameters = {name: float(value) for name, value in model.plant.parameters.items()}
    if json:
        options.print_json(
            {
                "model": str(out),
                "parameters": parameters,
                "metrics": model.record["metrics"],
                "derivatives": model.record["derivatives"],
                "envelope": model.record["envelope"],
                "warnings": account.warnings,
            }
        )
        return
    units = {p.name: p.unit for p in model.plant.spec.parameters}
    fixed = {p.name for p in model.plant.spec.parameters if p.fixed}
    for name, value in parameters.items():
        if name not in fixed:
            print(f"{name} = {value:.6g} {units[name]}".rstrip())
    error = model.record["metrics"]["validation_free_run_nrmse"]
    print(f"free run on held-out data: error {error:.2%} of each output's standard deviation")
    options.say(f"wrote {out}; next: faultgauge calibrate {out} HEALTHY_LOG")
