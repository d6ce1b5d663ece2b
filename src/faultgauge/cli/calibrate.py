"""`faultgauge calibrate`"""

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from faultgauge.cli import options

__all__ = ["calibrate"]


def calibrate(
    model: Annotated[Path, typer.Argument(help="Model file.")],
    logs: options.Logs,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="MODEL", help="Where to write [default: replace MODEL]."),
    ] = None,
    mtbfa: Annotated[
        float | None,
        typer.Option(
            "--mtbfa", metavar="SECONDS", help="Mean time between false alarms [default: longest]."
        ),
    ] = None,
    plant: Annotated[
        str | None,
        typer.Option(
            "--plant",
            metavar="FILE|PRESET",
            help="Take [faults], [detection] and [observer] from this plant file "
            "[default: as they were at the fit].",
        ),
    ] = None,
    time: options.Time = None,
    map: options.Map = None,
    where: options.Where = None,
    report: options.ReportFile = None,
    json: options.Json = False,
) -> None:
    """Find the alarm limit on healthy logs and add it to the model."""
    from faultgauge.cli.writing import check_folder
    from faultgauge.detection import drift
    from faultgauge.detection.calibration import calibrate as find_limit
    from faultgauge.detection.estimation import estimate
    from faultgauge.plants.model import load_model, save_model

    check_folder(out, report)
    fitted = load_model(model)
    if plant is not None:
        from faultgauge.plants.settings import with_settings

        fitted = with_settings(fitted, plant)
        options.warn(fitted.plant.spec.warnings)
    runs = options.read_logs(fitted.plant.signals, logs, time, map, where)
    with options.narrate("calibrating") as progress:
        found = find_limit(fitted, runs, mtbfa=mtbfa, progress=progress)
        progress("testing for drift")
        drifting = drift.drifts(found.model, estimate(found.model, runs)[0])
    save_model(found.model, out or model)
    options.warn(found.warnings)
    if report is not None:
        from faultgauge.reporting.chapters import calibration_report
        from faultgauge.reporting.report import with_sentences, write

        write(with_sentences(calibration_report(found), drift.sentences(drifting)), report)
    block = found.model.calibration or {}
    if json:
        warned = {"drift": drift.as_dicts(drifting), "warnings": found.warnings}
        options.print_json({"model": str(out or model), **block, **warned})
        return
    units = {fault.name: fault.unit for fault in fitted.plant.signals.faults}
    for name, channel in block["channels"].items():
        print(f"{name}: limit {channel['limit']:.4g} {units.get(name, '')}".rstrip())
    print(
        f"from {block['blocks']} healthy blocks ({block['judged_s']:.4g} s): false alarms at most "
        f"once in {block['mtbfa_s']:.4g} s (95 % confidence)"
    )
    for line in (*_bank_lines(block.get("bank"), units), *drift.sentences(drifting)):
        print(line)
    options.say(
        f"wrote {out or model}; next: faultgauge estimate {out or model} LOG --out FILE.csv"
    )


def _bank_lines(bank: dict[str, Any] | None, units: dict[str, str]) -> list[str]:
    """What calibration found for the bank, in words."""
    if bank is None:
        return []
    errors = [
        f"{name} {bank['error'][name][0]:.2g} {unit}".rstrip()
        for name, unit in units.items()
        if name in bank["error"]
    ]
    alarms = bank["alarms"]
    told = f"{alarms} alarm{'' if alarms == 1 else 's'}" if alarms else "no alarm"
    return [
        f"bank: alarm at odds of {math.exp(bank['level']):.3g} to 1; {told} in {bank['blocks']} "
        f"healthy blocks ({bank['judged_s']:.4g} s) proves only that false alarms come at most "
        f"once in {bank['mtbfa_s']:.4g} s (95 % confidence)",
        f"bank: the model's own error, in its intervals: {', '.join(errors)}",
    ]
