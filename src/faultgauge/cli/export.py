"""`faultgauge export`"""

from pathlib import Path
from typing import Annotated, Literal

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import READS, Fills, check_apart, make_folder

__all__ = ["export"]


def export(
    model: Annotated[Path, typer.Argument(help="Model file."), READS],
    to: Annotated[
        str, typer.Option("--to", metavar="TARGET", help="c: C99 source; fmu: FMI 2.0 and 3.0.")
    ],
    out: Annotated[
        Path,
        typer.Option("--out", metavar="DIR", help="Folder to write to."),
        Fills(()),  # its names are known when the files are
    ],
    name: Annotated[
        str | None,
        typer.Option("--name", help="Name of files and functions [default: the plant's]."),
    ] = None,
    precision: Annotated[
        Literal["double", "single"], typer.Option("--precision", help="Of all numbers.")
    ] = "double",
    tanh: Annotated[
        Literal["exact", "fast"],
        typer.Option("--tanh", help="fast: a rational function instead of libm's, off by 3e-7."),
    ] = "exact",
    json: options.Json = False,
) -> None:
    """Write a calibrated model as code for another machine, with a test of it."""
    from faultgauge.export.export import export as carry_out
    from faultgauge.export.targets import TARGETS
    from faultgauge.files import write_atomically

    with options.narrate("printing the step"):
        files = carry_out(model, to, name=name, precision=precision, tanh=tanh)
    check_apart([model], {"--out": [out / each for each in files]})
    folder = make_folder(out)
    for each, data in files.items():
        write_atomically(folder / each, data)
    if json:
        options.print_json({"out": str(out), "files": list(files)})
        return
    print(f"{out}: {', '.join(files)}")
    options.say(TARGETS[to].next(out))
