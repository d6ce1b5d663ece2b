"""The adaptive observer against its laws written out in a loop, gradient by hand."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge_studies.baselines.adaptive_observer import (
    Gains,
    adaptive_observer,
    learn_online,
)
from faultgauge_studies.baselines.baseline import Record, Scaling, one_step

DT, HIDDEN = 0.1, 4
T = DT * np.arange(300)
SCALING = Scaling(jnp.array([0.1]), jnp.array([1.5]), jnp.array([0.3, 0.2]), jnp.array([0.8, 2.5]))


def observer(*gains, seed=1, scaling=SCALING):
    return adaptive_observer(scaling, HIDDEN, Gains(*gains), DT, np.random.default_rng(seed))


def without_network(model):
    zeros = {name: jnp.zeros_like(value) for name, value in model.weights.items()}
    return eqx.tree_at(lambda m: m.weights, model, zeros)


def numbers(model):
    return {name: np.asarray(value) for name, value in model.weights.items()}


def network(w, x, u, s=SCALING):
    """NN in units of the rate, and its gradient by the chain rule."""
    p = np.array([(x - s.y_center[1]) / s.y_scale[1], (u - s.u_center[0]) / s.u_scale[0]])
    a = np.tanh(w["weights_in"] @ p + w["bias"])
    size = float(s.y_scale[0])
    inner = w["weights_out"] * (1 - a**2)
    slope = {
        "weights_out": size * a,
        "weights_in": size * inner[:, None] * p,
        "bias": size * inner,
        "bias_out": np.asarray(size),
    }
    return size * (w["weights_out"] @ a + w["bias_out"]), slope


def plant(rate, x0=0.0):
    """Euler steps of x' = rate(x, u) under a slow sine, from rest."""
    u, x, found = np.sin(0.7 * T), x0, []
    for now in u:
        found.append((rate(x, now), x))
        x = x + DT * rate(x, now)
    return Record(u[:, None], np.array(found))


@eqx.filter_jit
def aligned(model, u, y):
    """Estimates at samples 1, 2, ..: each step reads the state of the sample before."""
    u, y = model.scaling.u(u), model.scaling.y(y)
    start = model.begin(u[0], y[0])
    carry, found = jax.lax.scan(lambda c, s: model.step(c, *s), start, (u[1:], y[:-1]))
    return model.scaling.back(found), carry


def unrolled(weights):
    """One vector, by the order of the names, as a tree is unrolled."""
    return np.concatenate([np.asarray(weights[name]).ravel() for name in sorted(weights)])


def test_without_learning_it_is_a_linear_observer():
    record = plant(lambda x, u: u - 0.5 * x)
    model = without_network(observer(2.0, 0.0, 0.0))
    u, x = record.u[:, 0], record.y[:, 1]
    found, xhat = [], x[0]
    for k, now in enumerate(u):
        before = max(k - 1, 0)
        xhat = xhat + DT * (u[before] + 2.0 * (x[before] - xhat))
        found.append((now, xhat))
    # 300 steps of a contraction (1 - l dt = 0.8): a few roundings
    np.testing.assert_allclose(one_step(model, record), found, rtol=0, atol=1e-13)


def test_laws_of_state_and_weights():
    record = plant(lambda x, u: u - 0.5 * x - 0.3 * np.tanh(4 * x))
    record = Record(record.u[:25], record.y[:25])
    l, eta, rho = 2.0, 0.7, 0.4  # noqa: E741
    model = observer(l, eta, rho)
    w, u, x = numbers(model), record.u[:, 0], record.y[:, 1]
    xhat, expected = x[0], []
    for k in range(1, len(u)):
        e = x[k - 1] - xhat
        f, slope = network(w, xhat, u[k - 1])
        xhat = xhat + DT * (u[k - 1] + f + l * e)
        w = {n: v + DT * (eta * e * slope[n] - rho * abs(e) * v) for n, v in w.items()}
        expected.append((u[k] + network(w, xhat, u[k])[0], xhat))
    found, carry = aligned(model, *map(jnp.asarray, record))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)  # 24 steps of rounding
    np.testing.assert_allclose(carry.theta, unrolled(w), rtol=0, atol=1e-13)


def test_with_the_right_network_its_error_stays_zero():
    model = observer(2.0, 0.5, 0.1)
    w = numbers(model)
    record = plant(lambda x, u: u + network(w, x, u)[0], x0=0.4)
    found, carry = aligned(model, *map(jnp.asarray, record))
    # the same Euler steps in another code; no error, so nothing is learnt either
    np.testing.assert_allclose(found, record.y[1:], rtol=0, atol=1e-12)
    np.testing.assert_allclose(carry.theta, unrolled(w), rtol=0, atol=1e-12)


def test_modification_shrinks_all_weights_alike():
    """With eta = 0 a step multiplies them by 1 - rho |e| dt."""
    record = plant(lambda x, u: u - 0.5 * x)
    model = observer(2.0, 0.0, 3.0)
    _, carry = aligned(model, *map(jnp.asarray, record))
    start = unrolled(model.weights)
    share = float(np.linalg.norm(carry.theta) / np.linalg.norm(start))
    assert 0 < share < 0.5
    np.testing.assert_allclose(carry.theta, share * start, rtol=1e-12, atol=0)  # rounding


def rate_error(model, record):
    return float(np.mean((np.asarray(one_step(model, record)) - record.y)[:, 0] ** 2))


def test_learning_online_lowers_the_error():
    """Viscous and Coulomb-like friction that the observer does not know."""
    record = plant(lambda x, u: u - 0.3 * x - 0.2 * np.tanh(3 * x))
    model = observer(3.0, 2.0, 0.01, scaling=Scaling.of(record))
    assert rate_error(learn_online(model, record, 0), record) == rate_error(model, record)
    frozen = lambda m: eqx.tree_at(lambda m: m.gains, m, Gains(3.0, 0.0, 0.0))  # noqa: E731
    before = rate_error(frozen(model), record)
    after = rate_error(frozen(learn_online(model, record, 50)), record)
    line = rate_error(frozen(without_network(model)), record)
    assert after < before / 20  # a start knows nothing: any law that learns does better than this
    assert after < line / 20  # and better than no network


def test_passes_follow_one_another():
    record = plant(lambda x, u: u - 0.3 * x)
    model = observer(3.0, 2.0, 0.01)
    once = learn_online(model, record, 1)
    twice = learn_online(once, record, 1)
    for name, value in learn_online(model, record, 2).weights.items():
        np.testing.assert_allclose(value, twice.weights[name], rtol=1e-12, atol=1e-14)  # rounding
    _, carry = aligned(model, *map(jnp.asarray, record))
    np.testing.assert_allclose(carry.theta, unrolled(once.weights), rtol=1e-12, atol=1e-14)


def test_every_sets_the_step():
    """Half the step on held inputs: the observer of the same plant."""
    record = plant(lambda x, u: u - 0.5 * x)
    model = without_network(observer(2.0, 0.0, 0.0))
    fine = model.every(DT / 2)
    assert (model.dt, fine.dt) == (DT, DT / 2)
    _, carry = aligned(fine, *map(jnp.asarray, record))
    u, x = record.u[:, 0], record.y[:, 1]
    xhat = x[0]
    for k in range(len(u) - 1):
        xhat += DT / 2 * (u[k] + 2.0 * (x[k] - xhat))
    assert float(carry.x) == pytest.approx(xhat, abs=1e-13)  # rounding
