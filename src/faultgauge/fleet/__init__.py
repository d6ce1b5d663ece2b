"""The verbs for many units at once: a model for each, and what the fleet tells of its next one."""

from faultgauge.fleet.calibrate import calibrate_fleet
from faultgauge.fleet.estimate import estimate_fleet
from faultgauge.fleet.fit import fit_fleet

__all__ = ["calibrate_fleet", "estimate_fleet", "fit_fleet"]
