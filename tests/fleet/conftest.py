"""A small fleet of tanks, and its fit."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

import tanks
from faultgauge.fleet.fit import fit_fleet
from faultgauge.fleet.result import FleetFit
from tanks import STEP

# as few samples as make one window, short or long, and so one program
COUNT, NOISE = 64, 0.004
PLANT = tanks.PLANT.replace('unit = "V"', 'unit = "V"\nhold = "zero"')


@dataclass(frozen=True)
class Fleet:
    """Its logs, the folder of its fit, what was found, what is true of its units, and what was
    said while it was fitted."""

    logs: Path
    folder: Path
    found: FleetFit
    truth: dict[str, tuple[float, float]]
    said: list[str] = field(default_factory=list)


def write_log(path, seed, a, b, *, count=COUNT, moves=True, unit=None):
    """x' = b u - a x over each held input, exactly, with sensor noise."""
    random = np.random.default_rng(seed)
    u = tanks.steps(random, count, 8) if moves else np.ones(count)
    x = tanks.level(u, a=a, b=b) + NOISE * random.standard_normal(count)
    label = "" if unit is None else f"{unit},"
    rows = [
        f"{label}{t:.10g},{v:g},{y:.10g}\n"
        for t, v, y in zip(STEP * np.arange(count), u, x, strict=True)
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(("" if unit is None else "unit,") + "t,u,x\n" + "".join(rows))
    return rows


def drawn(k):
    """The constants of unit k: 10 % about (0.8, 2.5)."""
    e = np.random.default_rng([7, k]).standard_normal(2)
    return 0.8 * np.exp(0.1 * e[0]), 2.5 * (1 + 0.1 * e[1])


@pytest.fixture(scope="session")
def fleet(tmp_path_factory) -> Fleet:
    """Five units, the fourth of which holds its log in a folder; one more that cannot be fitted."""
    folder = tmp_path_factory.mktemp("fleet")
    truth = {f"tank{k}": drawn(k) for k in range(5)}
    for k, (name, (a, b)) in enumerate(truth.items()):
        path = folder / "logs" / (f"{name}/log.csv" if k == 3 else f"{name}.csv")
        write_log(path, k, a, b)
    write_log(folder / "logs" / "still.csv", 9, 0.8, 2.5, moves=False)
    (folder / "plant.toml").write_text(PLANT)
    said = []
    found = fit_fleet(
        folder / "plant.toml", [folder / "logs"], folder / "out", progress=said.append
    )
    return Fleet(folder / "logs", folder / "out", found, truth, said)
