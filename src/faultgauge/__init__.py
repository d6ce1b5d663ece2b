"""faultgauge: how big is the fault, in your units, while the loop is still closed?

The verbs of the command line as functions: `read`, `plant`, `load`, and `fit`, `evaluate`,
`calibrate`, `estimate`, `rehearse`, `detectability`, `simulate` and `check`, which give one object
each. Importing the package loads nothing heavy.

    import faultgauge as fg

    fit = fg.fit("tank", healthy)                       # a path, a data frame, a dict of arrays
    model = fg.calibrate(fit.model, more_healthy).model
    answer = fg.estimate(model, suspect)
    print(answer)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from faultgauge.settings import set_for_programs as _set_for_programs

if TYPE_CHECKING:
    from faultgauge.detection.watch import Watch
    from faultgauge.plants.gray_box import load_plant
    from faultgauge.plants.model import load_model, save_model
    from faultgauge.plants.plant import Plant
    from faultgauge.telemetry import read_telemetry
    from faultgauge.verbs.calibrate import calibrate
    from faultgauge.verbs.campaign import campaign
    from faultgauge.verbs.check import check
    from faultgauge.verbs.detectability import detectability
    from faultgauge.verbs.estimate import estimate
    from faultgauge.verbs.evaluate import evaluate
    from faultgauge.verbs.fit import fit
    from faultgauge.verbs.plants import load, plant
    from faultgauge.verbs.reading import read
    from faultgauge.verbs.rehearse import rehearse
    from faultgauge.verbs.simulate import simulate

__all__ = [
    "Plant",
    "Watch",
    "calibrate",
    "campaign",
    "check",
    "detectability",
    "estimate",
    "evaluate",
    "fit",
    "load",
    "load_model",
    "load_plant",
    "plant",
    "read",
    "read_telemetry",
    "rehearse",
    "save_model",
    "simulate",
]

_HOMES = {
    "Plant": "faultgauge.plants.plant.Plant",
    "Watch": "faultgauge.detection.watch.Watch",
    "calibrate": "faultgauge.verbs.calibrate.calibrate",
    "campaign": "faultgauge.verbs.campaign.campaign",
    "check": "faultgauge.verbs.check.check",
    "detectability": "faultgauge.verbs.detectability.detectability",
    "estimate": "faultgauge.verbs.estimate.estimate",
    "evaluate": "faultgauge.verbs.evaluate.evaluate",
    "fit": "faultgauge.verbs.fit.fit",
    "load": "faultgauge.verbs.plants.load",
    "load_model": "faultgauge.plants.model.load_model",
    "load_plant": "faultgauge.plants.gray_box.load_plant",
    "plant": "faultgauge.verbs.plants.plant",
    "read": "faultgauge.verbs.reading.read",
    "read_telemetry": "faultgauge.telemetry.read_telemetry",
    "rehearse": "faultgauge.verbs.rehearse.rehearse",
    "save_model": "faultgauge.plants.model.save_model",
    "simulate": "faultgauge.verbs.simulate.simulate",
}


_set_for_programs()


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'faultgauge' has no attribute {name!r}")
    module, _, attribute = _HOMES[name].rpartition(".")
    return getattr(import_module(module), attribute)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
