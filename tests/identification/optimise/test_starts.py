"""Starts: Nguyen-Widrow's geometry and scattered parameters."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.identification.optimise.starts import Box, nguyen_widrow, scattered, spread_over
from faultgauge.plants.network import Network
from faultgauge.plants.shape import Shape


@pytest.mark.parametrize(("hidden", "arity"), [(10, 1), (10, 2), (7, 3)])
def test_weights_have_nguyen_widrows_length(hidden, arity):
    start = nguyen_widrow(hidden, arity, np.random.default_rng(0))
    assert start["weights_in"].shape == (hidden, arity)
    length = 0.7 * hidden ** (1 / arity)
    # a quotient and a root: rounding
    np.testing.assert_allclose(np.linalg.norm(start["weights_in"], axis=1), length, rtol=1e-14)
    assert np.all(np.abs(start["bias"]) <= length * (1 + 1e-15))
    assert np.all(np.abs(start["weights_out"]) <= 0.5)
    assert start["bias_out"].shape == ()
    assert start["bias_out"] == 0


def test_units_of_one_argument_cover_the_interval_evenly():
    """tanh(w p + b) is active around p = -b / w: from -1 to 1 in equal steps."""
    start = nguyen_widrow(9, 1, np.random.default_rng(1))
    centres = np.sort(-start["bias"] / start["weights_in"][:, 0])
    np.testing.assert_allclose(centres, np.linspace(-1, 1, 9), rtol=0, atol=1e-14)  # rounding


@pytest.mark.parametrize(
    ("shape", "spread"),
    [
        (Shape(), np.linspace(-1, 1, 9)),
        (Shape(monotone="increasing"), np.linspace(-1, 1, 9)),
        (Shape(odd=True), (np.arange(9) + 0.5) / 9),
    ],
)
def test_units_cover_a_crowd(shape, spread):
    """Arguments from -10 to 30, most of them from 3 to 5 (an odd function: from -4 to 4)."""
    network = Network.zeros(9, 1, shape)
    network = eqx.tree_at(
        lambda n: (n.input_center, n.input_scale), network, (jnp.array([10.0]), jnp.array([20.0]))
    )
    center, half = (10.0, 4.0) if shape.odd else (4.0, 1.0)
    crowd = Box(np.array([center]), np.array([half]))
    start = spread_over(network, np.random.default_rng(1), crowd)
    weights, usual = start["weights_in"][:, 0], spread_over(network, np.random.default_rng(1))
    acting = weights**2 if shape.monotone else weights
    places = 10.0 + 20.0 * -start["bias"] / acting
    sign = np.sign(places - center) if shape.odd else 1.0
    np.testing.assert_allclose(
        np.sort(sign * (places - center)),
        half * spread,
        atol=1e-12,  # rounding
    )
    before = usual["weights_in"][:, 0] ** (2 if shape.monotone else 1)
    np.testing.assert_allclose(acting / before, 20.0 / half, rtol=1e-12)
    np.testing.assert_array_equal(start["weights_out"], usual["weights_out"])


def test_one_unit_is_centred():
    start = nguyen_widrow(1, 2, np.random.default_rng(2))
    assert start["bias"].tolist() == [0.0]


@pytest.mark.parametrize("direction", ["increasing", "decreasing"])
def test_weights_of_a_monotone_network_are_roots(direction):
    """The weights that act, squares, have Nguyen-Widrow's length and range."""
    start = nguyen_widrow(10, 2, np.random.default_rng(0), Shape(monotone=direction))
    length = 0.7 * 10**0.5
    acting = np.linalg.norm(start["weights_in"] ** 2, axis=1)
    np.testing.assert_allclose(acting, length, rtol=1e-14)  # rounding
    assert np.all(start["weights_out"] ** 2 <= 0.5)
    centres = np.sort(-start["bias"])  # bias over a positive direction: evenly both ways
    np.testing.assert_allclose(centres, length * np.linspace(-1, 1, 10), atol=1e-14)


@pytest.mark.parametrize("monotone", [None, "increasing"])
def test_units_of_an_odd_network_and_their_mirror_images_cover_the_interval_evenly(monotone):
    start = nguyen_widrow(4, 1, np.random.default_rng(1), Shape(odd=True, monotone=monotone))
    weights = start["weights_in"][:, 0]
    centres = start["bias"] / (weights**2 if monotone else weights)
    # four units in the middles of the quarters of [0, 1]
    np.testing.assert_allclose(centres, [0.125, 0.375, 0.625, 0.875], rtol=1e-14)


def test_a_positive_network_starts_around_its_scale():
    start = nguyen_widrow(5, 2, np.random.default_rng(2), Shape(positive=True))
    assert math.log(1 + math.exp(start["bias_out"])) == pytest.approx(1, rel=1e-15)


def test_shapes_that_change_no_weight_start_as_a_free_network():
    free = nguyen_widrow(5, 2, np.random.default_rng(3))
    same = nguyen_widrow(5, 2, np.random.default_rng(3), Shape(zero_at_zero=True))
    for name, value in free.items():
        np.testing.assert_array_equal(value, same[name])


def test_generators_decide():
    first, same, other = (nguyen_widrow(5, 2, np.random.default_rng(s)) for s in (3, 3, 4))
    for name, value in first.items():
        np.testing.assert_array_equal(value, same[name])
    assert not np.array_equal(first["weights_in"], other["weights_in"])


@pytest.mark.parametrize("value", [5.0, -0.02])
def test_scattered_stays_within_a_factor_of_three(value):
    rng = np.random.default_rng(5)
    ratios = [scattered(value, -math.inf, math.inf, rng) / value for _ in range(1000)]
    assert 1 / 3 <= min(ratios) < 0.4
    assert 2.7 < max(ratios) <= 3
    assert np.median(ratios) == pytest.approx(1, abs=0.1)  # as often up as down; sd 0.05


def test_scattered_keeps_to_its_bounds():
    rng = np.random.default_rng(6)
    starts = [float(scattered(1.0, 0.8, 1.1, rng)) for _ in range(200)]
    assert (min(starts), max(starts)) == (0.8, 1.1)


def test_scattered_around_zero_takes_both_signs():
    rng = np.random.default_rng(7)
    starts = [float(scattered(0.0, -math.inf, math.inf, rng)) for _ in range(200)]
    assert -1 <= min(starts) < -0.9
    assert 0.9 < max(starts) <= 1
