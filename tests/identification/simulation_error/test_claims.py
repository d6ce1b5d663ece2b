"""Networks leave alone what parameters can do, and nothing else."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import subspace_angles

from faultgauge.identification.fit import fit
from faultgauge.identification.optimise.levenberg_marquardt import levenberg_marquardt
from faultgauge.identification.simulation_error import networks
from faultgauge.identification.simulation_error.claims import imitating
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

from .conftest import over_stairs

SPRING = """
name = "leak"
[states.x]
derivative = "u - a*x - NN(x)"
[inputs.u]
hold = "zero"
[outputs.y]
value = "x"
[parameters]
a = { value = 1.0, min = 0 }
[networks.NN]
hidden = 5
"""
STEP, COUNT, WIDTH, NOISE = 0.05, 800, 10, 0.005


def leak(x):
    return 2 * x + 0.5 * x**3


def log(seed):
    """x' = u - 2 x - 0.5 x^3 by SciPy over every stair of u."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-5, 5, COUNT // WIDTH), WIDTH)
    x = over_stairs(lambda x, u: u - leak(x), 0.0, u, STEP, WIDTH)
    y = x + NOISE * rng.standard_normal(COUNT)
    return Run(f"leak{seed}", "leak.csv", STEP * np.arange(COUNT), {"u": u, "y": y, "x": x})


def test_rows_beside_the_samples_are_least_squares():
    """|A p - b|^2 + |C p|^2 by NumPy on the rows of both."""
    rng = np.random.default_rng(0)
    A, b, C = rng.normal(size=(30, 4)), rng.normal(size=30), 3 * rng.normal(size=(2, 4))
    samples, free = (jnp.asarray(A), jnp.asarray(b)), jnp.full(4, jnp.inf)

    def residual(theta, sample):
        return (sample[0] @ theta - sample[1])[None]

    found = levenberg_marquardt(
        residual, jnp.zeros((1, 4)), samples, None, -free, free, beside=Rows(C)
    )
    expected = np.linalg.lstsq(np.concatenate([A, C]), np.concatenate([b, np.zeros(2)]))[0]
    np.testing.assert_allclose(found.theta[0], expected, rtol=1e-6)  # it ends at 1e-10 of the cost


class Rows:
    def __init__(self, C):
        self.C = jnp.asarray(C)

    def __call__(self, theta):
        return self.C @ theta


@pytest.mark.parametrize("alike", [0, 1, 2])
def test_as_many_directions_as_small_angles_between_the_subspaces(alike):
    """`alike` of three parameters do what six weights can do, but for a hundredth of it."""
    rng = np.random.default_rng(alike)
    weights, others = rng.normal(size=(200, 6)), rng.normal(size=(200, 3))
    own = weights @ rng.normal(size=(6, 3)) + 0.01 * others
    parameters = np.concatenate([own[:, :alike], others[:, alike:]], axis=1)
    jacobian = np.concatenate([weights, parameters * [1e3, 1.0, 1e-3]], axis=1)  # of any unit
    found = imitating(jacobian.T @ jacobian, 6, [6, 7, 8])
    assert np.sum(np.cos(subspace_angles(weights, parameters)) ** 2 > 0.99) == alike
    assert found.shape == (9, alike)
    assert not found[6:].any()
    if alike:  # what the weights then do is what those parameters do
        angles = subspace_angles(weights @ found[:6], own[:, :alike])
        assert np.max(angles) < 0.02  # of 0.01, twice for being one draw


@pytest.mark.study
def test_the_parameter_carries_all_that_it_can(monkeypatch):
    """Of leak(x) the share along x, by hand: a = sum x leak(x) / sum x^2 over the visited points;
    the network has the rest, which is orthogonal to x."""
    monkeypatch.setattr(networks, "TELLING", 500)
    runs = [log(0), log(1)]
    model, report = fit(
        GrayBoxPlant.untrained(parse_plant(SPRING, "leak.toml")),
        runs[:1],
        runs[1:],
        restarts=1,
        refine=True,
    )
    x = runs[0].columns["x"]
    assert report.refinement is not None
    (a,) = report.refinement.information.constants
    # 500 of 800 points, and features that imitate x to some parts in a thousand
    assert a.value == pytest.approx(x @ leak(x) / (x @ x), rel=0.01)
    rest = np.array([float(model.plant.networks["NN"](jnp.asarray(each))) for each in x])
    assert abs(rest @ x) < 0.03 * np.linalg.norm(rest) * np.linalg.norm(x)
    np.testing.assert_allclose(a.value * x + rest, leak(x), atol=0.02 * np.max(leak(x)))
    assert a.imitated_by == "NN"
    # with the network held to it, the parameter is as well known as noise of 0.005 allows
    assert a.standard_error is not None
    assert a.standard_error < 0.01 * a.value


def test_what_says_nothing_claims_nothing():
    """No output moves, or the simulation does not hold."""
    for hessian in (np.zeros((5, 5)), np.full((5, 5), np.nan)):
        assert imitating(hessian, 3, [3, 4]).shape == (5, 0)
