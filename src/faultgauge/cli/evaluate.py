"""`faultgauge evaluate`"""

from pathlib import Path
from typing import Annotated

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import READS
from faultgauge.verbs.how import How

__all__ = ["evaluate"]


def evaluate(
    model: Annotated[Path, typer.Argument(help="Model file."), READS],
    logs: options.Logs,
    warmup: Annotated[
        int,
        typer.Option(
            "--warmup", min=0, help="Samples that find hidden initial states and are not scored."
        ),
    ] = 50,
    time: options.Time = None,
    time_format: options.TimeFormat = None,
    map: options.Map = None,
    where: options.Where = None,
    resample: options.Resample = None,
    report: options.ReportFile = None,
    json: options.Json = False,
) -> None:
    """Score a model by pure simulation on logs."""
    from faultgauge.plants.model import load_model
    from faultgauge.verbs.evaluate import evaluate as score

    fitted = load_model(model)
    runs, odd = options.read_logs_for(fitted, logs, How(time, time_format, map, where, resample))
    with options.narrate("simulating"):
        found = score(fitted, runs, warmup=warmup)
    options.warn(found.warnings, but=odd)
    if report is not None:
        found.report(report)
    if json:
        options.print_json(found.as_dict())
        return
    for line in found.lines:
        options.tell(line)
