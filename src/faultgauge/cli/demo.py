"""`faultgauge demo`"""

from pathlib import Path
from typing import Annotated

import typer

from faultgauge.cli import options

__all__ = ["demo"]


def demo(
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Where report.html goes.")
    ] = Path("out"),
    json: options.Json = False,
) -> None:
    """Find a hidden pulse in a real drive: fit, calibrate, estimate, report."""
    from faultgauge.cli.writing import make_folder

    folder = make_folder(out)
    from faultgauge.plants.model import save_model
    from faultgauge.reporting.report import write
    from faultgauge.studies.drive import BODIES, measured_logs, run_drive, simulated_logs
    from faultgauge.studies.drive_report import drive_report, rows

    logs = measured_logs()
    if logs is None:
        options.say(
            "The measured drive (EMPS) is not here: set FAULTGAUGE_DATA to the folder with emps/. "
            "Running on a simulated drive instead."
        )
        logs = simulated_logs()
    with options.narrate("demo") as progress:
        drives = {
            name: run_drive(logs, name, progress=lambda text, n=name: progress(f"{n}: {text}"))
            for name in BODIES
        }
    report = folder / "report.html"
    write(drive_report(logs, drives), report)
    for name, drive in drives.items():
        save_model(drive.calibration.model, folder / f"{name}.fgm")
    if json:
        figures = {name: drive.figures for name, drive in drives.items()}
        options.print_json({"source": logs.source, "report": str(report), **figures})
        return
    _show(logs.source, *rows(drives))
    print(f"report: {report}")
    print("next, on your own log:")
    print("  faultgauge inspect LOG.csv --init-plant plant.toml")
    print("  faultgauge check HEALTHY.csv SUSPECT.csv --plant plant.toml --out out")


def _show(source: str, header: tuple[str, ...], body: tuple[tuple[str, ...], ...]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(*header, title=f"A {source} positioning drive with a hidden 5 V pulse")
    for row in body:
        table.add_row(*row)
    Console(highlight=False).print(table)
