"""What a model can be exported to: a function from what is asked for to files by name."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from faultgauge.export.c_project import c_project
from faultgauge.export.fmu import binary_in_words, fmu_project
from faultgauge.export.request import Request

__all__ = ["TARGETS", "Target"]


class Target(NamedTuple):
    """The `files` of a model, and what one does `next` with those in a folder."""

    files: Callable[[Request], dict[str, bytes]]
    next: Callable[[Path], str]


TARGETS = {
    "c": Target(c_project, lambda out: f"next: make -C {out} test"),
    "fmu": Target(
        fmu_project,
        lambda out: (
            f"both have sources and {binary_in_words()}; next: import one in your simulator"
        ),
    ),
}
