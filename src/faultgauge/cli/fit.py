"""`faultgauge fit`"""

from pathlib import Path
from typing import Annotated, Any

import typer

from faultgauge.cli import options
from faultgauge.cli.options import need_fleet, refuse_beside_fleet
from faultgauge.cli.writing import READS, Writes
from faultgauge.verbs.how import How, Reading

__all__ = ["fit"]


Plant = Annotated[str, typer.Argument(help="Plant file, or the name of a preset."), READS]
Out = Annotated[
    Path,
    typer.Option(
        "--out", metavar="MODEL", help="Model file to write; of a fleet a folder of them."
    ),
    Writes(),
]
Validate = Annotated[
    list[Path] | None,
    typer.Option(
        "--validate",
        metavar="LOG",
        help="Log that chooses between fits and is never fitted; may be repeated.",
    ),
    READS,
]
Refine = Annotated[
    bool | None,
    typer.Option(
        "--refine/--no-refine",
        help="Go on to the simulation error [default: where a state is hidden, a parameter "
        "varies or a sensor is slower than the rows, and with --robust or --ensemble].",
    ),
]
Robust = Annotated[
    bool, typer.Option("--robust", help="Refine, and bound what an outlier can do to it.")
]
Ensemble = Annotated[
    bool, typer.Option("--ensemble", help="Refine, and keep the next best models in MODEL too.")
]
Restarts = Annotated[
    int,
    typer.Option(
        "--restarts", min=1, max=1000, help="Random starts of the search; the best is kept."
    ),
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Seed of the random starts.")]
Seeds = Annotated[
    int,
    typer.Option(
        "--seeds",
        min=1,
        max=100,
        help="Fit with so many seeds, from --seed on, to see how much they matter; MODEL is of "
        "the first.",
    ),
]
DespiteAlarms = Annotated[
    bool,
    typer.Option(
        "--despite-alarms", help="Fit logs with alarms in them, which are refused otherwise."
    ),
]
Prior = Annotated[
    Path | None,
    typer.Option(
        "--from",
        metavar="FLEET",
        help="With --fleet: start from what this fleet (its folder, or its fleet.fgm) tells of "
        "its units, which asks for minutes of log only.",
    ),
    READS,
]


def fit(
    plant: Plant,
    logs: options.Logs,
    out: Out,
    validate: Validate = None,
    refine: Refine = None,
    robust: Robust = False,
    ensemble: Ensemble = False,
    restarts: Restarts = 10,
    seed: Seed = 0,
    seeds: Seeds = 1,
    despite_alarms: DespiteAlarms = False,
    fleet: options.Fleet = False,
    prior: Prior = None,
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
    """Learn a plant's unknowns from healthy logs and write a model file; with --fleet a folder of
    them, with what the fleet tells of its next unit."""
    reading = Reading(time=time, time_format=time_format, map=map, where=where, resample=resample)
    both = {"seed": seed, "robust": robust, "despite_alarms": despite_alarms}
    if fleet:
        refuse_beside_fleet(
            {
                "--validate": validate is not None,
                "--refine or --no-refine": refine is not None,
                "--ensemble": ensemble,
                "--restarts": restarts != 10,
                "--seeds": seeds != 1,
            }
        )
        from faultgauge.cli.fleet import fit_units

        given = {"prior": prior, "again": again, "scheduler": scheduler}
        fit_units(plant, logs, out, report, json, **given, **both, **reading)
        return
    need_fleet({"--from": bool(prior), "--scheduler": scheduler is not None, "--again": again})
    search = {"refine": refine, "ensemble": ensemble, "restarts": restarts, "seeds": seeds}
    _fit_one(plant, logs, validate, How(**reading), both | search, out, report, json)


def _fit_one(
    plant: str,
    logs: list[Path],
    validate: list[Path] | None,
    how: How,
    asked: dict[str, Any],
    out: Path,
    report: Path | None,
    json: bool,
) -> None:
    """Fit one model as `asked`, and write what is to be written."""
    from faultgauge.plants.gray_box import load_plant
    from faultgauge.plants.model import save_model
    from faultgauge.verbs.fit import fit as learn

    untrained = load_plant(plant)
    runs = options.read_logs(untrained.spec, logs, how, fitting=True)
    held = options.read_logs(untrained.spec, validate, how) if validate else None
    with options.narrate("fitting") as progress:
        found = learn(untrained, runs, validate=held, replaces=out, progress=progress, **asked)
        save_model(found.model, out)
        progress("validating")
        if json or report is not None:
            _ = found.unseen  # which takes its time
    options.warn(found.warnings)
    if report is not None:
        found.report(report)
    if json:
        options.print_json({"model": str(out), **found.as_dict()})
        return
    for line in found.lines:
        options.tell(line)
    options.say(f"wrote {out}; next: faultgauge calibrate {out} HEALTHY_LOG")
