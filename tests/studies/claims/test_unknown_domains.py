"""Errors outside the training range against eq (3) in NumPy and errors made by hand."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.excitation import design
from faultgauge.plants.gray_box import load_plant
from faultgauge_studies.paper.claims import unknown_domains
from faultgauge_studies.paper.claims.learned import rates, sized
from faultgauge_studies.paper.claims.unknown_domains_errors import (
    errors,
    outside,
    slope,
    sweep_to,
    unbounded,
)


def drawn(hidden):
    """The gray-box wheel with drawn weights and a training range of -80 to 100, -0.8 to 0.8."""
    rng = np.random.default_rng(1)
    plant = sized(hidden)
    values = {
        "weights_out": rng.normal(size=hidden),
        "weights_in": rng.normal(size=(hidden, 2)),
        "bias": rng.normal(size=hidden),
        "bias_out": np.asarray(0.3),
        "input_center": np.array([10.0, 0.0]),
        "input_scale": np.array([90.0, 0.8]),
        "output_scale": np.asarray(0.7),
    }
    network = eqx.tree_at(
        lambda n: [getattr(n, name) for name in values],
        plant.networks["NN1"],
        [jnp.asarray(value) for value in values.values()],
    )
    plant = eqx.tree_at(lambda p: p.networks["NN1"], plant, network)
    return plant, values


def test_without_edges_the_network_is_eq_3_everywhere():
    plant, w = drawn(4)
    h, u = np.array([-70.0, 95.0, 180.0, -250.0]), np.array([0.5, -0.7, 0.2, -0.8])
    p = (np.stack([h, u], axis=1) - w["input_center"]) / w["input_scale"]
    eq_3 = np.tanh(p @ w["weights_in"].T + w["bias"]) @ w["weights_out"] + w["bias_out"]
    found = rates(unbounded(plant), h, u)
    np.testing.assert_allclose(found, 0.7 * eq_3, rtol=1e-12)  # roundings
    kept = rates(plant, h, u)
    np.testing.assert_allclose(kept[:2], found[:2], rtol=1e-12)  # the same inside
    edges = rates(plant, np.array([100.0, -80.0]), u[2:])
    np.testing.assert_allclose(kept[2:], edges, rtol=1e-12)
    assert abs(kept[2:] - found[2:]).min() > 1e-3


def test_outside_by_hand():
    h = np.array([-90.0, -80.0, 0.0, 100.0, 130.0])
    np.testing.assert_array_equal(outside(h, -80.0, 100.0), [10.0, 0.0, 0.0, 0.0, 30.0])


def test_slope_through_the_origin_as_scipy_has_it():
    x, y = np.array([1.0, 2.0, 5.0]), np.array([0.9, 2.2, 4.7])
    assert slope(x, y) == pytest.approx(np.linalg.lstsq(x[:, None], y, rcond=None)[0][0], rel=1e-12)


def test_an_error_that_grows_evenly_is_reported_as_such():
    """1e-4 inside, 3e-4 N*m per N*m*s outside +-100: 0.01 N*m is passed after 33 N*m*s."""
    h = np.linspace(-250.0, 250.0, 50001)
    away = outside(h, -100.0, 100.0)
    found = errors(np.where(away > 0, -3e-4 * away, 1e-4), h, away)
    assert found["inside_rms"] == pytest.approx(1e-4, rel=1e-12)
    assert found["inside_largest"] == pytest.approx(1e-4, rel=1e-12)
    # rms of a line over a bin of 10 exceeds its middle by 100/24/50^2, and at the first by more
    assert found["outside_50"] == pytest.approx(0.015, rel=2e-3)
    assert found["growth"] == pytest.approx(3e-4, rel=1e-12)
    assert found["good_to"] == 30.0  # the first bin whose rms is beyond: 30 to 40
    far = -3e-4 * away[np.abs(h) > 211]
    assert found["beyond_limit"] == pytest.approx(np.sqrt(np.mean(far**2)), rel=1e-12)
    assert errors(np.full(len(h), 0.009), h, away)["good_to"] == np.inf


def test_the_sweep_goes_where_it_is_sent():
    signals = load_plant("reaction_wheel").signals
    reference = design(sweep_to(80.0, 1000.0), signals, 0).reference
    assert (reference.max(), reference.min()) == (80.0, -80.0)
    assert reference.shape == (1000, 2)


def results(inside, eq_3, edge, beyond):
    def each(away):
        entry = {
            "inside_rms": inside,
            "outside_50": away,
            "beyond_limit": beyond,
            "growth": 3e-4,
            "free_run_outside": away,
        }
        entry = {name: {"median": x, "min": x, "max": x} for name, x in entry.items()}
        return {str(a): entry for a in (40, 80, 120, 150)}

    found = {"gbnnm": each(edge), "unbounded": each(eq_3), "parametric": each(1e-5)}
    return {"unknown_domains": found}


def test_the_verdict_follows_the_numbers():
    assert unknown_domains.verdict(results(1e-4, 1e-3, 2e-2, 5e-3)).holds
    assert unknown_domains.verdict(results(1e-4, 2e-2, 1e-3, 5e-3)).holds  # either is enough
    limit = unknown_domains.verdict(results(1e-4, 1e-3, 2e-2, 5e-2))
    assert not limit.holds
    assert "Not so 50 N·m·s outside with the edge value; beyond 211 N·m·s." in limit.found
    assert not unknown_domains.verdict(results(1e-4, 2e-2, 2e-2, 5e-3)).holds
    nowhere = unknown_domains.verdict(results(2e-2, 2e-2, 2e-2, 2e-2))
    assert not nowhere.holds
    assert nowhere.found.startswith("Accurate nowhere.")
    diverged = unknown_domains.verdict(results(1e-4, None, None, 5e-3))
    assert not diverged.holds


def test_the_edge_values_price_follows_the_numbers():
    assert "costs nothing here" in unknown_domains.edge_or_not(results(1e-4, 2e-2, 1e-2, 0.1))
    worse = unknown_domains.edge_or_not(results(1e-4, 1e-3, 2e-2, 0.1))
    assert "has 20 times the error of eq (3)" in worse
    assert "in the worst seed the edge value does worse" in worse
