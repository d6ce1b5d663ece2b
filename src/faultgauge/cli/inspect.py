"""`faultgauge inspect`"""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import READS, Writes

if TYPE_CHECKING:
    from faultgauge.telemetry import Inspection

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

    if not logs and (plant is None or init_plant is not None):
        raise InputError("inspect: no log is named; name one, or a plant file by --plant.")
    how = {"time": time, "map": map, "where": where, "time_format": time_format}
    known = None if plant is None else _known(plant, logs or (), how)
    inputs = known["inputs"] if known else ()
    found = _looked_into(logs, init_plant, how, inputs) if logs else None
    if json:
        about = {} if known is None else {"plant": known}
        options.print_json({**(found.to_dict() if found else {}), **about})
        return
    if found is not None:
        _show(found)
    if known is not None:
        options.warn(known["warnings"])
        options.say(f"{plant}: no mistake found; it reads {', '.join(known['columns'])}")
    if init_plant is not None and logs:
        options.say(f"wrote {init_plant}: edit it, then: faultgauge fit {init_plant} {logs[0]} ...")


def _looked_into(
    logs: list[Path], init_plant: Path | None, how: dict[str, Any], inputs: Sequence[str]
) -> "Inspection":
    """What is in `logs`, of which some columns are `inputs`; a plant file is drafted from them."""
    from faultgauge.errors import InputError
    from faultgauge.files import write_atomically
    from faultgauge.telemetry import inspect_runs, plant_skeleton, read_telemetry

    reading = {name: how[name] for name in ("time", "where", "time_format")}
    reading["maps"] = how["map"] or ()
    found = inspect_runs(logs, **reading, inputs=inputs)
    if init_plant is not None:
        if init_plant.exists():
            raise InputError(f"{init_plant}: already exists; choose another name or remove it.")
        numbers = [c.known_as for c in found.columns if c.kind == "number"]
        runs = read_telemetry(logs, **reading, names=(), optional=numbers)
        units = {c.name: c.unit for c in found.columns if c.unit}
        text = plant_skeleton(runs, init_plant.stem, units)
        write_atomically(init_plant, text.encode())
    return found


def _known(plant: str, logs: Sequence[Path], how: dict[str, Any]) -> dict[str, Any]:
    """The inputs of a plant file, what it reads of `logs`, its inputs and outputs where there are
    none, and what is doubtful in it. Raises `InputError` for its first mistake, and where logs lack
    what it reads."""
    from faultgauge.plants.gray_box import load_plant
    from faultgauge.verbs.reading import read

    body = load_plant(plant)
    inputs, outputs = body.signals.input_names, body.signals.output_names
    columns = [*inputs, *outputs]
    if logs:
        runs = read(logs, body, **how)
        columns = list(dict.fromkeys(name for run in runs for name in run.columns))
    lacking = [name for name in outputs if name not in columns]
    warnings = [f"[outputs.{name}]: the logs have no such column" for name in lacking]
    warnings = [*body.spec.warnings, *warnings]
    return {"file": plant, "inputs": list(inputs), "columns": columns, "warnings": warnings}


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
