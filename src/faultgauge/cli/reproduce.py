"""`faultgauge reproduce`"""

from pathlib import Path
from typing import Annotated

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import Fills, make_folder

__all__ = ["reproduce"]


def reproduce(
    seeds: Annotated[
        int | None,
        typer.Option(
            "--seeds", min=1, max=1000, help="How many seeds [default: 10, with --quick 2]."
        ),
    ] = None,
    first_seed: Annotated[int, typer.Option("--first-seed", min=0, help="The first of them.")] = 0,
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="DIR", help="Where results.json, report.html and run.json go."
        ),
        Fills(("results.json", "report.html", "run.json")),
    ] = Path("out"),
    quick: Annotated[
        bool, typer.Option("--quick", help="Two seeds, without the slow comparisons.")
    ] = False,
    json: options.Json = False,
) -> None:
    """Repeat the reaction-wheel study of the paper: learn, run beside, inject, estimate."""
    import time

    folder = make_folder(out)
    begun = time.perf_counter()
    from faultgauge.files import write_atomically
    from faultgauge.reporting.report import write
    from faultgauge_studies.paper.goals import GOALS, met
    from faultgauge_studies.paper.report import goal_rows, paper_report
    from faultgauge_studies.paper.reproduce import QUICK_SEEDS, SEEDS, as_json
    from faultgauge_studies.paper.reproduce import reproduce as repeat

    count = seeds or (QUICK_SEEDS if quick else SEEDS)
    with options.narrate("starting") as progress:
        found = repeat(range(first_seed, first_seed + count), quick=quick, progress=progress)
        write_atomically(folder / "results.json", as_json(found.results).encode())
        progress("writing the report")
        write(paper_report(found), folder / "report.html")
    elapsed = time.perf_counter() - begun
    write_atomically(folder / "run.json", as_json(_machine(elapsed, count)).encode())
    missed = [goal.label for goal in GOALS if not met(goal, found.results)]
    if json:
        options.print_json({"out": str(folder), "elapsed_s": elapsed, "missed": missed})
        return
    _show(*goal_rows(found.results))
    print(f"{len(GOALS) - len(missed)} of {len(GOALS)} goals met over {count} seeds")
    print(f"report: {folder / 'report.html'}")


def _machine(elapsed: float, seeds: int) -> dict[str, object]:
    import os
    import platform

    return {
        "elapsed_s": elapsed,
        "seeds": seeds,
        "cores": os.cpu_count(),
        "machine": platform.machine(),
        "system": platform.system(),
        "python": platform.python_version(),
    }


def _show(header: tuple[str, ...], rows: tuple[tuple[str, ...], ...]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(*header)
    for row in rows:
        table.add_row(*row)
    Console(highlight=False).print(table)
