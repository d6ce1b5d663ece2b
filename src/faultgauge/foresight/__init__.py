"""Foresight: what could be seen of declared faults in given logs, before anything breaks."""

from faultgauge.foresight.result import Sheet
from faultgauge.foresight.sheet import detectability

__all__ = ["Sheet", "detectability"]
