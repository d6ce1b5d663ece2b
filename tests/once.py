"""Noise that is looked for once, where several calibrations of one model by the same logs are made
and none of them is asked for it."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from faultgauge.detection.calibration import calibration
from faultgauge.plants.model import encoded

__all__ = ["looked_once"]

FOUND = {}
LOOK = calibration.estimate_noise


@contextmanager
def looked_once(by_plant: bool = False) -> Iterator[None]:
    """Calibrations take the noise that an earlier one of the same bytes has found here; `by_plant`,
    one of the same plant file with any constants and logs, where all these have one sensor."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "estimate_noise", _of_plant if by_plant else _once)
        yield


def _once(model, runs, *others):
    key = encoded(model), *(run.content_hash for run in runs)
    return _found(key, model, runs, *others)


def _of_plant(model, runs, *others):
    return _found(model.plant.spec.text, model, runs, *others)


def _found(key, model, runs, *others):
    if key not in FOUND:
        FOUND[key] = LOOK(model, runs, *others)
    return FOUND[key]
