"""`faultgauge check`"""

from pathlib import Path
from typing import Annotated

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import READS, Fills, make_folder

__all__ = ["check"]


def check(
    healthy: Annotated[Path, typer.Argument(help="Healthy log."), READS],
    suspect: Annotated[Path, typer.Argument(help="Log to judge."), READS],
    plant: Annotated[
        str | None,
        typer.Option("--plant", metavar="FILE|PRESET", help="Plant [default: a black box]."),
        READS,
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Keep model, table and report here."),
        Fills(("model.fgm", "estimates.csv", "report.html")),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the starts.")] = 0,
    time: options.Time = None,
    map: options.Map = None,
    where: options.Where = None,
    resample: options.Resample = None,
    report: options.ReportFile = None,
    verbose: options.Verbose = False,
    json: options.Json = False,
) -> None:
    """Fit, calibrate, estimate and report in one: is SUSPECT like HEALTHY, and if not, how much?"""
    from faultgauge.detection import answer, decisions, misfit
    from faultgauge.plants.gray_box import load_plant
    from faultgauge.plants.model import save_model
    from faultgauge.studies import checkup
    from faultgauge.telemetry import check_same_units, read_telemetry
    from faultgauge.telemetry.writing import write_table

    folder = make_folder(out) if out is not None else None
    if plant is None:
        body = checkup.black_box(
            read_telemetry([healthy], time=time, maps=map or (), where=where, resample=resample),
            "log",
        )
    else:
        body = load_plant(plant)
    good = options.read_logs(body.spec, [healthy], time, map, where, resample, fitting=True)
    doubtful = options.read_logs(body.spec, [suspect], time, map, where, resample)
    check_same_units([*good, *doubtful], map or ())
    with options.narrate("checking") as progress:
        found = checkup.check(body, good, doubtful, seed=seed, progress=progress)
    options.warn([*found.account.warnings, *found.calibration.warnings])
    options.warn(misfit.alarmed_throughout({e.run.name: e.status for e in found.decisions}))
    files = [report] if report is not None else []
    if folder is not None:
        files.append(folder / "report.html")
        save_model(found.model, folder / "model.fgm")
        columns = decisions.table(found.decisions, found.model.plant.signals.fault_names)
        write_table(columns, folder / "estimates.csv")
    if files:
        from faultgauge.reporting.report import write
        from faultgauge.studies.checkup_report import checkup_report

        page = checkup_report(found)
        for file in files:
            write(page, file)
    if json:
        events = answer.as_dicts(found.bank, found.decisions) if found.bank else []
        names = found.model.plant.signals.fault_names
        runs = answer.runs_as_dicts(found.bank, found.decisions, names)
        options.print_json({"events": events, "sentences": found.sentences, "runs": runs})
        return
    for line in found.sentences if verbose else found.first_screen:
        options.tell(line)
    if files:
        options.say(f"wrote {', '.join(str(file) for file in files)}")
