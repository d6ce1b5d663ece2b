"""The ablation of separate networks against eq (3) in NumPy and arithmetic."""

import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.identification.equation.groups import groups
from faultgauge.plants.gray_box import load_plant
from faultgauge.telemetry import Run
from faultgauge_studies.paper.claims import separate_networks
from faultgauge_studies.paper.claims.learned import rates, replay, sized
from faultgauge_studies.paper.claims.one_network import OneNetwork, teach_one
from faultgauge_studies.paper.excited import Records


@pytest.fixture(scope="module")
def signals():
    return load_plant("reaction_wheel_network").signals


def test_one_network_is_eq_3_with_two_outputs(signals):
    rng = np.random.default_rng(0)
    inward, bias = rng.normal(size=(3, 2)), rng.normal(size=3)
    outward, last = rng.normal(size=(2, 3)), rng.normal(size=2)
    center, half, scale = np.array([10.0, 0.1]), np.array([50.0, 0.8]), np.array([0.5, 2.0])
    theta = np.concatenate([inward.ravel(), bias, outward.ravel(), last])
    plant = OneNetwork(signals, *map(jnp.asarray, (center, half, scale, theta)))
    for p in (np.array([30.0, -0.3]), np.array([300.0, 0.5])):  # the second is beyond the edge
        inside = np.clip((p - center) / half, -1, 1)
        by_hand = scale * (outward @ np.tanh(inward @ inside + bias) + last)
        x, u = jnp.asarray(p[:1]), jnp.asarray(p[1:])
        dx = plant.derivative(x, u)
        np.testing.assert_allclose(dx, by_hand[:1], rtol=1e-13)  # roundings
        np.testing.assert_allclose(plant.output(dx, x, u), [by_hand[1], p[0]], rtol=1e-13)


def made_up(seed):
    """A wheel with one bent friction, y = 2 dh, sampled each second; both are 2 units' work."""
    rng = np.random.default_rng(seed)
    u, h = rng.uniform(-0.8, 0.8, 200), [0.0]
    for command in u[:-1]:
        h.append(h[-1] + command - 0.3 * np.tanh(h[-1]))
    h = np.array(h)
    rate = u - 0.3 * np.tanh(h)
    columns = {"u": u, "hm": h, "d_h": rate, "T": 2 * rate}
    return Run(f"made up {seed}", "made up", np.arange(200.0), columns)


def test_one_network_learns_what_it_can_express(signals):
    """Two units: one nearly linear in u, one bent as friction is."""
    given = Records(made_up(0), made_up(1))
    plant, solution = teach_one(signals, 2, given, 0, 3)
    assert solution.theta.shape == (3, 12)
    h, u = given.validation.columns["hm"], given.validation.columns["u"]
    # A tanh bent over 2 % of its range for u leaves about z^3/3; the signal is of order 0.5.
    truth = u - 0.3 * np.tanh(h)
    np.testing.assert_allclose(rates(plant, h, u), truth, rtol=0, atol=5e-3)
    found = replay(plant, given.validation)
    np.testing.assert_allclose(found.y[:, 0], 2 * found.dx[:, 0], rtol=0, atol=1e-2)
    np.testing.assert_array_equal(found.y[:, 1], found.x[:, 0])


def test_joint_networks_are_one_problem_and_separate_ones_are_two():
    apart = groups(sized(5).spec, ["T", "hm"])
    assert [(g.networks, len(g.states) + len(g.outputs)) for g in apart] == [
        (("NN1",), 1),
        (("NN2",), 1),
    ]
    (together,) = groups(separate_networks.joint(5).spec, ["T", "hm"])
    assert (together.networks, together.states, together.outputs) == (("NN1", "NN2"), (0,), (0,))


def test_work_by_hand():
    """100 samples: 21^2 * 100 * (30 + 20) for two networks; 42^2 * 2 * 100 * 10 for one problem."""
    assert separate_networks.work([(21, 1, 30), (21, 1, 20)], 100) == 441 * 5000
    assert separate_networks.work([(42, 2, 10)], 100) == 1764 * 2000


def case(work, error):
    def each(values):
        return [{"median": x, "min": x, "max": x} for x in values]

    return {"work": each(work), "model_error": each(error)}


def results(joint, shared):
    own = case([1.0, 10.0], [1e-4, 1e-4])
    found = {"hidden": [4, 10], "separate": own, "joint": joint, "shared": shared}
    return {"separate_networks": found}


def test_the_verdict_follows_the_numbers():
    good = case([2.0, 30.0], [1e-4, 2e-4])
    whole = separate_networks.verdict(results(good, good))
    assert whole.holds
    assert whole.found.count("the claim holds: ") == 2
    assert "2 to 3 times less work, and their error is 0.5 to 1 times" in whole.found
    worse = case([2.0, 30.0], [1e-4, 0.5e-4])  # at 10 units the other is twice as accurate
    part = separate_networks.verdict(results(good, worse))
    assert not part.holds
    assert "holds only with 4 units" in part.found
    dear = case([1.0, 10.0], [1e-4, 1e-4])
    none = separate_networks.verdict(results(dear, good))
    assert not none.holds
    assert "does not hold: " in none.found
