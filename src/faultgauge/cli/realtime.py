"""`faultgauge simulate --realtime`: the clock, the commands, the rows, and what is left behind."""

import json
import math
from dataclasses import replace
from pathlib import Path

from faultgauge.cli import options
from faultgauge.cli.commands import follow_file, follow_stdin
from faultgauge.cli.streaming import Interrupt, RowWriter, while_read
from faultgauge.files import write_atomically
from faultgauge.simulation.realtime import Session
from faultgauge.simulation.scenario import Scenario
from faultgauge.telemetry.readers import stem
from faultgauge.telemetry.writing import as_table, write_table

__all__ = ["against_the_clock", "injections_file"]


def against_the_clock(
    scenario: Scenario,
    speed: float,
    out: Path,
    control: Path | None,
    form: str | None,
    report: Path | None,
    as_json: bool,
) -> None:
    """Run, and write log and injections however it ends: at its end, by `stop`, by an interrupt,
    or when nobody reads the rows any more."""
    with options.narrate("compiling"):
        session = Session(scenario, speed)
    poll = follow_file(control) if control else follow_stdin()
    writer = RowWriter(form) if form else None

    def emit(row: dict[str, float]) -> None:
        if writer:
            writer.write({n: None if math.isnan(v) else v for n, v in row.items()})

    def complain(sentence: str) -> None:
        options.say(f"faultgauge: {sentence}")

    options.say(f"running {scenario.name} for {scenario.samples * scenario.step / speed:g} s")
    with Interrupt() as interrupt:
        try:
            with while_read(), interrupt.waiting():
                session.run(poll, emit, complain)
        finally:  # which no second interrupt cuts short
            _write(session, out, report)
            options.say(session.pacer.punctuality().sentence())
    if as_json:
        options.print_json(
            {
                "rows": len(session.kept["t"]),
                "columns": list(session.kept),
                "out": str(out),
                "injections": session.injections,
                **session.pacer.punctuality().as_dict(),
            }
        )


def injections_file(out: Path) -> Path:
    """Where the commands of log `out` are recorded: log.csv -> log.injections.ndjson."""
    return out.with_name(f"{stem(out)}.injections.ndjson")


def _write(session: Session, out: Path, report: Path | None) -> None:
    """The log so far, whole or not at all, and beside it what was injected."""
    run = session.log()
    if len(run.t) == 0:
        return
    write_table(as_table(run), out)
    end = {"did": "end", **session.pacer.punctuality().as_dict()}
    lines = "".join(json.dumps(each, allow_nan=False) + "\n" for each in [*session.injections, end])
    write_atomically(injections_file(out), lines.encode())
    if report is not None:
        from faultgauge.reporting.report import write
        from faultgauge.reporting.simulation_chapter import simulation_report

        happened = replace(session.scenario, faults=tuple(session.commands.ever.values()))
        write(simulation_report(happened, run), report)
    options.say(f"wrote {out}, {injections_file(out)}")
