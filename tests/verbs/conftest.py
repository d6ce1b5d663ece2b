"""The tank in memory, and what was learned of it."""

from types import SimpleNamespace

import pytest

import faultgauge as fg
from once import looked_once
from tanks import COUNT, LEAK, PLANT, STEP, A, B, log


@pytest.fixture(scope="session")
def tank():
    """`log(seed, leak)`, and what is true of it."""
    return SimpleNamespace(log=log, plant=PLANT, a=A, b=B, leak=LEAK, step=STEP, count=COUNT)


@pytest.fixture(scope="session")
def learned():
    return fg.fit(PLANT, log(1))


@pytest.fixture(scope="session")
def calibrated(learned):
    with looked_once():
        return fg.calibrate(learned.model, log(2))


@pytest.fixture(scope="session")
def judged(calibrated):
    return fg.estimate(calibrated.model, log(3, LEAK))
