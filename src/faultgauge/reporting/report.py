"""The report: one HTML file with everything in it, to open in any browser or to mail."""

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import metadata, resources
from itertools import count
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape

from faultgauge.files import write_atomically
from faultgauge.reporting.svg import Figure, inline

__all__ = ["Report", "Section", "Table", "installed_versions", "render", "with_sentences", "write"]

SHOWN_VERSIONS = ("faultgauge", "jax", "equinox", "optimistix", "numpy", "scipy", "matplotlib")
MOST_FIGURES = 8  # that lie open on a page, which is read, not scrolled
MOST_SENTENCES = 5  # that lie open below each other
WALL = 3  # sentences from which on they are a list
CODE = re.compile("`([^`]+)`")
NUMBER = re.compile(r"[-+−±<>≤≥≈]?\s?\d[^(]{0,23}|[-–—]?")
PERCENT = re.compile(r"(?<=\d)%(?!\w)")
# a number and its unit, or its sign, stay on one line
BOUND = re.compile(
    r"(?<=\d) (?=(?!to |and |or |of |[a-z]{4,}\b)(?:[^\W\d]|%))|(?<=[<>±]) (?=\d)|(?<=\bp) "
)


def installed_versions() -> dict[str, str]:
    """Return the version of every package behind a result, as far as it is installed."""
    versions = dict[str, str]()
    for name in SHOWN_VERSIONS:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return versions


@dataclass(frozen=True)
class Table:
    """A table of plain text; columns of numbers are set to the right.

    Attributes:
        header: name of each column.
        rows: as many cells per row as the header has names.
        caption: one sentence, or nothing.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """A part of a report with a heading: paragraphs of plain text, then tables, then figures.

    Where it is `folded`, its heading alone is seen until the reader opens it; of its figures so
    many are `shown`.
    """

    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()
    folded: bool = False
    shown: int = MOST_FIGURES


@dataclass(frozen=True)
class Report:
    """What a report says. All text is plain text: whatever it holds is shown, never run; what
    stands between backticks is set as code.

    Attributes:
        title: a few words.
        summary_sentences: the answer; the first sentence is set largest.
        sections: what the answer rests on.
        key_numbers: the numbers of the answer, shown right below it.
        versions: version by package name, for the footer.
    """

    title: str
    summary_sentences: tuple[str, ...]
    sections: tuple[Section, ...]
    key_numbers: Table | None = None
    versions: Mapping[str, str] = field(default_factory=installed_versions)


def with_sentences(report: Report, more: Iterable[str]) -> Report:
    """`report` with sentences behind its answer."""
    return replace(report, summary_sentences=(*report.summary_sentences, *more))


def render(report: Report) -> str:
    """Return the report as one HTML page that fetches nothing and runs nothing.

    Eight figures lie open, and of sentences below each other five; the rest is folded.
    """
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["prose"] = _prose
    source = (
        resources.files("faultgauge.reporting")
        .joinpath("template.html.j2")
        .read_text(encoding="utf-8")
    )
    return environment.from_string(source).render(
        report=report,
        sections=list(_laid_out(report.sections)),
        numeric_columns=_numeric_columns,
        most=MOST_SENTENCES,
        wall=WALL,
    )


def write(report: Report, path: str | os.PathLike[str]) -> None:
    """Write the report; the file at `path` is at every moment the old one or the new one.

    Raises:
        InputError: the file cannot be written.
    """
    write_atomically(Path(path), render(report).encode("utf-8", "replace"))


def _laid_out(
    sections: Iterable[Section],
) -> Iterator[tuple[Section, list[dict[str, Any]], list[dict[str, Any]]]]:
    """(section, figures that are seen with it, figures that are folded behind them)."""
    numbers, room = count(1), MOST_FIGURES
    for section in sections:
        figures = list(_numbered(section, numbers))
        seen = len(figures) if section.folded else min(room, section.shown, len(figures))
        room -= 0 if section.folded else seen
        yield section, figures[:seen], figures[seen:]


def _numbered(section: Section, numbers: Iterator[int]) -> Iterator[dict[str, Any]]:
    """The section's figures with their numbers; each number also keeps the page's ids apart."""
    for drawing in section.figures:
        number = next(numbers)
        yield {"number": number, "figure": drawing, "svg": inline(drawing, f"figure{number}-")}


def _prose(text: str) -> Markup:
    """`text` made harmless, with what stands between backticks as code, and numbers set as
    elsewhere: 2 %, ± 0.1."""
    spaced = PERCENT.sub(" %", text.replace("+- ", "± "))
    bound = BOUND.sub("\u00a0", spaced)
    return Markup(CODE.sub(r"<code>\1</code>", str(escape(bound))))


def _numeric_columns(table: Table) -> frozenset[int]:
    """The columns after the first in which most cells that are filled are numbers, with or without
    a unit."""
    columns = [[row[k].strip() for row in table.rows] for k in range(len(table.header))]
    filled = [[cell for cell in cells if cell] for cells in columns]
    return frozenset(
        k
        for k, cells in enumerate(filled)
        if k > 0 and 2 * sum(1 for cell in cells if NUMBER.fullmatch(cell)) > len(cells)
    )
