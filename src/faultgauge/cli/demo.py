"""`faultgauge demo`"""

from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import Fills, make_folder

__all__ = ["demo"]


def demo(
    out: Annotated[
        Path,
        typer.Option("--out", metavar="DIR", help="Where report.html goes."),
        Fills(("report.html", "physics.fgm", "network.fgm")),
    ] = Path("out"),
    json: options.Json = False,
) -> None:
    """Find a hidden pulse in a real drive, and a friction fault in a satellite's wheel."""
    folder = make_folder(out)
    from faultgauge.plants.model import save_model
    from faultgauge.reporting.report import write
    from faultgauge_studies.demonstration import demonstration_report, wheel_rows
    from faultgauge_studies.drive import BODIES, measured_logs, run_drive, simulated_logs
    from faultgauge_studies.drive_report import rows, told
    from faultgauge_studies.paper.experiment import core
    from faultgauge_studies.paper.reproduce import over_seeds

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
        wheel = core(0, progress=lambda text: progress(f"wheel: {text}"))
        results = over_seeds([wheel.figures])
        progress("writing the report")
        report = folder / "report.html"
        write(demonstration_report(logs, drives, results, wheel.traces), report)
    for name, drive in drives.items():
        save_model(drive.calibration.model, folder / f"{name}.fgm")
    if json:
        figures = {name: drive.figures for name, drive in drives.items()}
        content = {"source": logs.source, "report": str(report), **figures, "wheel": wheel.figures}
        options.print_json(_told(content))
        return
    _show(f"A {logs.source} positioning drive with a hidden 5 V pulse", *rows(drives))
    print(f"{told(drives['network'])}\n")
    _show("A reaction wheel of a satellite under control, friction fault", *wheel_rows(results))
    print(f"report: {report}")
    print("next, on your own log:")
    print("  faultgauge inspect LOG.csv --init-plant plant.toml")
    print("  faultgauge check HEALTHY.csv SUSPECT.csv --plant plant.toml --out out")


def _told(content: Any) -> Any:
    """`content` with null where a number is infinite (never settled, say) or not defined."""
    if isinstance(content, dict):
        return {key: _told(each) for key, each in content.items()}
    if isinstance(content, list):
        return [_told(each) for each in content]
    return content if not isinstance(content, float) or isfinite(content) else None


def _show(title: str, header: tuple[str, ...], body: tuple[tuple[str, ...], ...]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(*header, title=title)
    for row in body:
        table.add_row(*row)
    Console(highlight=False).print(table)
