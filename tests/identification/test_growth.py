"""A plant that falls without its loop: how fast, and what `fit` says of its free runs."""

import numpy as np
import pytest
from scipy.linalg import expm

from faultgauge.identification.fit import fit
from faultgauge.identification.samples import Samples
from faultgauge.identification.validation.growth import growth
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

PLANT = """
name = "falls"
[states.x]
derivative = "a*x - x**3 + u"
[inputs.u]
hold = "zero"
instrument = "r"
[outputs.x]
value = "x"
[parameters]
a = { value = 2.5 }
"""
STEP, COUNT, A = 0.05, 4000, 2.0


def log(seed):
    """x' = A x + u exactly, of which the cube is next to nothing, under u = r - 6 x as measured."""
    rng = np.random.default_rng(seed)
    r = np.repeat(rng.uniform(-0.02, 0.02, COUNT // 20), 20)
    (grow, push), _ = expm(np.array([[A, 1.0], [0.0, 0.0]]) * STEP)
    u, y, state = np.zeros(COUNT), np.zeros(COUNT), 0.0
    noise, drive = rng.standard_normal((2, COUNT))
    for k in range(COUNT):
        y[k] = state + 1e-4 * noise[k]
        u[k] = r[k] - 6 * y[k]
        state = grow * state + push * u[k] + 1e-4 * drive[k]
    return Run(f"r{seed}", "falls.csv", STEP * np.arange(COUNT), {"x": y, "u": u, "r": r})


def test_how_fast_a_plant_runs_away_is_its_slope():
    """a - 3 x^2 of x in 0, 0.5 and 1 is 2.5, 1.75 and -0.5: the median is 1.75."""
    plant = GrayBoxPlant.untrained(parse_plant(PLANT))
    x = np.array([[0.0], [0.5], [1.0]])
    samples = Samples(x=x, u=0 * x, dx=0 * x, y=x)
    assert growth(plant, samples) == pytest.approx(1.75, rel=1e-12)


def test_of_a_plant_that_falls_no_free_run_is_asked_for_an_opinion():
    _, account = fit(GrayBoxPlant.untrained(parse_plant(PLANT)), [log(0), log(1)], restarts=1)
    (said,) = [each for each in account.warnings if "runs away" in each]
    assert said == account.no_use
    assert "do not use" not in " ".join(account.warnings)
    assert "2.7 times as much 0.5 s later" in said  # 1 / A
