"""`faultgauge inspect`"""

from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import READS, Writes

if TYPE_CHECKING:
    from faultgauge.plants.gray_box import GrayBoxPlant
    from faultgauge.telemetry import Run

__all__ = ["inspect"]

AnyLogs = Annotated[
    list[Path] | None,
    typer.Argument(help="Logs, or a folder of them; --plant does without."),
    READS,
]


def inspect(
    logs: AnyLogs = None,
    init_plant: Annotated[
        Path | None,
        typer.Option("--init-plant", metavar="FILE", help="Write a plant-file skeleton to edit."),
        Writes(),
    ] = None,
    plant: Annotated[
        str | None,
        typer.Option(
            "--plant",
            metavar="FILE",
            help="Check a plant file: its keys, its units, and that the logs have its columns.",
        ),
        READS,
    ] = None,
    time: options.Time = None,
    time_format: options.TimeFormat = None,
    map: options.Map = None,
    where: options.Where = None,
    json: options.Json = False,
) -> None:
    """Show what is in a log: names, rates, gaps, ranges; and draft or check a plant file."""
    from faultgauge.errors import InputError
    from faultgauge.files import write_atomically
    from faultgauge.telemetry import inspect_runs, plant_skeleton, read_telemetry
    from faultgauge.verbs.reading import read

    if not logs:
        if plant is None or init_plant is not None:
            raise InputError("inspect: no log is named; name one, or a plant file by --plant.")
        checked = _checked(plant, None)
        if json:
            options.print_json({"plant": checked})
        else:
            _say(checked)
        return
    found = inspect_runs(logs, time=time, maps=map or (), where=where, time_format=time_format)
    if init_plant is not None:
        if init_plant.exists():
            raise InputError(f"{init_plant}: already exists; choose another name or remove it.")
        numbers = [c.known_as for c in found.columns if c.kind == "number"]
        runs = read_telemetry(
            logs,
            time=time,
            maps=map or (),
            names=(),
            optional=numbers,
            where=where,
            time_format=time_format,
        )
        units = {c.name: c.unit for c in found.columns if c.unit}
        text = plant_skeleton(runs, init_plant.stem, units)
        write_atomically(init_plant, text.encode())

    def of_logs(plant: "GrayBoxPlant") -> "Sequence[Run]":
        return read(logs, plant, time=time, map=map, where=where, time_format=time_format)

    checked = None if plant is None else _checked(plant, of_logs)
    if json:
        about = {} if checked is None else {"plant": checked}
        options.print_json({**found.to_dict(), **about})
        return
    _show(found)
    if checked is not None:
        _say(checked)
    if init_plant is not None:
        options.say(f"wrote {init_plant}: edit it, then: faultgauge fit {init_plant} {logs[0]} ...")


def _checked(
    plant: str, read: Callable[["GrayBoxPlant"], "Sequence[Run]"] | None
) -> dict[str, Any]:
    """What a plant file reads of logs, its inputs and outputs where there is none to `read`, and
    what is doubtful in it. Raises `InputError` for its first mistake, and where logs lack what it
    reads."""
    from faultgauge.plants.gray_box import load_plant

    found = load_plant(plant)
    outputs = found.signals.output_names
    columns = [*found.signals.input_names, *outputs]
    if read is not None:
        columns = list(dict.fromkeys(name for run in read(found) for name in run.columns))
    lacking = [name for name in outputs if name not in columns]
    warnings = [f"[outputs.{name}]: the logs have no such column" for name in lacking]
    return {"file": plant, "columns": columns, "warnings": [*found.spec.warnings, *warnings]}


def _say(checked: dict[str, Any]) -> None:
    options.warn(checked["warnings"])
    options.say(f"{checked['file']}: no mistake found; it reads {', '.join(checked['columns'])}")


def _moment(clock: str | None, t: float) -> str:
    """By the log's clock to the second, with its zone where it has one, else in seconds."""
    if clock is None:
        return f"{t:.6g} s"
    at = datetime.fromisoformat(clock)
    return f"{at:%Y-%m-%d %H:%M:%S} {at.tzname() or ''}".rstrip()


def _show(found) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False, markup=False, emoji=False)
    runs = Table(box=SIMPLE_HEAD, pad_edge=False)
    for title in ("run", "rows", "from", "to", "rate (Hz)", "jitter", "gaps", "empty cells"):
        wide = len("2026-03-02") if title in ("from", "to") else None
        runs.add_column(title, min_width=wide, overflow="fold")
    for run in found.runs:
        runs.add_row(
            options.plain(run.name),
            str(run.rows),
            _moment(run.start_clock, run.start),
            _moment(run.end_clock, run.end),
            f"{run.rate:.6g}",
            f"{100 * run.jitter:.1f} %",
            str(len(run.gaps)),
            str(sum(run.empty.values())),
        )
    console.print(runs)
    units = ["unit"] if any(column.unit for column in found.columns) else []
    numbers = ("min", "max", "mean", "std", "noise", "quantum")
    columns, lines = Table(box=SIMPLE_HEAD, pad_edge=False), []
    for title in ("column", *units, *numbers):  # neither numbers nor names are cut off
        columns.add_column(title, no_wrap=title != "column", overflow="fold")
    for column in found.columns:
        s, remarks = column.statistics, []
        head = [options.plain(each) for each in (column.name, column.unit)[: 1 + len(units)]]
        if s is None:
            columns.add_row(*head, *[""] * len(numbers))
            remarks.append(column.kind)
        else:
            values = (s.min, s.max, s.mean, s.std, s.noise, s.quantum)
            columns.add_row(*head, *("" if v is None else f"{v:.4g}" for v in values))
            told = (("constant", s.constant), ("held between changes", s.held))
            remarks += [text for text, holds in told if holds]
        if remarks:
            lines.append(f"{column.name}: {', '.join(remarks)}")
    console.print(columns)
    for line in lines:
        console.print(options.plain(line))
    for hint in found.hints:
        console.print(options.plain(f"hint: {hint}"))
