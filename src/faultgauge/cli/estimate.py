"""`faultgauge estimate`"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import READS, Fills, Writes, check_apart, make_folder
from faultgauge.errors import InputError

if TYPE_CHECKING:
    from faultgauge.detection.decisions import Decision, Walk
    from faultgauge.plants.model import Model
    from faultgauge.telemetry import Run

__all__ = ["estimate"]


def estimate(
    model: Annotated[Path, typer.Argument(help="Model file."), READS],
    logs: Annotated[
        list[Path],
        typer.Argument(
            help="Logs: CSV (.gz too), Parquet, MAT, HDF5, MDF, MCAP, ROS 2 bags; or - for "
            "standard input."
        ),
        READS,
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="Table to write: .csv, .csv.gz, .parquet."),
        Writes(),
    ] = None,
    observer: Annotated[
        str,
        typer.Option(
            "--observer",
            help="bank: which faults, how big, how probable; eso: estimates alone.",
        ),
    ] = "bank",
    reference: Annotated[
        Literal["free", "measured", "observer"],
        typer.Option("--reference", help="Healthy reference of the residual columns."),
    ] = "free",
    smooth: Annotated[
        bool,
        typer.Option("--smooth", help="Cause, size and onset as the whole log tells them."),
    ] = False,
    evidence: Annotated[
        Path | None,
        typer.Option(
            "--evidence",
            metavar="DIR",
            help="A log of each event's window, which gives it again.",
        ),
        Fills(()),  # its names are known when the events are
    ] = None,
    engine: Annotated[
        Literal["python", "c"],
        typer.Option("--engine", help="c: the same step as C, compiled here, for long logs."),
    ] = "python",
    time: options.Time = None,
    map: options.Map = None,
    where: options.Where = None,
    resample: options.Resample = None,
    report: options.ReportFile = None,
    stream: Annotated[
        options.RowFormat | None,
        typer.Option("--stream", help="Of the rows that answer standard input [default: csv]."),
    ] = None,
    events: Annotated[
        Path | None,
        typer.Option(
            "--events", metavar="FILE", help="With -: every alarm and event as a line of NDJSON."
        ),
        Writes(),
    ] = None,
    view: Annotated[
        bool, typer.Option("--view", help="With -: residuals, estimates and events, live.")
    ] = False,
    verbose: options.Verbose = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="With -: refuse rows that are else left out.")
    ] = False,
    json: options.Json = False,
) -> None:
    """Estimate faults in logs, in physical units: a row per sample, and events.

    With - for the log, telemetry (CSV or NDJSON) is read from standard input and every row is
    answered on standard output as it arrives, as the whole file would be.
    """
    if Path("-") in logs:
        _refuse_beside_a_stream(
            {
                "more than one log": len(logs) > 1,
                "--out": out is not None,
                "--where": where is not None,
                "--resample": resample is not None,
                "--report": report is not None,
                "--json": json,
                "--smooth": smooth,
                "--evidence": evidence is not None,
                "--engine c": engine == "c",
            }
        )
        from faultgauge.cli.live import answer

        answer(model, observer, reference, time, map, stream or "csv", events, view, strict)
        return
    if out is None:
        raise InputError("--out FILE is missing: the table to write (.csv, .csv.gz, .parquet).")
    for name, given in (
        ("--stream", stream),
        ("--events", events),
        ("--view", view),
        ("--strict", strict),
    ):
        if given:
            raise InputError(f"{name} goes with standard input only; give - for the log.")
    for name, given in (
        ("--smooth", smooth),
        ("--evidence", evidence is not None),
        ("--engine c", engine == "c"),
    ):
        if given and observer != "bank":
            raise InputError(
                f"{name} rests on the bank's hypotheses, which --observer {observer} does not "
                "weigh; leave one of the two out."
            )
    from faultgauge.plants.model import load_model
    from faultgauge.telemetry.writing import check_writable

    check_writable(out)
    walk = options.engine(engine)
    fitted = load_model(model)
    runs, warned = options.read_logs_for(fitted, logs, time, map, where, resample)
    if observer == "bank":
        folder = None if evidence is None else make_folder(evidence)
        reads = [model, *logs]
        _decide(
            *(fitted, runs, walk, reads, reference, out, report, smooth, folder, verbose, json),
            warned,
        )
        return
    _estimate(fitted, runs, observer, reference, out, report, json, warned)


def _refuse_beside_a_stream(given: dict[str, bool]) -> None:
    for name in (name for name, there in given.items() if there):
        raise InputError(
            f"{name} does not go with -, which answers rows on standard output as they "
            "arrive; leave it out, or give the log as a file."
        )


def _estimate(
    model: "Model",
    runs: "list[Run]",
    observer: str,
    reference: Literal["free", "measured", "observer"],
    out: Path,
    report: Path | None,
    json: bool,
    warned: list[str],
) -> None:
    """An estimate for every fault, each by an observer of its own."""
    from faultgauge.detection import estimation
    from faultgauge.telemetry.writing import write_table

    with options.narrate("estimating"):
        estimated, bank = estimation.estimate(model, runs, observer=observer, reference=reference)
    write_table(estimation.table(estimated, model.plant.signals.fault_names), out)
    options.warn(bank.refused.values())
    if report is not None:
        from faultgauge.reporting.chapters import estimate_report
        from faultgauge.reporting.report import write

        write(estimate_report(model, estimated, bank, reference), report)
    said = estimation.sentence(model)
    if json:
        options.print_json({"answer": [said], "events": [], "drift": [], "warnings": warned})
        return
    options.tell(said)
    options.say(f"wrote {out}")


def _decide(
    model: "Model",
    runs: "list[Run]",
    walk: "Walk",
    reads: list[Path],
    reference: Literal["free", "measured", "observer"],
    out: Path,
    report: Path | None,
    smooth: bool,
    folder: Path | None,
    verbose: bool,
    json: bool,
    warned: list[str],
) -> None:
    """By the bank: probabilities, intervals, a status and events; `smooth`: and what
    the whole log tells; `folder`: for the events' evidence, which is none of what it `reads`."""
    from faultgauge.cli.evidence import evidence_files, write_evidence
    from faultgauge.detection import answer, decisions, drift, misfit, retrospective
    from faultgauge.detection.evidence import MOST_SHOWN, evidence
    from faultgauge.telemetry.writing import write_table

    with options.narrate("estimating"):
        decided, bank = decisions.decide_runs(model, runs, reference, walk)
        if bank is None:
            _undecided(model, decided, out, report, smooth, json, warned)
            return
        judged = decided if smooth else []
        seen = [each for one in judged for each in retrospective.retrospect(bank, one)]
        told = [(one, event) for one in decided for event in one.events]
        most = None if folder else MOST_SHOWN if report else 0
        drifting = drift.drifts(bank, decided)
        slow = drift.sentences(drifting)
        windows = [evidence(bank, one, event) for one, event in told[:most]]
    paths = evidence_files(windows, folder) if folder else []
    written = {"--out": [out], "--report": [report] if report else [], "--evidence": paths}
    check_apart(reads, written)
    write_table(decisions.table(decided, model.plant.signals.fault_names), out)
    if report is not None:
        from faultgauge.reporting.decision_chapter import decision_report
        from faultgauge.reporting.report import with_sentences, write

        write(with_sentences(decision_report(bank, decided, seen, windows), slow), report)
    if folder:
        write_evidence(windows, paths)
    sentences = answer.answers(bank, decided)
    odd = misfit.alarmed_throughout({each.run.name: each.status for each in decided})
    options.warn(odd)
    if json:
        events = answer.as_dicts(bank, decided)
        for event, path in zip(events, paths, strict=False):
            event["evidence"] = str(path)
        more = {"retrospective": retrospective.as_dicts(seen)} if smooth else {}
        more |= {"drift": drift.as_dicts(drifting), "warnings": [*warned, *odd]}
        more |= {"runs": answer.runs_as_dicts(bank, decided, bank.model.plant.signals.fault_names)}
        options.print_json({"answer": sentences, "events": events, **more})
        return
    hindsight = retrospective.sentences(bank, seen) if smooth else []
    shown = sentences if verbose else answer.first_screen(bank, decided)
    for line in [*shown, *hindsight, *slow]:
        options.tell(line)
    options.say(f"wrote {out}")


def _undecided(
    model: "Model",
    decided: "list[Decision]",
    out: Path,
    report: Path | None,
    smooth: bool,
    json: bool,
    warned: list[str],
) -> None:
    """A model that was not calibrated for the bank: rows and a sentence that say so."""
    from faultgauge.detection.answer import runs_as_dicts
    from faultgauge.detection.decisions import table
    from faultgauge.detection.uncalibrated import unjudged_sentence
    from faultgauge.telemetry.writing import write_table

    write_table(table(decided, model.plant.signals.fault_names), out)
    sentence = unjudged_sentence(model)
    if report is not None:
        from faultgauge.reporting.decision_chapter import unjudged_report
        from faultgauge.reporting.report import write

        write(unjudged_report(model, decided, sentence), report)
    if json:
        more = {"retrospective": []} if smooth else {}
        more |= {"runs": runs_as_dicts(None, decided, model.plant.signals.fault_names)}
        options.print_json(
            {"answer": [sentence], "events": [], **more, "drift": [], "warnings": warned}
        )
        return
    options.tell(sentence)
    options.say(f"wrote {out}")
