"""Options that commands share, and how they read logs and print."""

import json
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from faultgauge.cli.writing import READS, Writes
from faultgauge.errors import InputError
from faultgauge.phases import phase
from faultgauge.progress import Step
from faultgauge.settings import cache

if TYPE_CHECKING:
    from faultgauge.detection.decisions import Walk
    from faultgauge.plants.model import Model
    from faultgauge.plants.spec import PlantSpec
    from faultgauge.verbs.how import How
    from faultgauge.verbs.reading import Runs

__all__ = [
    "Again",
    "Fleet",
    "Json",
    "Logs",
    "Map",
    "ReportFile",
    "Resample",
    "RowFormat",
    "Scheduler",
    "Time",
    "TimeFormat",
    "Where",
    "Workers",
    "narrate",
    "need_fleet",
    "plain",
    "print_json",
    "read_logs",
    "read_logs_for",
    "refuse_beside_fleet",
    "say",
    "tell",
    "warn",
    "wrote",
]

SELDOM = 20.0  # s
STEADY = 600.0  # s, over which the time left is estimated
LONGEST = 4000  # characters of a sentence
Json = Annotated[bool, typer.Option("--json", help="One JSON object on stdout, nothing else.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", help="Say everything that was found, not only the first lines.")
]
Time = Annotated[str | None, typer.Option("--time", help="Name of the time column [default: t].")]
TimeFormat = Annotated[
    str | None,
    typer.Option(
        "--time-format",
        metavar="FORMAT",
        help="How time is written that is neither ISO 8601 nor day.month.year, as in --time-format "
        "'%d/%m/%Y %H:%M:%S'.",
    ),
]
Map = Annotated[
    list[str] | None,
    typer.Option(
        "--map",
        metavar="NAME=EXPRESSION",
        help="Make a signal from columns, as in --map 'h=wheel_rpm*0.104720*0.84'.",
    ),
]
Where = Annotated[
    str | None,
    typer.Option(
        "--where",
        metavar="CONDITION",
        help="Keep the rows that meet it, as in --where 'mode == 3 and abs(u) < 5'.",
    ),
]
Resample = Annotated[
    float | None,
    typer.Option(
        "--resample",
        metavar="RATE",
        help="Bring the logs to RATE (Hz), anti-aliased [default: the model's, where it has one].",
    ),
]
ReportFile = Annotated[
    Path | None,
    typer.Option("--report", metavar="FILE.html", help="Write a report with figures."),
    Writes(),
]
RowFormat = Literal["csv", "ndjson"]
Fleet = Annotated[
    bool,
    typer.Option(
        "--fleet",
        help="For every unit of a fleet: a folder with a log (or a folder of logs) for each, or a "
        "table with a column unit.",
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="local|ADDRESS",
        help="With --fleet: spread the units over the workers of a Dask scheduler, "
        "tcp://HOST:PORT, or of one started here [default: none, one unit after another].",
    ),
]
Workers = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="local|ADDRESS",
        help="Spread the runs over the workers of a Dask scheduler, tcp://HOST:PORT, or of one "
        "started here [default: none, one run after another].",
    ),
]
Again = Annotated[
    bool, typer.Option("--again", help="With --fleet: do units anew that are done already.")
]
Logs = Annotated[
    list[Path],
    typer.Argument(
        help="Logs: CSV (.gz too), Excel, Parquet, MAT, HDF5, MDF, MCAP, ROS 2 bags; or a folder "
        "of them."
    ),
    READS,
]


def refuse_beside_fleet(given: Mapping[str, bool]) -> None:
    """Raises `InputError` where an option is `given`, by its name, that --fleet does not heed."""
    for name in (name for name, there in given.items() if there):
        raise InputError(f"{name} does not go with --fleet; leave one of the two out.")


def need_fleet(given: Mapping[str, bool]) -> None:
    """Raises `InputError` where an option is `given`, by its name, that says nothing of one log."""
    for name in (name for name, there in given.items() if there):
        raise InputError(
            f"{name} is about the units of a fleet; give --fleet, too, or leave it out."
        )


