"""Gradient descent against linear least squares, SciPy and a descent written out in NumPy."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from faultgauge.identification.fit import fit
from faultgauge.identification.optimise.gradient_descent import DescentOptions, gradient_descent
from faultgauge.identification.optimise.levenberg_marquardt import (
    CONVERGED,
    FAILED,
    NOT_CONVERGED,
    VALIDATION_STOP,
)
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.telemetry import Run

RNG = np.random.default_rng(7)
DESIGN = RNG.normal(size=(60, 4)) * [1.0, 0.5, 2.0, 1.0]
TARGET = DESIGN @ [1.0, -2.0, 3.0, 0.5] + 0.1 * RNG.normal(size=60)
LINEAR = (DESIGN, TARGET)


def linear(theta, sample):
    row, target = sample
    return (row @ theta - target)[None]


def root(theta, sample):
    """Not a number where theta[0] is negative."""
    return (jnp.sqrt(theta[0]) * sample[0] - 0.1 + theta[1] * sample[1])[None]


ROOT = (np.array([1.0, 0.0]), np.array([0.0, 1.0]))


def solve(residual, samples, starts, *, validation=None, lower=None, upper=None, **options):
    starts = jnp.atleast_2d(jnp.asarray(starts, float))
    free = np.full(starts.shape[1], np.inf)
    return gradient_descent(
        residual,
        starts,
        tuple(map(jnp.asarray, samples)),
        None if validation is None else tuple(map(jnp.asarray, validation)),
        jnp.asarray(-free if lower is None else lower, float),
        jnp.asarray(free if upper is None else upper, float),
        DescentOptions(**options),
    )


def test_linear_least_squares_is_numpys():
    x, (cost,), *_ = np.linalg.lstsq(DESIGN, TARGET, rcond=None)
    found = solve(linear, LINEAR, [np.zeros(4), np.full(4, 5.0)])
    curvature = 2 * np.linalg.eigvalsh(DESIGN.T @ DESIGN / 60)[0]
    gradient = 1e-5 * np.sqrt(4)  # four components of min_gradient each
    for k in range(2):
        assert int(found.status[k]) == CONVERGED
        # a quadratic: g / curvature in theta, 60 g^2 / (2 curvature) in cost
        np.testing.assert_allclose(found.theta[k], x, rtol=0, atol=gradient / curvature)
        assert 0 <= float(found.cost[k]) - cost <= 30 * gradient**2 / curvature
        assert float(found.validation_cost[k]) == float(found.cost[k])  # no validation set given


def test_bounds_are_respected_and_the_rest_is_optimal():
    """Two parameters end on their bound, momentum or not; SciPy's bounded solver agrees."""
    lower, upper = np.array([-1.0, -1.0, -5.0, 0.0]), np.array([5.0, 5.0, 2.0, 5.0])
    reference = lsq_linear(DESIGN, TARGET, (lower, upper), method="bvls", tol=1e-14)
    found = solve(linear, LINEAR, [np.zeros(4), np.full(4, 50.0)], lower=lower, upper=upper)
    free = DESIGN[:, [0, 3]]
    curvature = 2 * np.linalg.eigvalsh(free.T @ free / 60)[0]
    for k in range(2):  # the second start lies outside and is moved inside
        assert int(found.status[k]) == CONVERGED
        np.testing.assert_array_equal(found.theta[k][1:3], [-1.0, 2.0])
        # as above, for the two that are free
        atol = 1e-5 * np.sqrt(2) / curvature
        np.testing.assert_allclose(found.theta[k], reference.x, rtol=0, atol=atol)


