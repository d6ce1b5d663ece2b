"""What parameters would explain if they changed, against least squares with and without that."""

import numpy as np
import pytest

from faultgauge.identification.fit import fit
from faultgauge.identification.simulation_error.constancy import drops, steps
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run


@pytest.mark.parametrize("prior", [0.0, 3.0])
def test_a_linear_problem(prior):
    """There the first order is all: the drop is the difference of two least squares."""
    rng = np.random.default_rng(0)
    J, r = rng.standard_normal((60, 9)), rng.standard_normal(60)
    fitted, own = np.array([0, 1, 2, 4, 5]), [np.array([3, 6]), np.array([7, 8])]
    penalty = np.zeros((5, 9))
    penalty[np.arange(5), fitted] = np.sqrt(prior)

    def least(columns):
        A = np.concatenate([J, penalty])[:, columns]
        b = np.concatenate([r, np.zeros(5)])
        return np.sum((b - A @ np.linalg.lstsq(A, b)[0]) ** 2)

    hessian, gradient = J.T @ J, J.T @ r
    inner = np.linalg.inv(hessian[np.ix_(fitted, fitted)] + prior * np.eye(5))
    found = drops(hessian, inner, gradient, fitted, own)
    wanted = [least(fitted) - least(np.concatenate([fitted, each])) for each in own]
    np.testing.assert_allclose(found, wanted, rtol=1e-9)  # rounding


def test_what_is_fitted_already_explains_nothing_more():
    """The sum of a parameter's steps is the parameter itself."""
    rng = np.random.default_rng(1)
    part = rng.standard_normal((50, 2))
    J, r = np.column_stack([part.sum(axis=1), part]), rng.standard_normal(50)
    r -= J[:, 0] * (J[:, 0] @ r) / (J[:, 0] @ J[:, 0])
    own = [np.array([1, 2])]
    found = drops(J.T @ J, np.array([[1 / (J[:, 0] @ J[:, 0])]]), J.T @ r, np.array([0]), own)
    wanted = np.sum(r**2) - np.sum((r - part @ np.linalg.lstsq(part, r)[0]) ** 2)
    np.testing.assert_allclose(found, [wanted], rtol=1e-9)


def test_steps():
    found = steps(10, 4, 2)
    assert found.shape == (10, 4, 2)
    np.testing.assert_array_equal(found.sum(axis=1), 1.0)  # one part at a time
    np.testing.assert_array_equal(found[..., 0].argmax(axis=1), [0, 0, 0, 1, 1, 2, 2, 2, 3, 3])
    np.testing.assert_array_equal(found[..., 0], found[..., 1])


HEATER = """
name = "heater"
[states.T]
derivative = "b*u - a*T"
[inputs.u]
hold = "zero"
[outputs.T]
value = "T"
[parameters]
a = { value = 0.5, min = 0 }
b = { value = 1.0, min = 0 }
"""


def heated(seed, b, outliers=0):
    """T' = b u - 0.8 T under a zero-order hold, noise 0.02; some samples 50 times as far off."""
    rng = np.random.default_rng(seed)
    u, T, decay = np.repeat(rng.uniform(-2, 2, 30), 10), np.zeros(300), np.exp(-0.08)
    for k in range(299):
        T[k + 1] = decay * T[k] + (1 - decay) / 0.8 * b * u[k]
    T += 0.02 * rng.standard_normal(300)
    T[rng.choice(300, outliers, replace=False)] += 1.0
    return Run(f"heat{seed}", "heat.csv", 0.1 * np.arange(300), {"u": u, "T": T})


@pytest.mark.study
def test_outliers_of_a_robust_fit_change_no_constant():
    """They are most of the squared error, and constants of parts of a run follow hardly any."""
    plant = GrayBoxPlant.untrained(parse_plant(HEATER, "heater.toml"))
    logs = [heated(seed, 2.0, outliers=9) for seed in range(2)]
    _, report = fit(plant, logs, restarts=2, robust=True)
    assert not [each for each in report.warnings if "seems to change" in each]
    # 2 runs of 4 parts, 600 samples white but for the few outliers: 8 / 600 by chance, times five
    assert max(report.refinement.information.changing.values()) < 0.07


def test_a_constant_of_every_run_is_told_as_such():
    plant = GrayBoxPlant.untrained(parse_plant(HEATER, "heater.toml"))
    logs = [heated(seed, b) for seed, b in enumerate((1.5, 2.5))]
    _, report = fit(plant, logs, restarts=2, refine=True)
    (told,) = [each for each in report.warnings if "seems to change" in each]
    assert told.startswith("parameter 'b' ")
    assert "between them" in told
    assert '"run"' in told
