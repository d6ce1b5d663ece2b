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

from faultgauge.files import write_atomically
from faultgauge.reporting.svg import Figure, inline

__all__ = ["Report", "Section", "Table", "installed_versions", "render", "with_sentences", "write"]

SHOWN_VERSIONS = ("faultgauge", "jax", "equinox", "optimistix", "numpy", "scipy", "matplotlib")
NUMBER = re.compile(r"[-+−±<>≤≥≈]?\s?\d.{0,31}|[-–—]?")


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
    """A part of a report with a heading: paragraphs of plain text, then tables, then figures."""

    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()


@dataclass(frozen=True)
class Report:
    """What a report says. All text is plain text: whatever it holds is shown, never run.

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
    """Return the report as one HTML page that fetches nothing and runs nothing."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    source = (
        resources.files("faultgauge.reporting")
        .joinpath("template.html.j2")
        .read_text(encoding="utf-8")
    )
    numbers = count(1)
    return environment.from_string(source).render(
        report=report,
        sections=[(section, list(_numbered(section, numbers))) for section in report.sections],
        numeric_columns=_numeric_columns,
    )


def write(report: Report, path: str | os.PathLike[str]) -> None:
    """Write the report; the file at `path` is at every moment the old one or the new one.

    Raises:
        InputError: the file cannot be written.
    """
    write_atomically(Path(path), render(report).encode("utf-8", "replace"))


def _numbered(section: Section, numbers: Iterator[int]) -> Iterator[dict[str, Any]]:
    """The section's figures with their numbers; each number also keeps the page's ids apart."""
    for drawing in section.figures:
        number = next(numbers)
        yield {"number": number, "figure": drawing, "svg": inline(drawing, f"figure{number}-")}


def _numeric_columns(table: Table) -> frozenset[int]:
    """The columns after the first in which every cell is a number, with or without a unit."""
    return frozenset(
        column
        for column in range(1, len(table.header))
        if all(NUMBER.fullmatch(row[column].strip()) for row in table.rows)
    )
