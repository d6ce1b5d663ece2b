"""The network against equations 3 and 4, written out in NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.plants.network import Network


def written_out(net, points):
    """NN at points (samples, arguments), term by term as the equations have it."""
    values = []
    for point in points:
        scaled = (point - np.asarray(net.input_center)) / np.asarray(net.input_scale)
        scaled = np.minimum(np.maximum(scaled, -1), 1)
        total = float(net.bias_out)
        for w1, w2, theta in zip(net.weights_out, net.weights_in, net.bias, strict=True):
            z = sum(float(w) * s for w, s in zip(w2, scaled, strict=True)) + float(theta)
            total += float(w1) * (2 / (1 + np.exp(-2 * z)) - 1)
        values.append(float(net.output_center) + float(net.output_scale) * total)
    return np.array(values)


def random_network(hidden, arity):
    rng = np.random.default_rng(1)
    draw = {
        name: jnp.asarray(rng.normal(size=getattr(Network.zeros(hidden, arity), name).shape))
        for name in ("weights_out", "weights_in", "bias", "bias_out", "input_center")
    }
    return Network(
        **draw,
        input_scale=jnp.asarray(rng.uniform(0.5, 3.0, arity)),
        output_center=jnp.asarray(-4.0),
        output_scale=jnp.asarray(2.5),
    )


@pytest.mark.parametrize(("hidden", "arity"), [(1, 1), (10, 2), (7, 3)])
def test_a_batch_of_points_follows_equations_3_and_4(hidden, arity):
    net = random_network(hidden, arity)
    points = np.random.default_rng(2).normal(scale=3, size=(50, arity))  # in and out of range
    found = jax.vmap(lambda point: net(*point))(jnp.asarray(points))
    # A sum of some ten terms of order one: rounding of float64 with room to spare.
    np.testing.assert_allclose(found, written_out(net, points), rtol=0, atol=1e-13)


def test_a_batch_of_networks_is_evaluated_as_one():
    nets = [random_network(4, 2), Network.zeros(4, 2)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *nets)
    point = np.array([0.25, -0.5])
    found = jax.vmap(lambda net: net(*jnp.asarray(point)))(stacked)
    expected = [written_out(net, [point])[0] for net in nets]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)  # rounding, as above


def test_beyond_the_training_range_the_value_is_that_of_the_edge():
    net = random_network(5, 1)
    edge = net.input_center[0] + net.input_scale[0]
    # (edge - center) / scale may miss 1 by a rounding.
    np.testing.assert_allclose(net(edge + 10), net(edge), rtol=0, atol=1e-14)


def test_an_untrained_network_is_zero_and_takes_plain_numbers():
    assert float(Network.zeros(3, 2)(jnp.asarray(2.0), -1.0)) == 0.0
