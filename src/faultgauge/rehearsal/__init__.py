"""Rehearsal: declared faults put into healthy logs, and what the calibrated model makes of them."""

from faultgauge.rehearsal.rehearse import rehearse
from faultgauge.rehearsal.result import Rehearsal

__all__ = ["Rehearsal", "rehearse"]
