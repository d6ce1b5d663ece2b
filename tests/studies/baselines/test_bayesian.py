"""Evidence against the textbook's formulas with an inverse written out."""

import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from faultgauge_studies.baselines.baseline import (
    Baseline,
    Record,
    Scaling,
    Weights,
    one_step,
)
from faultgauge_studies.baselines.bayesian import evidence_step, train_by_evidence
from faultgauge_studies.baselines.narx import narx
from faultgauge_studies.baselines.training import RunResidual, with_weights

COLUMNS, SAMPLES = 12, 120


class Line(Baseline):
    """y = slope u: linear in its parameters, so that everything has a closed form."""

    weights: Weights
    scaling: Scaling

    def begin(self, u, y):
        return None

    def step(self, carry, u, y):
        return None, (self.weights["slope"] @ u)[None]


def line():
    ones = jnp.ones(COLUMNS)
    return Line({"slope": ones}, Scaling(0 * ones, ones, jnp.zeros(1), jnp.ones(1)))


def data(noise, seed=0):
    """Two of twelve columns matter; columns of sizes 1 to 0.01, so that some are in doubt."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(SAMPLES, COLUMNS)) * np.logspace(0, -2, COLUMNS)
    y = 1.5 * u[:, :1] - 2.0 * u[:, 1:2] + noise * rng.normal(size=(SAMPLES, 1))
    return Record(u[None], y[None])


def textbook(J, r, theta, ratio):
    """MacKay's update from beta = 1, alpha = ratio; J is (equations, parameters)."""
    alpha, beta = ratio, 1.0
    n, p = J.shape
    H = 2 * beta * J.T @ J + 2 * alpha * np.eye(p)
    gamma = p - 2 * alpha * np.trace(np.linalg.inv(H))
    return gamma, (gamma / (2 * theta @ theta)) / ((n - gamma) / (2 * r @ r))


def both(model, record, theta, ratio):
    record = Record(*map(jnp.asarray, record))
    return evidence_step(RunResidual(model, True), jnp.asarray(theta), record, jnp.asarray(ratio))


@pytest.mark.parametrize("ratio", [1e-6, 1e-2, 1.0, 1e3])
def test_step_is_the_textbooks(ratio):
    record = data(0.3)
    theta = np.random.default_rng(1).normal(size=COLUMNS)
    J = record.u[0]
    gamma, after = both(line(), record, theta, ratio)
    expected = textbook(J, J @ theta - record.y[0, :, 0], theta, ratio)
    # alpha tr(H^-1) is of size p: the inverse's rounding times the condition (1e4) of J'J
    assert float(gamma) == pytest.approx(expected[0], abs=1e-10)
    assert float(after) == pytest.approx(expected[1], rel=1e-8)


def test_scale_of_beta_does_not_matter():
    """The step knows alpha/beta alone; with beta = 7 the formulas give the same."""
    record, ratio = data(0.3), 0.05
    J = record.u[0]
    beta, alpha = 7.0, 7.0 * ratio
    H = 2 * beta * J.T @ J + 2 * alpha * np.eye(COLUMNS)
    gamma = both(line(), record, np.ones(COLUMNS), ratio)[0]
    expected = COLUMNS - 2 * alpha * np.trace(np.linalg.inv(H))
    assert float(gamma) == pytest.approx(expected, abs=1e-10)  # as above


def test_step_of_a_network_is_the_textbooks():
    """Two runs, series-parallel; its Jacobian by central differences."""
    rng = np.random.default_rng(2)
    record = Record(rng.uniform(-1, 1, (2, 40, 1)), rng.uniform(-2, 2, (2, 40, 1)))
    model = narx(Scaling.of(record), 2, rng)
    theta = np.asarray(ravel_pytree(model.weights)[0])

    def residual(theta):
        each = with_weights(model, jnp.asarray(theta))
        runs = [one_step(each, Record(u, y)) - y for u, y in zip(*record, strict=True)]
        return np.concatenate(runs)[:, 0] / float(model.scaling.y_scale[0])

    steps = 1e-6 * np.eye(len(theta))
    J = np.stack([(residual(theta + d) - residual(theta - d)) / 2e-6 for d in steps], axis=1)
    gamma, after = both(model, record, theta, 0.1)
    expected = textbook(J, residual(theta), theta, 0.1)
    # differences are good to 1e-10 of a slope, gamma to about that times p
    assert float(gamma) == pytest.approx(expected[0], abs=1e-7)
    assert float(after) == pytest.approx(expected[1], rel=1e-7)


def ridge(J, y, ratio):
    return np.linalg.solve(J.T @ J + ratio * np.eye(J.shape[1]), J.T @ y)


def fixed_point(J, y):
    """Ridge and the textbook's update in turn, until nothing moves."""
    ratio = 0.01 / len(y)
    for _ in range(1000):
        theta = ridge(J, y, ratio)
        gamma, ratio = textbook(J, J @ theta - y, theta, ratio)
    return theta, gamma, ratio


@pytest.mark.parametrize("noise", [0.03, 0.3])
def test_training_ends_at_the_fixed_point(noise):
    record = data(noise)
    (found,) = train_by_evidence([line()], record, "series_parallel")
    theta, gamma, ratio = fixed_point(record.u[0], record.y[0, :, 0])
    assert found.parameters == COLUMNS
    # it ends once gamma moves by 1e-3; the iteration contracts by about a half here
    assert found.gamma == pytest.approx(gamma, rel=5e-3)
    assert found.ratio == pytest.approx(ratio, rel=2e-2)
    ours = np.asarray(found.model.weights["slope"])
    assert np.linalg.norm(ours - theta) < 1e-2 * np.linalg.norm(theta)
    assert found.trials > 0


def test_more_noise_weighs_the_weights_more():
    found = [train_by_evidence([line()], data(s), "series_parallel")[0] for s in (0.01, 0.1, 1.0)]
    ratios, gammas = [f.ratio for f in found], [f.gamma for f in found]
    assert ratios[0] < ratios[1] < ratios[2]
    assert COLUMNS > gammas[0] > gammas[1] > gammas[2] > 0


def test_network_too_large_has_fewer_effective_parameters():
    """16 weights for a line with noise; from every start, each with its own evidence."""
    rng, noise = np.random.default_rng(3), 0.1

    def measured(samples):
        u = rng.uniform(-1, 1, (1, samples, 1))
        return u, Record(u, 0.8 * u + noise * rng.normal(size=u.shape))

    _, record = measured(60)
    u, fresh = measured(500)
    models = [narx(Scaling.of(record), 3, np.random.default_rng(k), 1, 1) for k in range(2)]
    for found in train_by_evidence(models, record, "series_parallel"):
        assert found.parameters == 16  # 3 units of 3 arguments, and 3 + 3 + 1
        assert 1 < found.gamma < 0.5 * found.parameters
        y = one_step(found.model, Record(fresh.u[0], fresh.y[0]))
        error = np.sqrt(np.mean((np.asarray(y) - 0.8 * u[0]) ** 2))
        # gamma parameters of 60 samples take up gamma/60 of the noise's power; twice its root
        assert error < 2 * noise * np.sqrt(found.gamma / 60)


def test_given_models_stay_as_they_are():
    model = line()
    train_by_evidence([model], data(0.1), "series_parallel")
    np.testing.assert_array_equal(model.weights["slope"], np.ones(COLUMNS))
