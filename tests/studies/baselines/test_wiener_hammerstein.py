"""Wiener-Hammerstein against SciPy's filters, and its linear approximation of known systems."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import lfilter, lfilter_zi

from faultgauge_studies.baselines.baseline import Record, Scaling, free_run, one_step
from faultgauge_studies.baselines.wiener_hammerstein import (
    WienerHammerstein,
    best_linear_approximation,
    wiener_hammerstein,
)

PLAIN = Scaling(jnp.zeros(1), jnp.ones(1), jnp.zeros(1), jnp.ones(1))
# Denominators without their leading 1: poles 0.8 and 0.5; 0.7 +- 0.3j; 0.9
REAL, COMPLEX = np.array([-1.3, 0.4]), np.array([-1.4, 0.58])
B_FIRST = np.array([[0.5, -0.2, 0.1], [0.3, 0.0, -0.1]])
B_LAST = np.array([1.0, 0.4, -0.3])
W = {
    "weights_in": np.array([[1.5, -0.7], [0.4, 2.0], [-1.0, 1.0]]),
    "bias": np.array([0.2, -0.5, 0.1]),
    "weights_out": np.array([0.6, -0.4, 0.9]),
    "bias_out": np.asarray(0.3),
    "line": np.array([0.8, -0.6]),
}


def full(a):
    return np.concatenate([[1.0], a])


def static(z):
    return W["line"] @ z + W["weights_out"] @ np.tanh(W["weights_in"] @ z + W["bias"]) + 0.3


def two_inputs(level, scaling):
    blocks = {"b_first": B_FIRST, "a_first": np.stack([REAL, COMPLEX]), "b": B_LAST, "a": COMPLEX}
    return WienerHammerstein({n: jnp.asarray(v) for n, v in (W | blocks).items()}, scaling, level)


def by_scipy(u, stood):
    """The chain after `stood` has always stood at its inputs."""
    z, rest = [], []
    for b, a, x, x0 in zip(B_FIRST, (REAL, COMPLEX), u.T, stood, strict=True):
        z.append(lfilter(b, full(a), x, zi=lfilter_zi(b, full(a)) * x0)[0])
        rest.append(b.sum() / full(a).sum() * x0)
    w, w0 = np.array([static(now) for now in np.array(z).T]), static(np.array(rest))
    return lfilter(B_LAST, full(COMPLEX), w, zi=lfilter_zi(B_LAST, full(COMPLEX)) * w0)[0]


@pytest.mark.parametrize("level", [(False, False), (True, True), (False, True)])
def test_chain_is_scipys(level):
    """A level has stood at its first value, a command at 0: in their own units, not scaled."""
    scaling = Scaling(jnp.array([0.5, -1.0]), jnp.array([2.0, 4.0]), jnp.ones(1), 3 * jnp.ones(1))
    u = np.random.default_rng(0).uniform(-3, 3, (60, 2))
    centre, scale = np.array([0.5, -1.0]), np.array([2.0, 4.0])
    stood = (np.where(level, u[0], 0.0) - centre) / scale
    expected = 1.0 + 3.0 * by_scipy((u - centre) / scale, stood)
    model, record = two_inputs(level, scaling), Record(u, np.zeros((60, 1)))
    # 60 steps of two stable filters: rounding
    np.testing.assert_allclose(free_run(model, record)[:, 0], expected, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(free_run(model, record), one_step(model, record))


def test_rest_is_constant_from_the_first_sample():
    u = np.tile([0.7, -1.2], (30, 1))
    found = np.asarray(free_run(two_inputs((True, True), PLAIN_TWO), Record(u, np.zeros((30, 1)))))[
        :, 0
    ]
    gains = B_FIRST.sum(axis=1) / np.array([full(REAL).sum(), full(COMPLEX).sum()])
    last = B_LAST.sum() / full(COMPLEX).sum()
    np.testing.assert_allclose(found, last * static(gains * u[0]), rtol=1e-13)  # rounding


PLAIN_TWO = Scaling(jnp.zeros(2), jnp.ones(2), jnp.zeros(1), jnp.ones(1))


@pytest.mark.parametrize("a", [REAL, COMPLEX], ids=["real", "complex"])
@pytest.mark.parametrize("inputs", [1, 3])
def test_linear_system_is_found_exactly(a, inputs):
    """Several inputs, one denominator. Without noise the equation error is already zero."""
    rng = np.random.default_rng(1)
    u, b = rng.normal(size=(300, inputs)), rng.normal(size=(inputs, 3))
    y = sum(lfilter(bi, full(a), x) for bi, x in zip(b, u.T, strict=True))
    found_b, found_a = best_linear_approximation(u, y, 2)
    # least squares of a well-conditioned problem (white inputs): rounding times its condition
    np.testing.assert_allclose(found_b, b, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found_a, a, rtol=0, atol=1e-10)


def test_equation_error_noise_free_arx():
    """The same numbers from the difference equation, written out."""
    u = np.random.default_rng(2).normal(size=100)
    y = np.zeros(100)
    for k in range(100):
        y[k] = 0.5 * u[k] + (0.3 * u[k - 1] + 0.9 * y[k - 1] if k else 0.0)
    b, a = best_linear_approximation(u[:, None], y, 1)
    np.testing.assert_allclose(b, [[0.5, 0.3]], rtol=0, atol=1e-12)  # as above
    np.testing.assert_allclose(a, [-0.9], rtol=0, atol=1e-12)


def test_output_noise_biases_it_less_than_least_squares():
    """What the whitening is for: the equation error is not white under white output noise."""
    ours, plain = [], []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        u = rng.normal(size=2000)
        y = lfilter([1.0, 0.5, 0.0], full(REAL), u) + rng.normal(size=2000)
        ours.append(best_linear_approximation(u[:, None], y, 2)[1] - REAL)
        columns = np.stack([-y[1:-1], -y[:-2], u[2:], u[1:-1], u[:-2]], axis=1)
        plain.append(np.linalg.lstsq(columns, y[2:], rcond=None)[0][:2] - REAL)
    # the noise's share of the output is a few percent; the bias is far above the scatter
    assert np.abs(np.mean(plain, axis=0)).max() > 10 * np.abs(np.mean(ours, axis=0)).max()


@pytest.mark.parametrize("pole", [1.0, 1.02])
def test_poles_outside_are_drawn_in(pole):
    u = np.random.default_rng(3).normal(size=(200, 1))
    y = lfilter([0.1, 0.0], [1.0, -pole], u[:, 0])
    _, a = best_linear_approximation(u, y, 1)
    np.testing.assert_allclose(a, [-0.999], rtol=0, atol=1e-12)  # rounding


def symmetric(samples, inputs, seed):
    """Inputs from -1 to 1 whose scaling is the identity: a run starts at zero."""
    u = np.random.default_rng(seed).uniform(-1, 1, (samples, inputs))
    u[1], u[2] = 1.0, -1.0
    return u


def starts_of(b, a, seed=4, starts=4):
    u = symmetric(150, len(b), seed)
    y = sum(lfilter(bi, full(a), x) for bi, x in zip(b, u.T, strict=True))[:, None]
    record = Record(u, y)
    rngs = [np.random.default_rng(k) for k in range(starts)]
    level = [False] * len(b)
    return wiener_hammerstein(Scaling.of(record), record, 5, len(a), level, rngs), record


SYSTEMS = {
    # zeros 0.6 and -0.4: poles and zeros are split
    "real": (0.7 * np.array([[1.0, -0.2, -0.24]]), REAL),
    "complex poles": (0.7 * np.array([[1.0, -0.2, -0.24]]), COMPLEX),
    "complex zeros": (np.array([[1.0, -1.0, 0.5]]), REAL),
    "two inputs": (np.array([[0.5, -0.2, 0.1], [0.3, 0.2, -0.1]]), REAL),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_starts_without_network_are_the_linear_approximation(name):
    b, a = SYSTEMS[name]
    models, record = starts_of(b, a)
    scaling = models[0].scaling
    np.testing.assert_allclose(scaling.u_center, 0, atol=0)
    scaled = (record.y - np.asarray(scaling.y_center)) / np.asarray(scaling.y_scale)
    u, y = (x - x.mean(axis=0) for x in (record.u, scaled[:, 0]))
    found_b, found_a = best_linear_approximation(u, y, len(a))
    parts = [lfilter(bi, full(found_a), x) for bi, x in zip(found_b, record.u.T, strict=True)]
    expected = np.asarray(scaling.back(jnp.asarray(np.sum(parts, axis=0)[:, None])))
    for model in models:
        weights = model.weights | {"weights_out": jnp.zeros(5)}
        line = eqx.tree_at(lambda m: m.weights, model, weights)
        # roots of a quadratic and back: rounding
        np.testing.assert_allclose(free_run(line, record), expected, rtol=0, atol=1e-10)


def test_starts_split_the_poles_in_turn():
    models, _ = starts_of(*SYSTEMS["real"], starts=5)

    def poles(a):
        found = np.roots(full(np.asarray(a)))
        return [round(p, 6) for p in np.sort(np.real(found)) if abs(p) > 1e-6]

    # the approximation is of the scaled output, whose shift bends it: the poles are compared
    split = [(poles(m.weights["a_first"][0]), poles(m.weights["a"])) for m in models]
    both = split[0][0]
    assert len(both) == 2
    assert split == [
        (both, []),
        (both[:1], both[1:]),
        (both[1:], both[:1]),
        ([], both),
        (both, []),
    ]


def test_a_conjugate_pair_is_not_torn_apart():
    models, _ = starts_of(*SYSTEMS["complex poles"])
    for model in models:
        first = np.asarray(model.weights["a_first"][0])
        last = np.asarray(model.weights["a"])
        assert np.all(first == 0) != np.all(last == 0)


def test_network_of_a_start_is_a_small_bend():
    """|V| sums to at most 0.05 * 0.5 * 5 units: the start is within that of the line."""
    models, record = starts_of(*SYSTEMS["real"])
    for model in models:
        weights = model.weights | {"weights_out": jnp.zeros(5)}
        line = eqx.tree_at(lambda m: m.weights, model, weights)
        gap = np.asarray(free_run(model, record) - free_run(line, record))
        b, a = np.asarray(model.weights["b"]), full(np.asarray(model.weights["a"]))
        impulse = lfilter(b, a, np.eye(1, 2000)[0])
        bound = np.abs(np.asarray(model.weights["weights_out"])).sum() * np.abs(impulse).sum()
        assert 0 < np.abs(gap).max() <= bound * float(model.scaling.y_scale[0])
        assert np.abs(np.asarray(model.weights["weights_out"])).max() <= 0.05 * 0.5
