"""Noise in a measured state: equation error is biased by it, simulation error is not."""

import numpy as np
import pytest

from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

from .conftest import over_stairs

pytestmark = pytest.mark.study

WHEEL = """
name = "wheel with drag"
[states.h]
derivative = "k*u - c*h - g*h*abs(h)"
[inputs.u]
hold = "zero"
[outputs.h]
value = "h"
[parameters]
k = { value = 0.5, min = 0 }
c = { value = 0.5, min = 0 }
g = { value = 0.5, min = 0 }
"""
TRUTH = np.array([1.0, 0.2, 0.4])
STEP, COUNT, WIDTH, SEEDS = 0.1, 600, 10, 10
LEVELS = (0.02, 0.1, 0.3)  # the state's own spread is 0.9


@pytest.fixture(scope="module")
def experiment():
    """(u, h): h' = u - 0.2 h - 0.4 h |h| by SciPy over every stair."""
    u = np.repeat(np.random.default_rng(7).uniform(-2, 2, COUNT // WIDTH), WIDTH)
    return u, over_stairs(lambda h, u: u - 0.2 * h - 0.4 * h * abs(h), 0.3, u, STEP, WIDTH)


@pytest.fixture(scope="module")
def fits(experiment):
    """Per noise level (equation error, simulation error, its standard errors), a row per seed."""
    u, h = experiment
    model = GrayBoxPlant.untrained(parse_plant(WHEEL, "wheel.toml"))
    found = {}
    for level in LEVELS:
        rows = []
        for seed in range(SEEDS):
            noise = level * np.random.default_rng(seed).standard_normal(COUNT)
            log = Run("wheel", "wheel.csv", STEP * np.arange(COUNT), {"u": u, "h": h + noise})
            plain, _ = fit(model, [log], restarts=3, refine=False)
            refined, report = fit(model, [log], restarts=3, refine=True)
            assert report.refinement is not None
            values = [[float(m.plant.parameters[p]) for p in "kcg"] for m in (plain, refined)]
            errors = [c.standard_error for c in report.refinement.information.constants]
            rows.append([*values, errors])
        found[level] = np.array(rows, float).transpose(1, 0, 2)
    return found


@pytest.mark.parametrize("level", LEVELS)
def test_simulation_error_is_unbiased(fits, level):
    _, values, errors = fits[level]
    bias = values.mean(axis=0) - TRUTH
    # four standard errors of a mean of ten, for nine of them: by chance with 6e-4
    assert np.all(np.abs(bias) < 4 * errors.mean(axis=0) / np.sqrt(SEEDS))


def test_equation_error_is_biased_by_strong_noise(fits):
    """Drag is taken for damping: noise in h makes h |h| look smaller than what h does."""
    plain, refined, _ = fits[LEVELS[-1]]
    error = plain.mean(axis=0) - TRUTH
    assert np.all(np.abs(error[1:]) > 3 * plain.std(axis=0, ddof=1)[1:] / np.sqrt(SEEDS))
    assert np.all(np.abs(error[1:]) > 3 * np.abs(refined.mean(axis=0) - TRUTH)[1:])


def test_the_error_grows_as_the_noise(fits):
    """Least squares of a simulation: standard errors are proportional to the noise."""
    sizes = np.array([fits[level][2].mean(axis=0) / level for level in LEVELS])
    # the noise's own standard deviation is known to 1 / sqrt(2 * 600 * 10) = 1 %; the curvature
    # at the fitted constants moves with them, by their error of up to a fifth
    np.testing.assert_allclose(sizes[0] / sizes[1:], 1.0, atol=0.25)
