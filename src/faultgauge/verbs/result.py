"""What every verb gives: one object that prints as its sentences, draws, reports and tables."""

import abc
import sys
from collections.abc import Sequence
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from faultgauge.errors import InputError
from faultgauge.phases import phase

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

    from faultgauge.reporting.report import Report
    from faultgauge.reporting.svg import Figure

__all__ = ["Columns", "Result", "frame_of"]

Columns = dict[str, list[Any]]
# whose frames are given: of the first that is installed
BACKENDS: tuple[Literal["pandas", "polars", "pyarrow"], ...] = ("pandas", "polars", "pyarrow")
LONGEST = 120  # characters of a sentence in a repr


class Result(abc.ABC):
    """What a verb found. `warnings` are sentences about the logs and the way there."""

    warnings: Sequence[str]

    @property
    @abc.abstractmethod
    def lines(self) -> list[str]:
        """What `print` shows, line by line: what the command prints."""

    @property
    def sentences(self) -> list[str]:
        """The same, every sentence whole."""
        return self.lines

    @abc.abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """Everything as plain JSON: what the command prints with `--json`."""

    @abc.abstractmethod
    def columns(self) -> Columns:
        """The table as a dict of lists; None is an empty cell."""

    @abc.abstractmethod
    def page(self) -> "Report":
        """The report, not yet written."""

    def figures(self) -> "Sequence[Figure]":
        """The figures of the answer, the most telling one first; those of the report, unless a
        result has it otherwise."""
        return [each for section in self.page().sections for each in section.figures]

    def plot(self) -> "Canvas":
        """The most telling figure, of matplotlib: `.savefig("figure.svg")`, or shown by a notebook.

        Raises `InputError` where there is nothing to draw.
        """
        shown = self.figures()
        if not shown or shown[0].canvas is None:
            raise InputError(f"a {type(self).__name__} of this kind has nothing to draw.")
        if "IPython" in sys.modules:  # which shows a figure once pyplot is there
            import matplotlib.pyplot  # noqa: F401
        return shown[0].canvas

    def to_frame(self) -> Any:
        """The table as a data frame: of pandas where that is installed, else of Polars, else a
        table of PyArrow, else a dict of lists. An empty cell is NaN among numbers, else None."""
        return frame_of(self.columns())

    def report(self, *paths: str | Path) -> None:
        """Write the report, one HTML file with everything in it, to each of `paths`; whole or not
        at all."""
        from faultgauge.reporting.report import write

        with phase("drawing reports"):
            page = self.page()
            for path in paths:
                write(page, path)

    def __str__(self) -> str:
        return "\n".join(self.lines)

    def __repr__(self) -> str:
        first = next(iter(self.lines), "")
        short = first if len(first) <= LONGEST else f"{first[: LONGEST - 3]}..."
        return f"<{type(self).__name__}: {short}>"

    def _repr_html_(self) -> str:
        """For notebooks: the sentences, and the figure that `plot` gives."""
        from faultgauge.reporting.svg import inline

        text = f'<pre style="white-space: pre-wrap">{escape(str(self))}</pre>'
        return text + "".join(inline(each, "") for each in self.figures()[:1])


def frame_of(columns: Columns) -> Any:
    """`columns` as a frame of the first package of `BACKENDS` that is installed, or as they are."""
    import narwhals as nw

    for backend in BACKENDS:
        if find_spec(backend) is not None:
            whole = {name: _numbers(cells) for name, cells in columns.items()}
            return nw.to_native(nw.from_dict(whole, backend=backend))
    return columns


def _numbers(cells: list[Any]) -> Any:
    """Cells that are numbers, some of them empty, as an array."""
    if None not in cells or any(isinstance(cell, str) for cell in cells):
        return cells
    return np.array([np.nan if cell is None else cell for cell in cells], float)
