"""A linear tank that is known exactly, its healthy logs, and one calibrated model."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import tanks
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration import calibration
from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model, save_model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

PLANT = """name = "tank"

[states.x]
unit = "m"
derivative = "b*u - a*x"

[inputs.u]
unit = "V"
min = -3
max = 3

[outputs.x]
unit = "m"
value = "x"

[parameters]
a = { value = 0.8, fixed = true }
b = { value = 1.0 }

[faults.bias]
enters = "input"
target = "u"
unit = "V"

[faults.drift]
enters = "output"
target = "x"
unit = "m"
max = 1.0
"""


# that of the logs' sensor, with next to no error of the model; b differs by some per cent
NOISE = Noise(
    *(np.array(each) for each in (
        [tanks.NOISE], [1e-6], [], *([1e-4], [8.0], [1e-4], [3.0]), [0.04], [0.0], [0.0]
    ))
)  # fmt: skip


def healthy(seed, count=400):
    columns = tanks.log(seed, count=count)
    return Run(f"h{seed}", f"h{seed}.csv", columns.pop("t"), columns)


@pytest.fixture(scope="session")
def log():
    """Make a healthy log: `log(seed, count) -> Run`."""
    return healthy


@dataclass(frozen=True)
class Tank:
    """Models in memory and as files, and logs as files."""

    folder: Path
    fitted: Model
    calibrated: Model


@pytest.fixture(scope="session")
def tank(tmp_path_factory) -> Tank:
    folder = tmp_path_factory.mktemp("tank")
    plant = GrayBoxPlant.untrained(parse_plant(PLANT, "tank.toml"))
    fitted, _ = fit(plant, [healthy(1)])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "estimate_noise", lambda *_: NOISE)
        calibrated = calibration.calibrate(fitted, [healthy(2, 800), healthy(3, 800)]).model
    save_model(fitted, folder / "fitted.fgm")
    save_model(calibrated, folder / "calibrated.fgm")
    for seed, count in ((2, 800), (4, 400), (5, 100)):
        tanks.as_csv(tanks.log(seed, count=count), folder / f"h{seed}.csv", 17)
    return Tank(folder, fitted, calibrated)
