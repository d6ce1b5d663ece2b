"""`faultgauge campaign`"""

from pathlib import Path
from typing import Annotated, Literal

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import READS, Fills, check_apart

__all__ = ["campaign"]


def campaign(
    plan: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file."), READS],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder for runs.parquet, results.json and report.html; that of a call that was "
            "ended is gone on with.",
        ),
        Fills(("runs.parquet", "results.json", "report.html", "model.fgm", "campaign.json")),
    ],
    engine: Annotated[
        Literal["python", "c"],
        typer.Option("--engine", help="c: the same as compiled C, for many runs."),
    ] = "python",
    scheduler: options.Workers = None,
    json: options.Json = False,
) -> None:
    """Simulate many runs with faults in them and judge each: what is found, and how honestly?"""
    from faultgauge.campaigns import read_campaign
    from faultgauge.campaigns.folder import MODEL
    from faultgauge.verbs.campaign import FILES
    from faultgauge.verbs.campaign import campaign as carry_out

    planned = read_campaign(plan)
    written = [out / name for name in (*FILES, MODEL)]
    check_apart([plan, *planned.reads], {"--out": written})
    walk = options.engine(engine)
    with options.narrate(planned.name) as progress:
        found = carry_out(planned, out, walk=walk, scheduler=scheduler, progress=progress)
    options.warn(found.warnings)
    if json:
        options.print_json(found.as_dict())
        return
    print(found)
    options.wrote(*(out / name for name in FILES))
