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
def looked_once() -> Iterator[None]:
    """Calibrations take the noise that an earlier one of the same bytes has found here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "estimate_noise", _once)
        yield


def _once(model, runs, *others):
    key = encoded(model), *(run.content_hash for run in runs)
    if key not in FOUND:
        FOUND[key] = LOOK(model, runs, *others)
    return FOUND[key]
