"""A small tank whose truth is known in closed form, its logs, and one fitted model."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from faultgauge.cli.app import run

STEP, COUNT = 0.1, 600
A, B, LEAK = 0.8, 2.5, 0.6
NOISE = 0.002
PLANT = """name = "tank"

[states.x]
unit = "m"
derivative = "b*u - a*x"

[inputs.u]
unit = "V"

[outputs.x]
unit = "m"
value = "x"

[parameters]
a = { value = 1.0, min = 0 }
b = { value = 1.0 }

[faults.leak]
enters = "state"
target = "x"
unit = "m/s"
"""


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


def write_log(path, seed, leak=0.0):
    """x' = b u - a x + f over each held input, exactly, with sensor noise; f from the middle."""
    random = np.random.default_rng(seed)
    u = np.repeat(random.choice([-1.0, 1.0], COUNT // 10), 10)
    f = np.where(np.arange(COUNT) >= COUNT // 2, leak, 0.0)
    x, decay = np.zeros(COUNT), np.exp(-A * STEP)
    for k in range(COUNT - 1):
        x[k + 1] = decay * x[k] + (1 - decay) / A * (B * u[k] + f[k])
    x += NOISE * random.standard_normal(COUNT)
    rows = zip(STEP * np.arange(COUNT), u, x, strict=True)
    path.write_text("t,u,x\n" + "".join(f"{t:.10g},{v:.10g},{y:.10g}\n" for t, v, y in rows))


@pytest.fixture(scope="session")
def workshop(tmp_path_factory) -> Workshop:
    folder = tmp_path_factory.mktemp("workshop")
    paths = {name: folder / f"{name}.csv" for name in ("healthy", "healthy2", "suspect")}
    write_log(paths["healthy"], 1)
    write_log(paths["healthy2"], 2)
    write_log(paths["suspect"], 3, LEAK)
    plant, model, calibrated, limited = (
        folder / name for name in ("plant.toml", "model.fgm", "calibrated.fgm", "limited.fgm")
    )
    plant.write_text(PLANT)
    assert run(["fit", str(plant), str(paths["healthy"]), "--out", str(model)]) == 0
    healthy = str(paths["healthy2"])
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
