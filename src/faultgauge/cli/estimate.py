"""`faultgauge estimate`"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from faultgauge.cli import options
from faultgauge.cli.options import need_fleet, refuse_beside_fleet
from faultgauge.cli.writing import READS, Fills, Writes, check_apart, make_folder
from faultgauge.errors import InputError
from faultgauge.verbs.how import How, Reading

__all__ = ["estimate"]


Model = Annotated[
    Path, typer.Argument(help="Model file; with --fleet the folder of a fleet."), READS
]
Logs = Annotated[
    list[Path],
    typer.Argument(
        help="Logs: CSV (.gz too), Excel, Parquet, MAT, HDF5, MDF, MCAP, ROS 2 bags; a folder of "
        "them; or - for standard input."
    ),
    READS,
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FILE",
        help="Table to write: .csv, .csv.gz, .parquet; of a fleet a folder of them.",
    ),
    Writes(),
]
Observer = Annotated[
    str,
    typer.Option(
        "--observer", help="bank: which faults, how big, how probable; eso: estimates alone."
    ),
]
Reference = Annotated[
    Literal["free", "measured", "observer"],
    typer.Option("--reference", help="Healthy reference of the residual columns."),
]
Smooth = Annotated[
    bool,
    typer.Option("--smooth", help="In hindsight: cause, size and onset, as the whole log tells."),
]
Evidence = Annotated[
    Path | None,
    typer.Option(
        "--evidence",
        metavar="DIR",
        help="For each event a file: the part of the log it rests on.",
    ),
    Fills(()),  # its names are known when the events are
]
Engine = Annotated[
    Literal["python", "c"],
    typer.Option("--engine", help="c: the same as compiled C, for long logs."),
]
Rows = Annotated[
    options.RowFormat | None,
    typer.Option("--stream", help="With -: how rows are answered [default: csv]."),
]
Events = Annotated[
    Path | None,
    typer.Option(
        "--events", metavar="FILE", help="With -: every alarm and event as a line of NDJSON."
    ),
    Writes(),
]
View = Annotated[
    bool, typer.Option("--view", help="With -: residuals, estimates and events, live.")
]
Strict = Annotated[
    bool, typer.Option("--strict", help="With -: stop at a bad row, which is left out otherwise.")
]


def estimate(
    model: Model,
    logs: Logs,
    out: Out = None,
    observer: Observer = "bank",
    reference: Reference = "free",
    smooth: Smooth = False,
    evidence: Evidence = None,
    engine: Engine = "python",
    fleet: options.Fleet = False,
    scheduler: options.Scheduler = None,
    again: options.Again = False,
    time: options.Time = None,
    time_format: options.TimeFormat = None,
    map: options.Map = None,
    where: options.Where = None,
    resample: options.Resample = None,
    report: options.ReportFile = None,
    stream: Rows = None,
    events: Events = None,
    view: View = False,
    verbose: options.Verbose = False,
    strict: Strict = False,
    json: options.Json = False,
) -> None:
    """Estimate faults in logs, in physical units: what was found, and with --out a row per sample.

    With - for the log, telemetry (CSV or NDJSON) is read from standard input and every row is
    answered on standard output as it arrives, as the whole file would be.
    """
    reading = Reading(time=time, time_format=time_format, map=map, where=where, resample=resample)
    weighed = {"--smooth": smooth, "--evidence": bool(evidence), "--engine c": engine == "c"}
    live = {"--stream": bool(stream), "--events": bool(events), "--view": view, "--strict": strict}
    if fleet:
        alone = {"--observer": observer != "bank", "--reference": reference != "free"}
        refuse_beside_fleet({"-": Path("-") in logs} | alone | weighed | live)
        from faultgauge.cli.fleet import estimate_units

        estimate_units(
            model, logs, out, report, json, verbose, again=again, scheduler=scheduler, **reading
        )
        return
    need_fleet({"--scheduler": scheduler is not None, "--again": again})
    if Path("-") in logs:
        made = {"--out": bool(out), "--report": bool(report), "--json": json}
        rows = {"--where": where is not None, "--resample": resample is not None}
        _refuse_beside_a_stream({"more than one log": len(logs) > 1} | made | rows | weighed)
        from faultgauge.cli.live import answer

        form = stream or "csv"
        answer(model, observer, reference, time, time_format, map, form, events, view, strict)
        return
    _need_a_stream(live)
    from faultgauge.verbs.estimate import need_bank

    need_bank(observer, weighed)
    asked = {"observer": observer, "reference": reference, "smooth": smooth}
    _answer_logs(model, logs, reading, asked, engine, out, report, evidence, verbose, json)


def _answer_logs(
    model: Path,
    logs: list[Path],
    reading: Reading,
    asked: dict[str, Any],
    engine: Literal["python", "c"],
    out: Path | None,
    report: Path | None,
    evidence: Path | None,
    verbose: bool,
    json: bool,
) -> None:
    """Answer whole logs as `asked`, and write what is to be written."""
    from faultgauge.cli.evidence import evidence_files, replayed, write_evidence
    from faultgauge.plants.model import load_model
    from faultgauge.telemetry.writing import check_writable, write_table
    from faultgauge.verbs.estimate import estimate as find

    if out is not None:
        check_writable(out)
    walk = options.engine(engine)
    fitted = load_model(model)
    runs, odd = options.read_logs_for(fitted, logs, How(**reading))
    folder = None if evidence is None else make_folder(evidence)
    with options.narrate("estimating") as progress:
        found = find(fitted, runs, walk=walk, progress=progress, **asked)
        windows = replayed(found, progress) if folder else []
    paths = evidence_files(windows, folder) if folder else []
    files = {"--out": [out] if out else [], "--report": [report] if report else []}
    check_apart([model, *logs], files | {"--evidence": paths})
    if out is not None:
        write_table(found.rows, out)
    if report is not None:
        found.report(report)
    write_evidence(windows, paths)
    options.warn(found.warnings, but=odd)
    if json:
        content = found.as_dict()
        for event, path in zip(content["events"], paths, strict=False):
            event["evidence"] = str(path)
        options.print_json(content)
        return
    for line in found.sentences if verbose else found.lines:
        options.tell(line)
    options.wrote(*(path for group in files.values() for path in group), *paths)
    if found.events:
        look = "--report FILE.html shows why" if report is None else f"open {report}"
        back = "" if asked["smooth"] else "; --smooth tells what the whole log says of it"
        options.say(f"next: {look}{back}")


def _refuse_beside_a_stream(given: Mapping[str, bool]) -> None:
    for name in (name for name, there in given.items() if there):
        raise InputError(
            f"{name} does not go with -, which answers rows on standard output as they "
            "arrive; leave it out, or give the log as a file."
        )


def _need_a_stream(given: Mapping[str, bool]) -> None:
    for name in (name for name, there in given.items() if there):
        raise InputError(f"{name} goes with standard input only; give - for the log.")
