"""`faultgauge simulate`"""

from pathlib import Path
from typing import Annotated

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import READS, Writes, check_apart, check_folder
from faultgauge.errors import InputError

__all__ = ["simulate"]


Scenario = Annotated[Path, typer.Argument(help="Scenario file."), READS]
Out = Annotated[
    Path,
    typer.Option("--out", metavar="LOG", help="Log to write: .csv, .csv.gz, .parquet."),
    Writes(),
]
Realtime = Annotated[
    float | None,
    typer.Option(
        "--realtime",
        metavar="[SPEED]",
        help="Run against the clock, SPEED times as fast [default: 1], with fault commands "
        "from stdin.",
    ),
]
Control = Annotated[
    Path | None,
    typer.Option("--control", metavar="FILE", help="Follow FILE for commands, not stdin."),
    READS,
]
Rows = Annotated[
    options.RowFormat | None,
    typer.Option("--stream", help="With --realtime: every row on stdout when it is due."),
]


def simulate(
    scenario: Scenario,
    out: Out,
    realtime: Realtime = None,
    control: Control = None,
    stream: Rows = None,
    report: options.ReportFile = None,
    json: options.Json = False,
) -> None:
    """Simulate a plant in closed loop, healthy or not, and write the log.

    With --realtime, faults are injected while it runs: inject NAME SIZE, inject TARGET
    bias|gain|stuck|dropout SIZE, both with [ramp SECONDS]; clear NAME|all; stop.
    """
    for name, given in (("--control", control), ("--stream", stream)):
        if given and realtime is None:
            raise InputError(f"{name} goes with --realtime only; add it or leave {name} out.")
    if stream and json:
        raise InputError("--stream and --json both want standard output; choose one of them.")
    from faultgauge.simulation.scenario import read_scenario
    from faultgauge.telemetry.writing import check_writable, write_table

    check_writable(out)
    planned = read_scenario(scenario)
    written = {"--out": [out], "--report": [report] if report else []}
    if realtime is not None:
        from faultgauge.cli.realtime import injections_file

        check_folder(injections_file(out))
        written["--out"].append(injections_file(out))
    check_apart([scenario, *planned.reads, *([control] if control else [])], written)
    if realtime is not None:
        from faultgauge.cli.realtime import against_the_clock

        against_the_clock(planned, realtime, out, control, stream, report, json)
        return
    from faultgauge.verbs.simulate import simulate as carry_out

    with options.narrate("simulating"):
        found = carry_out(planned)
    write_table(found.columns(), out)
    if report is not None:
        found.report(report)
    if json:
        options.print_json({**found.as_dict(), "out": str(out)})
        return
    print(found)
    options.say(f"wrote {out}")
