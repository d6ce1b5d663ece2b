"""The tank as files: its logs, and one fitted model."""

import json
from dataclasses import dataclass
from pathlib import Path

import pytest

from faultgauge.cli.app import run
from once import looked_once
from tanks import COUNT, LEAK, PLANT, STEP, as_csv, log


@dataclass(frozen=True)
class Workshop:
    """Files that all tests here read and none changes."""

    folder: Path
    plant: Path
    healthy: Path
    healthy2: Path
    suspect: Path
    model: Path
    calibrated: Path
    limited: Path
    onset: float
    leak: float

    def judging(self, observer) -> Path:
        """The model that is calibrated for `observer`."""
        return self.calibrated if observer == "bank" else self.limited


@dataclass(frozen=True)
class Outcome:
    """One call of the command line."""

    code: int
    out: str
    err: str

    @property
    def json(self):
        return json.loads(self.out)


@pytest.fixture(scope="session")
def workshop(tmp_path_factory) -> Workshop:
    folder = tmp_path_factory.mktemp("workshop")
    paths = {name: folder / f"{name}.csv" for name in ("healthy", "healthy2", "suspect")}
    as_csv(log(1), paths["healthy"])
    as_csv(log(2), paths["healthy2"])
    as_csv(log(3, LEAK), paths["suspect"])
    plant, model, calibrated, limited = (
        folder / name for name in ("plant.toml", "model.fgm", "calibrated.fgm", "limited.fgm")
    )
    plant.write_text(PLANT)
    assert run(["fit", str(plant), str(paths["healthy"]), "--out", str(model)]) == 0
    healthy = str(paths["healthy2"])
    with looked_once():
        assert run(["calibrate", str(model), healthy, "--out", str(calibrated)]) == 0
    eso = ["--observer", "eso", "--out", str(limited)]
    assert run(["calibrate", str(model), healthy, *eso]) == 0
    return Workshop(
        folder, plant, **paths, model=model, calibrated=calibrated, limited=limited,
        onset=STEP * COUNT / 2, leak=LEAK,
    )  # fmt: skip


@pytest.fixture
def call(capsys):
    """Call the command line in this process: `call("fit", path, ...) -> Outcome`."""

    def calling(*arguments) -> Outcome:
        capsys.readouterr()
        code = run([str(each) for each in arguments])
        return Outcome(code, *capsys.readouterr())

    return calling
