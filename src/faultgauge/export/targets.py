"""What a model can be exported to: a function from what is asked for to files by name."""

from collections.abc import Callable

from faultgauge.export.c_project import c_project
from faultgauge.export.request import Request

__all__ = ["TARGETS"]

TARGETS: dict[str, Callable[[Request], dict[str, bytes]]] = {"c": c_project}
