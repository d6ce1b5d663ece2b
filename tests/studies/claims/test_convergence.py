"""The lag of a ramp and the gap of a spoilt model, against closed forms and made-up results."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.plants.gray_box import load_plant
from faultgauge_studies.paper.claims import convergence, same_ability
from faultgauge_studies.paper.claims.convergence import BANDWIDTHS, SLOPE, lag
from faultgauge_studies.paper.claims.same_ability import SIZES, spoilt
from faultgauge_studies.paper.reproduce import over_seeds


def test_the_lag_is_that_of_the_characteristic_polynomial():
    """fhat = f (b1 s + b0)/(s^2 + b1 s + b0) has no b1 on a ramp of the closed form: from
    e(s) = f(s) s (s + b1)/(s^2 + b1 s + b0), f = c/s^2 leaves c b1/b0."""
    for omega in BANDWIDTHS:
        b1, b0 = 2 * 1.01 * omega, omega**2
        assert lag(omega) == pytest.approx(SLOPE * b1 / b0, rel=1e-12)  # rounding
    assert pytest.approx(0.2 / 400, rel=1e-12) == SLOPE


def told(share):
    """Results where a ramp leaves `share` of the closed form."""
    found = {
        "ramp_without_f": {f"{w:g}": {"share_of_lag": share, "eso": -1.0} for w in BANDWIDTHS},
        "ramp": {f"{w:g}": {"iesonn": -0.005} for w in BANDWIDTHS},
        "step": {f"{w:g}": {"iesonn": 3e-4} for w in BANDWIDTHS},
    }
    return convergence.verdict({"convergence": over_seeds([found])})


def test_asymptotic_means_that_nothing_is_left():
    assert told(0.001).holds
    left = told(1.02)
    assert not left.holds
    assert "as the closed form says" in left.found
    assert "as the closed form says" not in told(0.5).found


@pytest.fixture(scope="module")
def wheel():
    plant = load_plant("reaction_wheel_network")
    net = plant.networks["NN1"]
    net = eqx.tree_at(lambda n: n.weights_out, net, jnp.arange(1.0, 11.0))
    return eqx.tree_at(lambda p: p.networks["NN1"], plant, net)


def test_a_bias_is_added_to_the_rate_everywhere(wheel):
    off = spoilt(wheel, "bias", 0.003, np.random.default_rng(0))
    for h, u in ((0.0, 0.0), (40.0, -0.5)):
        x, u = jnp.array([h]), jnp.array([u])
        gap = off.derivative(x, u) - wheel.derivative(x, u)
        np.testing.assert_allclose(gap, 0.003, atol=1e-12)  # rounding


def test_noise_is_in_proportion_to_each_weight(wheel):
    off = spoilt(wheel, "weights", 0.01, np.random.default_rng(3))
    expected = np.arange(1.0, 11.0) * (1 + 0.01 * np.random.default_rng(3).standard_normal(10))
    np.testing.assert_allclose(off.networks["NN1"].weights_out, expected, rtol=1e-14)


def passed(ratio):
    """Results where `ratio` of the model's error reaches the estimate."""
    found = {}
    for kind, sizes in SIZES.items():
        found[kind] = {
            f"{s:g}": {"model_error": s, "iesonn_minus_eso": ratio * s, "rmse": s} for s in sizes
        }
        found[kind]["gap_over_error"] = ratio
    return same_ability.verdict({"same_ability": over_seeds([found])})


def test_ability_is_the_same_if_the_error_does_not_pass():
    assert passed(0.1).holds
    through = passed(1.0)
    assert not through.holds
    assert "up to a model error of 5.0 mN·m" in through.found  # 5 % of 0.1 N·m, one to one
