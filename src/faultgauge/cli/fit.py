"""`faultgauge fit`"""

from pathlib import Path
from typing import Annotated

import typer

from faultgauge.cli import options
from faultgauge.cli.options import need_fleet, refuse_beside_fleet
from faultgauge.cli.writing import READS, Writes

__all__ = ["fit"]


def fit(
    plant: Annotated[str, typer.Argument(help="Plant file, or the name of a preset."), READS],
    logs: options.Logs,
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="MODEL", help="Model file to write; of a fleet a folder of them."
        ),
        Writes(),
    ],
    validate: Annotated[
        list[Path] | None,
        typer.Option(
            "--validate",
            metavar="LOG",
            help="Log that chooses between fits and is never fitted; may be repeated.",
        ),
        READS,
    ] = None,
    refine: Annotated[
        bool | None,
        typer.Option(
            "--refine/--no-refine",
            help="Go on to the simulation error [default: where a state is hidden, a parameter "
            "varies or a sensor is slower than the rows, and with --robust or --ensemble].",
        ),
    ] = None,
    robust: Annotated[
        bool, typer.Option("--robust", help="Refine, and bound what an outlier can do to it.")
    ] = False,
    ensemble: Annotated[
        bool, typer.Option("--ensemble", help="Refine, and keep the next best models in MODEL too.")
    ] = False,
    restarts: Annotated[
        int,
        typer.Option(
            "--restarts", min=1, max=1000, help="Random starts of the search; the best is kept."
        ),
    ] = 10,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the random starts.")] = 0,
    seeds: Annotated[
        int,
        typer.Option(
            "--seeds",
            min=1,
            max=100,
            help="Fit with so many seeds, from --seed on, to see how much they matter; MODEL is of "
            "the first.",
        ),
    ] = 1,
    despite_alarms: Annotated[
        bool,
        typer.Option(
            "--despite-alarms", help="Fit logs with alarms in them, which are refused otherwise."
        ),
    ] = False,
    fleet: options.Fleet = False,
    prior: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="FLEET",
            help="With --fleet: start from what this fleet (its folder, or its fleet.fgm) tells of "
            "its units, which asks for minutes of log only.",
        ),
        READS,
    ] = None,
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
    if fleet:
        from faultgauge.cli.fleet import fit_units

        refuse_beside_fleet(
            {
                "--validate": validate is not None,
                "--refine or --no-refine": refine is not None,
                "--ensemble": ensemble,
                "--restarts": restarts != 10,
                "--seeds": seeds != 1,
            }
        )
        fit_units(
            plant, logs, out, report, json, prior=prior, again=again, scheduler=scheduler,
            seed=seed, robust=robust, despite_alarms=despite_alarms, time=time,
            time_format=time_format, map=map, where=where, resample=resample,
        )  # fmt: skip
        return
    need_fleet(
        {"--from": prior is not None, "--scheduler": scheduler is not None, "--again": again}
    )
    from faultgauge.plants.gray_box import load_plant
    from faultgauge.plants.model import save_model
    from faultgauge.verbs.fit import fit as learn
    from faultgauge.verbs.reading import How

    untrained, how = load_plant(plant), How(time, map, where, resample, time_format)
    runs = options.read_logs(untrained.spec, logs, how, fitting=True)
    held = options.read_logs(untrained.spec, validate, how) if validate else None
    with options.narrate("fitting") as progress:
        found = learn(
            untrained,
            runs,
            validate=held,
            refine=refine,
            robust=robust,
            ensemble=ensemble,
            restarts=restarts,
            seed=seed,
            seeds=seeds,
            despite_alarms=despite_alarms,
            replaces=out,
            progress=progress,
        )
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