def engine(name: Literal["python", "c"]) -> "Walk":
    """Who runs the step along logs. Raises `InputError` where there is no C compiler for `c`."""
    if name == "c":
        from faultgauge.export.engine import Engine

        return Engine(cache() / "c")
    from faultgauge.detection.watch import Watch

    return Watch.along


def read_logs(
    spec: "PlantSpec", paths: Sequence[Path], how: "How", *, fitting: bool = False
) -> "Runs":
    """The runs in `paths` with the columns that a plant reads; `fitting`, with its instruments
    too."""
    from faultgauge.verbs.reading import runs_for_plant

    with phase("reading logs"):
        return _noted(runs_for_plant(spec, list(paths), how, fitting=fitting))


def read_logs_for(model: "Model", paths: Sequence[Path], how: "How") -> tuple["Runs", list[str]]:
    """The runs in `paths` for a fitted `model`; and warnings where they are unlike those of its
    fit, which are said at once."""
    from faultgauge.verbs.reading import runs_for_model, unlike_warnings

    with phase("reading logs"):
        runs = _noted(runs_for_model(model, list(paths), how))
    odd = unlike_warnings(model, runs)
    warn(odd)
    return runs, odd


def _noted(runs: "Runs") -> "Runs":
    """`runs`, whose notes are said: what is true of several logs, once."""
    of: dict[str, dict[str, None]] = {}
    for run in runs:
        for note in run.notes:
            of.setdefault(note.removeprefix(run.source), {})[run.source] = None
    for text, (first, *others) in of.items():
        more = f" and {len(others)} more" if others else ""
        say(f"note: {first}{more}{text}")
    return runs


def print_json(content: dict[str, Any]) -> None:
    """The one JSON object of a command with `--json`, on stdout."""
    print(json.dumps(content, allow_nan=False))


def say(text: str = "") -> None:
    """A line for the person in front of the terminal (stderr, so that stdout can be piped)."""
    if len(text) > LONGEST:
        text = f"{text[: LONGEST // 2]} ... {text[-LONGEST // 2 :]}"
    with suppress(OSError):  # a terminal that was closed
        print(plain(text), file=sys.stderr)


def tell(text: str) -> None:
    """A line of the answer (stdout)."""
    print(plain(text))


def plain(text: str) -> str:
    """`text` without what would command a terminal: names in a log may hold anything."""
    return "".join(c if c.isprintable() or c == "\n" else ascii(c)[1:-1] for c in text)


def wrote(*files: Path) -> None:
    """Say which files were written, where there are any."""
    if files:
        say(f"wrote {', '.join(str(file) for file in files)}")


def warn(warnings: Iterable[str], but: Collection[str] = ()) -> None:
    """Say `warnings`, but those that were said before."""
    for warning in (each for each in warnings if each not in but):
        say(f"warning: {warning}.")


class _Lines:
    """What is being done, as lines that are `SELDOM` apart and no two alike in a row."""

    def __init__(self) -> None:
        self.said, self.last = monotonic(), ""

    def __call__(self, text: str) -> None:
        line = f"{text} ({100 * text.share:.0f} %)" if isinstance(text, Step) else text
        if line != self.last and monotonic() - self.said >= SELDOM:
            self.said, self.last = monotonic(), line
            say(line)


@contextmanager
def narrate(start: str) -> Iterator[Callable[[str], None]]:
    """What is being done, a bar with the share of it that is (`Step`) and the time, on stderr while
    something long runs; where stderr is no terminal a line now and then."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    if not console.is_terminal:
        yield _Lines()
        return
    text = TextColumn("{task.description}", markup=False)
    times = TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn()
    columns = (text, BarColumn(), TaskProgressColumn(), *times)
    with Progress(*columns, console=console, transient=True, speed_estimate_period=STEADY) as bar:
        task = bar.add_task(start, total=None)

        def update(text: str) -> None:
            share = text.share if isinstance(text, Step) else None
            total = None if share is None else 1.0
            bar.update(task, description=plain(text), total=total, completed=share or 0.0)

        yield update
