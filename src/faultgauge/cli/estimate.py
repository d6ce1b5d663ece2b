"""`faultgauge estimate`"""

from pathlib import Path
from typing import Annotated, Literal

import typer

from faultgauge.cli import options

__all__ = ["estimate"]


def estimate(
    model: Annotated[Path, typer.Argument(help="Model file.")],
    logs: options.Logs,
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="Table to write: .csv, .csv.gz, .parquet.")
    ],
    observer: Annotated[str, typer.Option("--observer", help="Observer to run.")] = "eso",
    reference: Annotated[
        Literal["free", "measured", "observer"],
        typer.Option("--reference", help="Healthy reference of the residual columns."),
    ] = "free",
    time: options.Time = None,
    map: options.Map = None,
    where: options.Where = None,
    report: options.ReportFile = None,
    json: options.Json = False,
) -> None:
    """Estimate faults in logs, in physical units: a row per sample, and events."""
    from faultgauge.cli.writing import check_folder
    from faultgauge.detection import estimation
    from faultgauge.plants.model import load_model
    from faultgauge.telemetry.writing import check_writable, write_table

    check_writable(out)
    check_folder(out, report)
    fitted = load_model(model)
    signals = fitted.plant.signals
    runs = options.read_logs(signals, logs, time, map, where)
    with options.narrate("estimating"):
        judgements, bank = estimation.estimate(fitted, runs, observer=observer, reference=reference)
    write_table(estimation.table(judgements, signals.fault_names), out)
    options.warn(bank.refused.values())
    if report is not None:
        from faultgauge.reporting.chapters import estimate_report
        from faultgauge.reporting.report import write

        write(estimate_report(fitted, judgements, bank, reference), report)
    events = [event for judgement in judgements for event in judgement.events]
    if json:
        options.print_json({"events": estimation.as_dicts(events)})
        return
    for line in estimation.sentences(fitted, events):
        print(line)
    options.say(f"wrote {out}")
