"""`faultgauge calibrate`"""

from pathlib import Path
from typing import Annotated

import typer

from faultgauge.cli import options
from faultgauge.cli.options import need_fleet, refuse_beside_fleet
from faultgauge.cli.writing import READS, Writes
from faultgauge.verbs.how import How, Reading

__all__ = ["calibrate"]


Model = Annotated[
    Path, typer.Argument(help="Model file; with --fleet the folder of a fleet."), READS
]
Out = Annotated[
    Path | None,
    typer.Option("--out", metavar="MODEL", help="Where to write [default: replace MODEL]."),
    Writes(over="model"),
]
BetweenFalseAlarms = Annotated[
    float | None,
    typer.Option(
        "--mtbfa",
        metavar="SECONDS",
        help="Mean time between false alarms [default: the longest that the logs prove].",
    ),
]
Plant = Annotated[
    str | None,
    typer.Option(
        "--plant",
        metavar="FILE|PRESET",
        help="Take [faults], [detection] and [observer] from this plant file "
        "[default: as they were at the fit].",
    ),
    READS,
]
Observer = Annotated[
    str,
    typer.Option(
        "--observer",
        help="bank: noise, model error and alarm level; eso: intervals of its estimates.",
    ),
]


def calibrate(
    model: Model,
    logs: options.Logs,
    out: Out = None,
    mtbfa: BetweenFalseAlarms = None,
    plant: Plant = None,
    observer: Observer = "bank",
    fleet: options.Fleet = False,
    scheduler: options.Scheduler = None,
    again: options.Again = False,
    time: options.Time = None,
    time_format: options.TimeFormat = None,
    map: options.Map = None,
    where: options.Where = None,
    resample: options.Resample = None,
    report: options.ReportFile = None,
    json: options.Json = False,
) -> None:
    """Find noise, model error and alarm level on healthy logs and add them to the model."""
    reading = Reading(time=time, time_format=time_format, map=map, where=where, resample=resample)
    if fleet:
        from faultgauge.cli.fleet import calibrate_units

        refuse_beside_fleet({"--plant": plant is not None, "--observer": observer != "bank"})
        calibrate_units(
            model, logs, report, json, out=out, mtbfa=mtbfa, again=again, scheduler=scheduler,
            **reading,
        )  # fmt: skip
        return
    need_fleet({"--scheduler": scheduler is not None, "--again": again})
    from faultgauge.plants.model import load_model, save_model
    from faultgauge.verbs.calibrate import calibrate as find_limit

    fitted = load_model(model)
    if plant is not None:
        from faultgauge.plants.settings import with_settings

        fitted = with_settings(fitted, plant)
        options.warn(fitted.plant.spec.warnings)
    runs, odd = options.read_logs_for(fitted, logs, How(**reading))
    with options.narrate("calibrating") as progress:
        found = find_limit(fitted, runs, mtbfa=mtbfa, observer=observer, progress=progress)
    save_model(found.model, out or model)
    options.warn(found.warnings, but=odd)
    if report is not None:
        found.report(report)
    if json:
        options.print_json({"model": str(out or model), **found.as_dict()})
        return
    for line in found.lines:
        options.tell(line)
    options.say(
        f"wrote {out or model}; next: faultgauge estimate {out or model} LOG --out FILE.csv"
    )
