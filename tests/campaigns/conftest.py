"""A campaign in a folder: a linear tank, its scenario, and a model of known noise that judges."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calibrations import for_bank
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model, save_model
from faultgauge.plants.plant_file import parse_plant
from faultgauge.plants.record import FitRecord
from faultgauge.verbs.campaign import FILES
from scenes import NOISE, SIGMA, TANK

SCENARIO = f"""name = "tank"
plant = "tank.toml"
seconds = 100
step = 0.5
[initial]
x = 5
[inputs.u]
source = "noise"
sigma = 0.2
low = 0.01
high = 0.2
offset = 1
[noise]
x = {SIGMA}
"""
CAMPAIGN = """name = "leaks"
scenario = "scenario.toml"
healthy = 1
seeds = 2
onset = 50
[judge]
model = "model.fgm"
[faults.leak]
size = [-0.001, 0.1]
[faults.gauge]
size = 0.3
[faults.silent]
enters = "output"
target = "x"
effect = "dropout"
lasts = 10
named = []
"""


def judging() -> Model:
    """The plant itself, told its noise and not asked to find it."""
    rng = np.random.default_rng(0)
    points = np.stack([rng.uniform(0, 12, 60), rng.uniform(0, 2, 60)], axis=1)
    record = {
        "max_step": 1.0,
        "sample_time": 0.5,
        "envelope": {"x": [0.0, 12.0], "u": [0.0, 2.0]},
        "envelope_points": points.tolist(),
        "columns": {"states": [["x", 0]], "outputs": ["x"]},
        "data": {"fit": [], "validate": []},
        "derivatives": {},
        "metrics": {"validation_free_run_nrmse": 0.0},
    }
    model = Model(GrayBoxPlant.untrained(parse_plant(TANK)), FitRecord.model_validate(record))
    times = {"judged_s": 10800.0, "healthy_s": 10800.0, "mtbfa_s": 3600.0}
    return for_bank(model, NOISE, level=4.0, memory_s=20.0, **times)


@pytest.fixture(scope="session")
def files(tmp_path_factory) -> Path:
    """The folder with all that a campaign file names."""
    folder = tmp_path_factory.mktemp("campaign")
    (folder / "tank.toml").write_text(TANK)
    (folder / "scenario.toml").write_text(SCENARIO)
    (folder / "campaign.toml").write_text(CAMPAIGN)
    save_model(judging(), folder / "model.fgm")
    return folder


@pytest.fixture
def written(files) -> Callable[..., Path]:
    """A campaign file with some of its text changed: `written((old, new), ...) -> Path`."""

    def writing(*changes: tuple[str, str]) -> Path:
        text = CAMPAIGN
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = files / "changed.toml"
        path.write_text(text)
        return path

    return writing


def contents(folder: Path) -> dict[str, bytes]:
    """What a campaign leaves."""
    return {name: (folder / name).read_bytes() for name in (*FILES, "campaign.json", "model.fgm")}
