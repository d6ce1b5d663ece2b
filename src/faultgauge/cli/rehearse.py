"""`faultgauge rehearse`"""

from pathlib import Path
from typing import Annotated

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import READS, Fills, make_folder
from faultgauge.errors import InputError
from faultgauge.verbs.how import How

__all__ = ["rehearse"]


Model = Annotated[Path, typer.Argument(help="Calibrated model file."), READS]
Logs = Annotated[
    list[Path],
    typer.Argument(metavar="HEALTHY", help="Healthy logs that neither fit nor calibrate has seen."),
    READS,
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out", metavar="DIR", help="Write report.html, rehearsal.json and trials.csv here."
    ),
    Fills(("report.html", "rehearsal.json", "trials.csv")),
]
Size = Annotated[
    list[str] | None,
    typer.Option(
        "--size",
        metavar="FAULT=SIZE",
        help="Rehearse this fault of this size alone, as in --size friction=0.1.",
    ),
]
Trials = Annotated[int, typer.Option("--trials", min=2, help="Logs to judge, at most.")]


def rehearse(
    model: Model,
    logs: Logs,
    out: Out = None,
    size: Size = None,
    trials: Trials = 200,
    scheduler: options.Workers = None,
    time: options.Time = None,
    time_format: options.TimeFormat = None,
    map: options.Map = None,
    where: options.Where = None,
    resample: options.Resample = None,
    report: options.ReportFile = None,
    json: options.Json = False,
) -> None:
    """Put declared faults into healthy logs: what would be found?"""
    from faultgauge.plants.model import load_model
    from faultgauge.verbs.rehearse import rehearse as try_out

    sizes = dict(_size(each) for each in size or ())
    fitted = load_model(model)
    runs, odd = options.read_logs_for(fitted, logs, How(time, time_format, map, where, resample))
    folder = make_folder(out) if out is not None else None
    with options.narrate("rehearsing") as progress:
        asked = {"sizes": sizes, "trials": trials, "scheduler": scheduler}
        found = try_out(fitted, runs, **asked, progress=progress)
    options.warn(found.warnings, but=odd)
    files = [report] if report is not None else []
    if folder is not None:
        from json import dumps

        from faultgauge.files import write_atomically
        from faultgauge.telemetry.writing import write_table

        files.append(folder / "report.html")
        text = dumps(found.as_dict(), indent=1, allow_nan=False)
        write_atomically(folder / "rehearsal.json", text.encode())
        write_table(found.columns(), folder / "trials.csv")
    if files:
        found.report(*files)
    if json:
        options.print_json(found.as_dict())
        return
    print(found)
    if files:
        options.say(f"wrote {', '.join(str(file) for file in files)}")


def _size(text: str) -> tuple[str, float]:
    """A fault and its size from "friction=0.1"."""
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise InputError(
            f"--size {text}: {value.strip()!r} is not a number; write it as in --size friction=0.1."
        ) from None
