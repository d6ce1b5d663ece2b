"""`faultgauge check`"""

from pathlib import Path
from typing import Annotated

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import READS, Fills, make_folder
from faultgauge.verbs.how import How

__all__ = ["check"]


Healthy = Annotated[
    Path, typer.Argument(help="Healthy log, or a folder of them (--healthy adds more)."), READS
]
Suspect = Annotated[Path, typer.Argument(help="Log to judge, or a folder of them."), READS]
More = Annotated[
    list[Path] | None,
    typer.Option("--healthy", metavar="LOG", help="Another healthy log; may be repeated."),
    READS,
]
Plant = Annotated[
    str | None,
    typer.Option(
        "--plant",
        metavar="FILE|PRESET",
        help="Plant file, or the name of a preset [default: networks for everything].",
    ),
    READS,
]
Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Keep model, table and report here."),
    Fills(("model.fgm", "estimates.csv", "report.html")),
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of the random starts.")]


def check(
    healthy: Healthy,
    suspect: Suspect,
    more: More = None,
    plant: Plant = None,
    out: Out = None,
    seed: Seed = 0,
    time: options.Time = None,
    time_format: options.TimeFormat = None,
    map: options.Map = None,
    where: options.Where = None,
    resample: options.Resample = None,
    report: options.ReportFile = None,
    verbose: options.Verbose = False,
    json: options.Json = False,
) -> None:
    """Fit, calibrate, estimate and report in one: is SUSPECT like HEALTHY, or what is wrong
    with it? (`faultgauge inspect --plant FILE` looks at a plant file alone.)"""
    from faultgauge.plants.gray_box import load_plant
    from faultgauge.plants.model import save_model
    from faultgauge.telemetry.writing import write_table
    from faultgauge.verbs.check import check as look_into
    from faultgauge.verbs.check import guessed

    folder = make_folder(out) if out is not None else None
    how = How(time, time_format, map, where, resample)
    known = [healthy, *(more or [])]
    body = guessed(known, how) if plant is None else load_plant(plant)
    good = options.read_logs(body.spec, known, how, fitting=True)
    doubtful = options.read_logs(body.spec, [suspect], how)
    with options.narrate("checking") as progress:
        found = look_into(good, doubtful, body, seed=seed, progress=progress)
    options.warn(found.warnings)
    files = [report] if report is not None else []
    if folder is not None:
        files.append(folder / "report.html")
        save_model(found.model, folder / "model.fgm")
        write_table(found.rows, folder / "estimates.csv")
    found.report(*files)
    if json:
        options.print_json(found.as_dict())
        return
    for line in found.sentences if verbose else found.lines:
        options.tell(line)
    options.wrote(*files)
    if folder is None:
        options.say("next: --out DIR keeps model, table and report")
    else:
        page, model = folder / "report.html", folder / "model.fgm"
        options.say(f"next: open {page}; faultgauge estimate {model} LOG judges other logs")
