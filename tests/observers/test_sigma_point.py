"""The sigma-point filter against the Kalman filter, and what it makes of limits and gaps."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.observers.sigma_point import Belief, Hypothesis, SigmaPointFilter, triangular
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant

MASS = """
name = "mass"
[states.q]
derivative = "v"
[states.v]
derivative = "u"
[inputs.u]
min = -1
max = 1
[outputs.q]
value = "q"
[faults.bias]
enters = "input"
target = "u"
"""
SIGMA, PROCESS, WALK = 0.1, (0.02, 0.05), 0.03


def mass_filter():
    hypothesis = Hypothesis(
        select=jnp.ones((1, 1)),
        process=jnp.array(PROCESS),
        walk=jnp.array([WALK]),
        sigma=jnp.array([SIGMA]),
    )
    return SigmaPointFilter(GrayBoxPlant.untrained(parse_plant(MASS)), hypothesis, (), 1)


@eqx.filter_jit
def step(lane, belief, before, u, y, dt):
    return lane.step(belief, before, u, y, dt)


def kalman(u, y, dt, mean, P):
    """The textbook filter of [q, v, bias] over steps `dt`; y NaN where there is no sample."""
    total = 0.0
    for k in range(len(y)):
        h = dt[k]
        if k:
            F = np.array([[1, h, h**2 / 2], [0, 1, h], [0, 0, 1]])
            mean = F @ mean + np.array([h**2 / 2, h, 0]) * u[k - 1]
            P = F @ P @ F.T + h * np.diag([*np.square(PROCESS), WALK**2])
        if np.isfinite(y[k]):
            S = P[0, 0] + SIGMA**2
            K = P[:, 0] / S
            e = y[k] - mean[0]
            mean, P = mean + K * e, P - np.outer(K, P[0])
            total += -0.5 * (e**2 / S + np.log(2 * np.pi * S))
    return mean, P, total


def test_a_linear_plant_gives_the_kalman_filter_over_uneven_steps_and_missing_samples():
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-0.2, 0.2, 40), rng.standard_normal(40)
    dt = rng.uniform(0.05, 0.2, 40)
    y[[7, 20, 21]] = np.nan
    start, P = np.array([0.1, -0.2, 0.05]), np.diag([0.2, 0.3, 0.02]) ** 2
    lane, belief, total = mass_filter(), Belief(jnp.asarray(start), jnp.asarray(np.sqrt(P))), 0.0
    for k in range(len(y)):
        before = jnp.array([u[max(k - 1, 0)]])
        h = jnp.asarray(dt[k] if k else 0.0)
        belief, more, _ = step(lane, belief, before, jnp.array([u[k]]), jnp.array([y[k]]), h)
        total += float(more)
    mean, P, expected = kalman(u, y, dt, start, P)
    root = np.asarray(belief.root)
    # Cubature is exact on a linear plant: what is left is rounding over 40 updates.
    np.testing.assert_allclose(np.asarray(belief.mean), mean, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(root @ root.T, P, rtol=1e-8, atol=1e-13)
    assert total == pytest.approx(expected, rel=1e-9)


def test_a_bias_that_the_limit_cuts_off_is_not_learned_and_the_other_sign_is():
    """At u = 1 a positive bias moves nothing: the filter of a mass that coasts as healthy keeps a
    wide belief there, and a mass that accelerates less than it should gives a bias away."""
    lane = mass_filter()
    t = np.arange(1, 60) * 0.1
    found = {}
    for bias in (0.0, -0.5):
        belief = Belief(jnp.array([0.0, 0.0, 0.0]), jnp.diag(jnp.array([0.05, 0.05, 1.0])))
        for q in (1 + bias) * t**2 / 2:
            u = jnp.array([1.0])
            belief = step(lane, belief, u, u, jnp.array([q]), jnp.asarray(0.1))[0]
        sd = float(np.linalg.norm(np.asarray(belief.root)[2]))
        found[bias] = float(belief.mean[2]), sd
    assert found[-0.5][0] == pytest.approx(-0.5, abs=3 * found[-0.5][1])
    assert found[-0.5][1] < 0.1 < found[0.0][1]  # known to a tenth of its prior, and not


def test_the_triangular_factor_holds_where_a_covariance_would_not():
    """Rows of nearly the same direction: forming A A^T would lose 1e-9 squared."""
    A = jnp.array([[1.0, 0.0, 0.0], [1.0, 1e-9, 0.0]])
    L = np.asarray(triangular(A))
    assert L[0, 1] == 0
    assert L[1, 1] == pytest.approx(1e-9, rel=1e-6)  # the second row's part off the first


def test_an_overflow_keeps_the_last_belief():
    lane = mass_filter()
    belief = Belief(jnp.array([0.0, 0.0, 0.0]), jnp.eye(3))
    u = jnp.array([0.0])
    after, likelihood, _ = step(lane, belief, u, u, jnp.array([1e200]), jnp.asarray(0.1))
    assert np.all(np.isfinite(np.asarray(after.mean)))
    assert np.isfinite(float(likelihood))
