"""Odd, zero at zero, positive, monotone: with any weights, and never at the price of the rest."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from faultgauge.plants.network import Network
from faultgauge.plants.shape import FREE, Shape

HIDDEN = 6
SEEDS = st.integers(0, 2**32 - 1)
SIZES = st.sampled_from([1e-3, 1.0, 30.0])  # weights: nearly linear, ordinary, saturated
MONOTONE = ("increasing", "decreasing")


def network(shape, seed, size=1.0, arity=2):
    """Random weights over a random training range, with the scalings that the shape asks for."""
    rng = np.random.default_rng(seed)
    net = Network.zeros(HIDDEN, arity, shape)
    low, high = np.sort(rng.normal(scale=3, size=(2, arity)), axis=0)
    center, scale = shape.scalings(low, high)
    weights = {
        name: jnp.asarray(size * rng.normal(size=getattr(net, name).shape))
        for name in ("weights_out", "weights_in", "bias", "bias_out")
    }
    return replace(
        net,
        **weights,
        input_center=jnp.asarray(center),
        input_scale=jnp.asarray(scale),
        output_scale=jnp.asarray(2.5),
    )


def points(seed, arity=2):
    return np.random.default_rng([seed, 1]).normal(scale=4, size=(40, arity))


@eqx.filter_jit
def values(net, points):
    return jax.vmap(lambda point: net(*point))(points)


def magnitude(net):
    """No value is larger: |W1|_1 + |theta_out|, scaled."""
    outer = jnp.abs(net.weights_out)
    outer = outer**2 if net.shape.monotone else outer
    return float(net.output_scale * (jnp.sum(outer) * 2 + jnp.abs(net.bias_out) + 1))


@settings(max_examples=60, deadline=None)
@given(SEEDS, SIZES, st.sampled_from([None, *MONOTONE]))
def test_odd(seed, size, monotone):
    net = network(Shape(odd=True, monotone=monotone), seed, size)
    p = jnp.asarray(points(seed))
    np.testing.assert_allclose(
        values(net, -p), -values(net, p), rtol=0, atol=1e-15 * magnitude(net)
    )
    assert float(net(0.0, 0.0)) == 0.0


@settings(max_examples=60, deadline=None)
@given(SEEDS, SIZES, st.sampled_from([None, *MONOTONE]))
def test_zero_at_zero(seed, size, monotone):
    net = network(Shape(zero_at_zero=True, monotone=monotone), seed, size)
    assert float(net(0.0, 0.0)) == 0.0
    assert np.all(np.asarray(values(net, jnp.zeros((40, 2)))) == 0.0)


@settings(max_examples=60, deadline=None)
@given(SEEDS, SIZES, st.sampled_from([None, *MONOTONE]))
def test_positive(seed, size, monotone):
    net = network(Shape(positive=True, monotone=monotone), seed, size)
    assert np.all(np.asarray(values(net, jnp.asarray(points(seed)))) > 0)


@settings(max_examples=100, deadline=None)
@given(
    SEEDS,
    SIZES,
    st.sampled_from(["", "odd", "zero_at_zero", "positive"]),
    st.sampled_from(MONOTONE),
)
def test_monotone_in_every_argument(seed, size, other, direction):
    flags = {other: True} if other else {}
    net = network(Shape(monotone=direction, **flags), seed, size)
    p = points(seed)
    further = p + np.abs(points(seed + 1))  # no argument less than before
    change = np.asarray(values(net, jnp.asarray(further)) - values(net, jnp.asarray(p)))
    up = change if direction == "increasing" else -change
    assert np.all(up >= -1e-15 * magnitude(net))  # rounding of the sums
    if size <= 1:  # large weights may leave every tanh flat to the last bit
        assert np.any(up > 0)


@pytest.mark.parametrize(
    "shape",
    [
        Shape(odd=True),
        Shape(zero_at_zero=True),
        Shape(positive=True),
        Shape(monotone="increasing"),
        Shape(monotone="decreasing", positive=True),
    ],
)
def test_shapes_are_what_the_docstring_says(shape):
    """Each shape rebuilt from free networks and NumPy."""
    net = network(shape, 3)
    plain = replace(net, shape=FREE, output_scale=jnp.ones(()))
    if shape.monotone:
        sign = 1 if shape.monotone == "increasing" else -1
        outer, inner = sign * net.weights_out**2, net.weights_in**2
        plain = replace(plain, weights_out=outer, weights_in=inner)
    p = points(3)
    expected = np.asarray(values(plain, jnp.asarray(p)))
    if shape.odd:
        expected = (expected - np.asarray(values(plain, jnp.asarray(-p)))) / 2
    if shape.zero_at_zero:
        expected = expected - float(plain(0.0, 0.0))
    if shape.positive:
        expected = np.log1p(np.exp(expected)) + 1e-12
    found = values(net, jnp.asarray(p))
    np.testing.assert_allclose(found, 2.5 * expected, rtol=0, atol=1e-13)  # rounding of ~10 terms


@pytest.mark.parametrize("monotone", [None, *MONOTONE])
@pytest.mark.parametrize("other", ["", "odd", "zero_at_zero", "positive"])
def test_gradients_are_finite_and_agree_with_differences(other, monotone):
    flags = {other: True} if other else {}
    net = network(Shape(monotone=monotone, **flags), 5)
    point = (0.1, -0.2)

    def value(weights):
        return replace(net, weights_in=weights)(*point)

    weights, h = net.weights_in, 1e-6
    found = jax.grad(value)(weights)
    bumps = (h * jnp.zeros_like(weights).at[i, j].set(1.0) for i, j in np.ndindex(weights.shape))
    wanted = [(value(weights + d) - value(weights - d)) / (2 * h) for d in bumps]
    # central differences: h^2 and rounding over h, both below 1e-8 for values of order 10
    np.testing.assert_allclose(found.ravel(), jnp.stack(wanted), rtol=0, atol=1e-7)


def test_a_batch_of_networks_is_evaluated_as_one():
    nets = [network(Shape(odd=True, monotone="increasing"), seed) for seed in (1, 2)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *nets)
    found = jax.vmap(lambda net: net(0.3, -0.4))(stacked)
    expected = [float(net(0.3, -0.4)) for net in nets]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)  # order of the sums


@pytest.mark.parametrize("monotone", [None, *MONOTONE])
@pytest.mark.parametrize("flags", [(), ("odd",), ("zero_at_zero",), ("odd", "zero_at_zero")])
def test_an_untrained_network_is_zero(flags, monotone):
    net = Network.zeros(3, 2, Shape(monotone=monotone, **dict.fromkeys(flags, True)))
    assert float(net(0.3, -7.0)) == 0.0


@pytest.mark.parametrize("monotone", [None, *MONOTONE])
def test_an_untrained_positive_network_is_a_constant(monotone):
    net = Network.zeros(3, 2, Shape(positive=True, monotone=monotone))
    assert float(net(0.3, -7.0)) == pytest.approx(np.log(2), abs=2e-12)  # LEAST is added
    assert float(net(0.3, -7.0)) == float(net(-2.0, 5.0))


def test_scalings():
    low, high = np.array([-1.0, 2.0, -5.0]), np.array([3.0, 4.0, -1.0])
    for shape, center, scale in [
        (FREE, [1, 3, -3], [2, 1, 2]),
        (Shape(odd=True), [0, 0, 0], [3, 4, 5]),
        (Shape(zero_at_zero=True), [1, 2, -2.5], [2, 2, 2.5]),
        (Shape(odd=True, zero_at_zero=True), [0, 0, 0], [3, 4, 5]),
        (Shape(positive=True, monotone="decreasing"), [1, 3, -3], [2, 1, 2]),
    ]:
        found = shape.scalings(low, high)
        np.testing.assert_array_equal(found[0], center)
        np.testing.assert_array_equal(found[1], scale)
