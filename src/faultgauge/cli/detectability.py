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
    from faultgauge.foresight import detectability as foresee
    from faultgauge.plants.model import load_model

    fitted = load_model(model)
    runs, warned = options.read_logs_for(fitted, logs, How(time, time_format, map, where, resample))
    with options.narrate("foreseeing") as progress:
        sheet = foresee(fitted, runs, progress=progress)
    if report is not None:
        from faultgauge.reporting.detectability_chapter import detectability_report
        from faultgauge.reporting.report import write

        write(detectability_report(sheet), report)
    if json:
        options.print_json({**sheet.as_dict(), "warnings": warned})
        return
    for line in str(sheet).splitlines():
        options.tell(line)
    if report is not None:
        options.say(f"wrote {report}")
