"""faultgauge: how big is the fault, in your units, while the loop is still closed?

The verbs of the command line as functions; importing the package loads nothing heavy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from faultgauge.accommodation.simulate import simulate
    from faultgauge.detection.calibration import calibrate
    from faultgauge.detection.decisions import decide_runs as estimate
    from faultgauge.detection.watch import Watch
    from faultgauge.foresight import detectability
    from faultgauge.identification.evaluation import evaluate
    from faultgauge.identification.fit import fit
    from faultgauge.plants.gray_box import load_plant
    from faultgauge.plants.model import load_model, save_model
    from faultgauge.plants.plant import Plant
    from faultgauge.rehearsal import rehearse
    from faultgauge.telemetry import read_telemetry

__all__ = [
    "Plant",
    "Watch",
    "calibrate",
    "detectability",
    "estimate",
    "evaluate",
    "fit",
    "load_model",
    "load_plant",
    "read_telemetry",
    "rehearse",
    "save_model",
    "simulate",
]

_HOMES = {
    "Plant": "faultgauge.plants.plant.Plant",
    "Watch": "faultgauge.detection.watch.Watch",
    "calibrate": "faultgauge.detection.calibration.calibrate",
    "detectability": "faultgauge.foresight.detectability",
    "estimate": "faultgauge.detection.decisions.decide_runs",
    "evaluate": "faultgauge.identification.evaluation.evaluate",
    "fit": "faultgauge.identification.fit.fit",
    "load_model": "faultgauge.plants.model.load_model",
    "load_plant": "faultgauge.plants.gray_box.load_plant",
    "read_telemetry": "faultgauge.telemetry.read_telemetry",
    "rehearse": "faultgauge.rehearsal.rehearse.rehearse",
    "save_model": "faultgauge.plants.model.save_model",
    "simulate": "faultgauge.accommodation.simulate.simulate",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'faultgauge' has no attribute {name!r}")
    module, _, attribute = _HOMES[name].rpartition(".")
    return getattr(import_module(module), attribute)
