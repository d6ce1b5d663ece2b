"""Sensors with faults of their own that stand on one value in a log: stuck, or saturated.

A bank names the fault that hides as much. Who reads of a gain that is lost by half should know that
the column moves no more.
"""

from collections.abc import Sequence

from faultgauge.detection.decisions import Decision
from faultgauge.detection.rows.flat_line import ROOM, standing_parts
from faultgauge.detection.words import moment, number
from faultgauge.plants.model import Model
from faultgauge.plants.signals import spoken

__all__ = ["standing_in"]

OWN = ("output", "output_gain")  # where faults of a sensor enter


def standing_in(model: Model, decided: Sequence[Decision]) -> list[str]:
    """A sentence for each output that has faults of its own and repeats one value for more than
    `ROOM` times as long as in the healthy logs of the calibration."""
    known = model.calibration.repeats if model.calibration else {}
    found = []
    for output in model.plant.signals.outputs:
        faults = [
            f.name
            for f in model.plant.signals.faults
            if f.enters in OWN and f.target == output.name and f.monitor != "disabled"
        ]
        for run in (each.run for each in decided if faults and output.name in known):
            if output.name not in run.columns:
                continue
            for start, end, value in standing_parts(run, output.name, ROOM * known[output.name]):
                at, until = (moment(run.clock, t, run.step) for t in (start, end))
                shown = f"{number(value, 4)} {spoken(output.unit)}".rstrip()
                found.append(
                    f"run {run.name}: {output.name} stands on {shown} from {at} to {until}, stuck "
                    f"or saturated; the size of {' or '.join(faults)} there is by how much that "
                    "is off"
                )
    return found
