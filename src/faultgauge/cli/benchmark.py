"""`faultgauge benchmark`"""

from pathlib import Path
from typing import Annotated

import typer

from faultgauge.cli import options

__all__ = ["benchmark"]


def benchmark(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="emps, cascaded_tanks, silverbox, wiener_hammerstein_2009 or quarter_drone: free "
            "runs. crazypad or skab: decisions on real faults.",
        ),
    ],
    seeds: Annotated[
        int, typer.Option("--seeds", min=1, max=1000, help="How many seeds, from 0 on.")
    ] = 5,
    report: options.ReportFile = None,
    json: options.Json = False,
) -> None:
    """Fit a public benchmark and score it beside published results and a peer."""
    from faultgauge_studies.published.benchmark import FAULTED
    from faultgauge_studies.published.benchmark import benchmark as find

    if name in FAULTED:
        _decisions(name, seeds, report, json)
        return
    chosen = find(name)
    from faultgauge_studies.published.report import benchmark_report, score_rows
    from faultgauge_studies.published.run import as_dict, measure

    with options.narrate("starting") as progress:
        found = measure(chosen, range(seeds), progress)
    options.warn(dict.fromkeys(text for trial in found.trials for text in trial.warnings))
    if report is not None:
        from faultgauge.reporting.report import write

        write(benchmark_report(found), report)
    if json:
        options.print_json(as_dict(found))
        return
    _show(*score_rows(found))
    peer = found.peers["jax_sysid"]
    if isinstance(peer, str):
        options.say(f"jax-sysid: {peer}")
    if report is not None:
        options.say(f"wrote {report}")


def _decisions(name: str, seeds: int, report: Path | None, json: bool) -> None:
    """A benchmark of decisions."""
    from faultgauge_studies.published.faulted import MEASURES, faulted_report

    with options.narrate("starting") as progress:
        outcome = MEASURES[name](range(seeds), progress)
    if report is not None:
        from faultgauge.reporting.report import write

        write(faulted_report(name, outcome), report)
    if json:
        options.print_json(outcome.as_dict())
        return
    _show(*outcome.table())
    for note in outcome.notes:
        options.say(note)
    if report is not None:
        options.say(f"wrote {report}")


def _show(header: tuple[str, ...], rows: tuple[tuple[str, ...], ...]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(*header)
    for row in rows:
        table.add_row(*row)
    Console(highlight=False).print(table)