def test_epochs_are_those_of_the_published_rule():
    """The rule of Vogl et al. written out; the rate starts high, so that steps are refused."""
    rate, momentum, epochs = 0.5, 0.9, 60
    cost = lambda theta: np.mean((DESIGN @ theta - TARGET) ** 2)  # noqa: E731
    gradient = lambda theta: 2 * DESIGN.T @ (DESIGN @ theta - TARGET) / 60  # noqa: E731
    theta, expected, refused = np.zeros(4), [], 0
    step = -rate * gradient(theta)
    for _ in range(epochs):
        trial_step = momentum * step - (1 - momentum) * rate * gradient(theta)
        if cost(theta + trial_step) > 1.04 * cost(theta):
            refused += 1
            rate *= 0.7
            step = -rate * gradient(theta)
        else:
            rate *= 1.05 if cost(theta + trial_step) < cost(theta) else 1.0
            theta, step = theta + trial_step, trial_step
        expected.append(60 * cost(theta))
    assert refused > 3
    found = solve(linear, LINEAR, np.zeros(4), rate=0.5, max_epochs=epochs)
    assert int(found.status[0]) == NOT_CONVERGED
    assert int(found.trials[0]) == epochs
    # the same 60 operations in another order of summation: roundings, far from any branch
    np.testing.assert_allclose(found.history[0, :, 0], expected, rtol=1e-9)
    assert float(found.cost[0]) == pytest.approx(min(expected), rel=1e-9)  # the best is kept


def test_cost_falls_and_never_jumps():
    found = solve(linear, LINEAR, np.full(4, 20.0))
    cost = np.asarray(found.history[0, : int(found.trials[0]), 0])
    # the rule itself allows 4 % up between two epochs, and no more (1e-12: rounding)
    assert np.all(cost[1:] <= 1.04 * cost[:-1] * (1 + 1e-12))
    # momentum 0.9 remembers 10 epochs: over 50 its swings are gone, until only noise is left
    floor = np.linalg.lstsq(DESIGN, TARGET, rcond=None)[1][0]
    falling = cost[:-50] > 1.1 * floor
    assert np.count_nonzero(falling) > 50
    assert np.all(cost[50:][falling] < cost[:-50][falling])
    assert cost[-1] < 1.001 * floor
    assert np.all(np.isnan(np.asarray(found.history[0, int(found.trials[0]) :])))


def test_failed_start_leaves_the_others_alone():
    good = solve(root, ROOT, [(2.0, 1.0), (1.0, 0.0), (3.0, 1.0)])
    mixed = solve(root, ROOT, [(2.0, 1.0), (-1.0, 0.0), (3.0, 1.0)])
    assert int(mixed.status[1]) == FAILED
    assert int(mixed.trials[1]) == 0
    np.testing.assert_array_equal(mixed.theta[1], [-1.0, 0.0])
    for k in (0, 2):  # the same program on the same numbers: the same bits
        assert int(mixed.status[k]) == CONVERGED
        np.testing.assert_array_equal(mixed.theta[k], good.theta[k])
        np.testing.assert_array_equal(mixed.history[k], good.history[k])


def test_step_into_non_finite_cost_is_refused():
    """A first rate of 100 leads from p = 4 far below zero, where the root is not a number."""
    found = solve(root, ROOT, (4.0, 0.0), rate=100.0, min_gradient=1e-9, max_epochs=20_000)
    assert float(found.history[0, 0, 0]) == pytest.approx(1.9**2 + 0.1**2, rel=1e-15)
    assert int(found.status[0]) == CONVERGED
    # sqrt(p) = 0.1 and p1 = 0.1; dc/dp = (sqrt(p) - 0.1)/(2 sqrt(p)) <= 1e-9: 4e-11 in p, and
    # 1e-9 in p1, where the curvature is 1
    np.testing.assert_allclose(found.theta[0], [0.01, 0.1], rtol=0, atol=2e-9)


def wiggly(theta, sample):
    """Ten sines and ten tanhs: far too many for the samples below."""
    x, y = sample
    k = jnp.arange(10)
    return (theta[:10] @ jnp.sin((k + 1) * x) + theta[10:] @ jnp.tanh(x * (k - 4.5)) - y)[None]


