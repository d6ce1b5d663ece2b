"""Reading logs: from files to runs of named, time-stamped signals.

`read_telemetry` is the way in; `inspect_runs` and `plant_skeleton` describe a log before there is
a plant. Readers live in `readers/`, one file format each.
"""

from faultgauge.telemetry.inspection import Inspection, inspect_runs
from faultgauge.telemetry.reading import check_same_units, read_telemetry
from faultgauge.telemetry.resampling import rate_of, resampled
from faultgauge.telemetry.runs import Run, as_sampled, cut, segments
from faultgauge.telemetry.skeleton import plant_skeleton

__all__ = [
    "Inspection",
    "Run",
    "as_sampled",
    "check_same_units",
    "cut",
    "inspect_runs",
    "plant_skeleton",
    "rate_of",
    "read_telemetry",
    "resampled",
    "segments",
]
