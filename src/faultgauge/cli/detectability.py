"""`faultgauge detectability`"""

from pathlib import Path
from typing import Annotated

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import READS
from faultgauge.verbs.how import How

__all__ = ["detectability"]


def detectability(
    model: Annotated[Path, typer.Argument(help="Calibrated model file."), READS],
    logs: options.Logs,
    time: options.Time = None,
    time_format: options.TimeFormat = None,
    map: options.Map = None,
    where: options.Where = None,
    resample: options.Resample = None,
    report: options.ReportFile = None,
    json: options.Json = False,
) -> None:
    """What could be seen of each fault in logs like these, told apart, and by what test input?"""
    from faultgauge.plants.model import load_model
    from faultgauge.verbs.detectability import detectability as foresee

    fitted = load_model(model)
    runs, warned = options.read_logs_for(fitted, logs, How(time, time_format, map, where, resample))
    with options.narrate("foreseeing") as progress:
        found = foresee(fitted, runs, progress=progress)
    if report is not None:
        found.report(report)
    if json:
        options.print_json({**found.as_dict(), "warnings": warned})
        return
    for line in found.lines:
        options.tell(line)
    if report is not None:
        options.say(f"wrote {report}")