@pytest.mark.parametrize("max_fail", [20, 40])
def test_validation_stop_returns_the_best_validation_point(max_fail):
    rng = np.random.default_rng(3)
    x, dense = np.sort(rng.uniform(-2, 2, 24)), np.linspace(-2, 2, 101)
    training = (x, np.sin(2 * x) + 0.3 * rng.normal(size=24))
    validation = (dense, np.sin(2 * dense))
    found = solve(wiggly, training, np.zeros(20), validation=validation, max_fail=max_fail)
    trials = int(found.trials[0])
    cost, valid = np.asarray(found.history[0, :trials]).T
    best = int(np.nanargmin(valid))
    assert int(found.status[0]) == VALIDATION_STOP
    assert best > 5
    assert float(found.validation_cost[0]) == valid[best]
    assert float(found.cost[0]) == pytest.approx(cost[best], rel=1e-15)
    assert np.count_nonzero(np.isfinite(valid[best + 1 :])) == max_fail  # in vain, then the stop
    assert cost[-1] < cost[best]  # training cost still fell: this is what the stop is for
    theta = np.asarray(found.theta[0])
    k = np.arange(10)[:, None]
    again = theta[:10] @ np.sin((k + 1) * dense) + theta[10:] @ np.tanh(dense * (k - 4.5))
    again = np.sum((again - np.sin(2 * dense)) ** 2)
    assert again == pytest.approx(valid[best], rel=1e-12)  # 101 squares: rounding only


def test_several_equations_per_sample_are_one_problem():
    """Two equations per sample, and one equation over twice the samples, descend alike."""

    def both(theta, sample):
        row, target = sample
        return jnp.concatenate([linear(theta, (row, target)), linear(theta, (2 * row, target))])

    twice = (np.concatenate([DESIGN, 2 * DESIGN]), np.concatenate([TARGET, TARGET]))
    stacked = solve(both, LINEAR, np.zeros(4), max_epochs=100)
    flat = solve(linear, twice, np.zeros(4), max_epochs=100)
    # the same 120 squares in another order
    np.testing.assert_allclose(stacked.history, flat.history, rtol=1e-10)


FIRST_ORDER = """
name = "first order"
[states.x]
derivative = "b*u - drag(x)"
[inputs.u]
[outputs.x]
value = "x"
[parameters]
b = { value = 1.0 }
[networks.drag]
hidden = 3
"""


def test_fit_end_to_end():
    """x' = 2.5 u - 0.8 x under a zero-order hold (closed form), its drag left to a network."""
    step, count, a, b = 0.05, 400, 0.8, 2.5
    u = np.repeat(np.random.default_rng(0).uniform(-2, 2, count // 20), 20)
    x, decay = np.zeros(count), np.exp(-a * step)
    for k in range(count - 1):
        x[k + 1] = decay * x[k] + (1 - decay) / a * b * u[k]
    log = Run("run", "a.csv", step * np.arange(count), {"u": u, "x": x})
    plant = GrayBoxPlant.untrained(parse_plant(FIRST_ORDER, "plant.toml"))
    found = {
        name: fit(plant, [log], restarts=2, algorithm=name)  # pyright: ignore[reportArgumentType]
        for name in ("lm", "gdm")
    }
    model, report = found["gdm"]
    start = np.std(b * u) ** 2  # a mean square error this large has learned nothing
    solution = report.groups[0].solution
    assert solution.history.shape[1] == DescentOptions().max_epochs
    assert np.all(solution.cost / len(report.training.x) < 1e-2 * start)
    # descent stops where it crawls: b to a few per cent, which a start at 1.0 is far from
    assert float(model.plant.parameters["b"]) == pytest.approx(b, rel=0.05)
    assert report.groups[0].free_run[report.groups[0].chosen] < 0.05
    # the two are different algorithms on the same cost, and the second-order one gets further
    assert np.min(found["lm"][1].groups[0].solution.cost) < np.min(solution.cost)
