"""`fit`, `calibrate` and `estimate` with --fleet."""

from pathlib import Path
from typing import Any

from faultgauge.cli import options
from faultgauge.errors import InputError

__all__ = ["calibrate_units", "estimate_units", "fit_units"]


def fit_units(
    plant: str, logs: list[Path], out: Path, report: Path | None, json: bool, **how: Any
) -> None:
    """`fit --fleet`: `how` are the arguments of `fit_fleet`."""
    from faultgauge.fleet.fit import fit_fleet

    with options.narrate("fitting") as progress:
        found = fit_fleet(plant, logs, out, progress=progress, **how)
    _tell(found, found.lines, report, json)
    options.say(f"wrote {out}; next: faultgauge calibrate {out} HEALTHY_LOGS --fleet")


def calibrate_units(
    fleet: Path, logs: list[Path], report: Path | None, json: bool, **how: Any
) -> None:
    """`calibrate --fleet`: `how` are the arguments of `calibrate_fleet`."""
    from faultgauge.fleet.calibrate import calibrate_fleet

    with options.narrate("calibrating") as progress:
        found = calibrate_fleet(fleet, logs, progress=progress, **how)
    _tell(found, found.lines, report, json)
    options.say(
        f"wrote {found.folder}; next: faultgauge estimate {found.folder} LOGS --fleet --out DIR"
    )


def estimate_units(
    fleet: Path,
    logs: list[Path],
    out: Path | None,
    report: Path | None,
    json: bool,
    verbose: bool,
    **how: Any,
) -> None:
    """`estimate --fleet`: `how` are the arguments of `estimate_fleet`."""
    if out is None:
        raise InputError("--out DIR is missing: the folder for a table per unit.")
    from faultgauge.fleet.estimate import estimate_fleet

    with options.narrate("estimating") as progress:
        found = estimate_fleet(fleet, logs, out, progress=progress, **how)
    _tell(found, found.sentences if verbose else found.lines, report, json)
    options.say(f"wrote {out}")


def _tell(found: Any, lines: list[str], report: Path | None, json: bool) -> None:
    options.warn(found.warnings)
    if report is not None:
        found.report(report)
    if json:
        options.print_json(found.as_dict())
        return
    for line in lines:
        options.tell(line)
