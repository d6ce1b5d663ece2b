"""The interacting modes: hand arithmetic, equal bits, numerical health."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.observers.follow import follow
from faultgauge.observers.interacting import (
    FLOOR,
    OUTLIER,
    InteractingModes,
    cholesky,
    posterior,
)
from faultgauge.observers.modes import Levels, hypotheses, links, mode_sets
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.plants.signals import Fault
from faultgauge.simulation.closed_loop import with_faults

LAG = """
name = "lag"
[states.x]
derivative = "-0.1*x + u"
[inputs.u]
min = -2
max = 2
[outputs.x]
value = "x"
[faults.push]
enters = "input"
target = "u"
[faults.bias]
enters = "output"
target = "x"
"""
LEVELS = Levels(
    sigma=np.array([0.1]),
    process=np.array([0.01]),
    drift=np.zeros(0),
    drifted=np.zeros(0),
    walk=np.array([1e-4, 1e-4, 1e-4]),
    agile=np.array([0.05, 0.05, 0.05]),
    size=np.array([0.5, 1.0, 0.3]),
    onset=np.array([1e-6, 2e-6]),
    jump=np.array([1.0]),
    hides=np.array([[[0.0], [0.2]], [[0.0], [0.0]]]),  # of a push, a bias of the sensor takes 0.2
    loose=np.array([0.1]),
    noisier=np.array([0.1]),
    unknown=np.array([1e-7, 1e-7, 1e-7]),
    recovery=1e-4,
    settling=0.1,
)
SETS = mode_sets(range(2), 2)
MODES = len(SETS) + 3


def bank():
    plant = GrayBoxPlant.untrained(parse_plant(LAG))
    plant = with_faults(plant, (*plant.signals.faults, Fault("d_x", "state", "x")))
    return InteractingModes(
        plant=plant,
        hypothesis=hypotheses(SETS, LEVELS),
        links=links(SETS, 1, LEVELS),
        probes=jnp.array([[-0.5, 0.5], [-1.0, 1.0]]),
        memory=jnp.array(50.0),
        enough=jnp.array(20.0),
        drifting=(),
        substeps=1,
    )


def first(modes, u=0.0):
    p = jnp.full(MODES, 1e-4).at[0].set(1 - 1e-4 * (MODES - 1))
    zero = jnp.zeros(1)
    return modes.init(zero, zero + 0.1, jnp.zeros(0), zero + u, p)


def record(samples, onset=None, size=0.0, u=0.0):
    """(u, y, dt) of the lag with a bias of its output."""
    rng = np.random.default_rng(3)
    y = 10 * u * (1 - np.exp(-0.1 * np.arange(samples))) + 0.1 * rng.standard_normal(samples)
    if onset is not None:
        y[onset:] += size
    dt = np.ones(samples)
    dt[0] = 0.0
    return np.full((samples, 1), u), y[:, None], dt


def run(modes, state, arrays):
    return jax.device_get(follow(modes, state, arrays))


def test_bayes_rule_by_hand_with_its_floor_and_its_outliers():
    prior = jnp.array([0.5, 0.3, 0.2, 0.0])
    found = np.asarray(posterior(prior, jnp.log(jnp.array([1.0, 2.0, 1e-9, 1.0]))))
    wanted = np.array([0.5, 0.6, 0.0, 0.0]) / 2 * (1 - OUTLIER)  # relative to the best mode, 2
    wanted = wanted + OUTLIER * np.array([0.5, 0.3, 0.2, 0.0])
    wanted[3] = FLOOR * wanted.sum()
    np.testing.assert_allclose(found, wanted / wanted.sum(), rtol=1e-5)  # 0.1e-9 left out of 2e-5
    assert found.sum() == pytest.approx(1.0, abs=1e-15)


def test_the_sets_are_healthy_singles_pairs_and_agile_singles():
    assert SETS == ((), (0,), (1,), (0, 1), (0,), (1,))
    assert mode_sets(range(3), 1) == ((), (0,), (1,), (2,), (0,), (1,), (2,))


def test_rates_leave_as_often_as_they_arrive():
    """Every change of mode is counted once on both sides, so probabilities stay a distribution."""
    found = links(SETS, 1, LEVELS)
    source, rate, leaving = (np.asarray(a) for a in (found.source, found.rate, found.leaving))
    left = np.zeros(MODES)
    np.add.at(left, source[:, 1:].ravel(), rate[:, 1:].ravel())
    np.testing.assert_allclose(left, leaving, rtol=1e-12)


def test_a_fault_that_begins_enters_with_its_prior_and_one_that_stays_is_kept():
    modes = bank()
    state = first(modes)
    pair, single = SETS.index((0, 1)), SETS.index((0,))
    belief = state.belief._replace(mean=state.belief.mean.at[single, 1].set(0.7))
    p = jnp.zeros(MODES).at[single].set(1.0)
    _, mixed = eqx.filter_jit(modes.mix)(p, belief, jnp.asarray(1.0))
    mean, root = np.asarray(mixed.mean[pair]), np.asarray(mixed.root[pair])
    P = root @ root.T
    # slot 0 holds `push` as it was, slot 1 `bias` with mean 0 and its prior of 1
    np.testing.assert_allclose(mean, [0.0, 0.7, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.diagonal(P), [0.01, 0.25, 1.0], rtol=1e-9)


def test_what_a_push_did_unnoticed_may_have_gone_into_the_bias_of_the_sensor():
    """The state and the bias may have moved by 0.2 against each other; what is measured has not."""
    modes = bank()
    state = first(modes)
    pair, single = SETS.index((0, 1)), SETS.index((1,))
    root = state.belief.root.at[single].set(jnp.diag(jnp.array([0.1, 0.3, 1.0])))
    p = jnp.zeros(MODES).at[single].set(1.0)
    _, mixed = eqx.filter_jit(modes.mix)(p, state.belief._replace(root=root), jnp.asarray(1.0))
    P = np.asarray(mixed.root[pair] @ mixed.root[pair].T)
    wanted = np.diag([0.01, 0.25, 0.09]) + 0.04 * np.array([[1, 0, -1], [0, 0, 0], [-1, 0, 1]])
    np.testing.assert_allclose(P, wanted, rtol=1e-9, atol=1e-15)
    measured = np.array([1.0, 0.0, 1.0])
    assert measured @ P @ measured == pytest.approx(0.01 + 0.09, rel=1e-9)


def test_the_root_of_a_covariance_is_numpys_and_survives_a_singular_one():
    A = np.random.default_rng(0).standard_normal((4, 4))
    np.testing.assert_allclose(
        np.asarray(cholesky(jnp.asarray(A @ A.T))), np.linalg.cholesky(A @ A.T), rtol=1e-10
    )
    assert np.all(np.isfinite(np.asarray(cholesky(jnp.ones((3, 3))))))


def test_a_sample_at_a_time_and_a_whole_block_give_the_same_bits():
    modes = bank()
    arrays = record(40, onset=20, size=1.0)
    state, whole = run(modes, first(modes), arrays)
    now, rows = first(modes), []
    for k in range(40):
        now, info = follow(modes, now, [a[k : k + 1] for a in arrays])
        rows.append(info)
    for name in whole._fields:
        one = np.concatenate([np.asarray(getattr(row, name)) for row in rows])
        assert np.array_equal(one, getattr(whole, name)), name
    assert all(map(np.array_equal, jax.tree.leaves(jax.device_get(now)), jax.tree.leaves(state)))


def test_a_bias_is_found_as_one_fault_and_its_size_is_right():
    modes = bank()
    _, info = run(modes, first(modes), record(200, onset=100, size=1.0))
    assert info.p[99, 0] > 0.99
    held = [m for m, each in enumerate(SETS) if each == (1,)]
    assert info.p[-1, held].sum() > 0.95
    # 100 samples of 0.1 around a level that 100 samples have told: 0.1 sqrt(2 / 100)
    assert info.f[-1, SETS.index((1,)), 0] == pytest.approx(1.0, abs=4 * 0.1 * np.sqrt(2 / 100))


def test_what_an_actuator_at_its_limit_hides_is_not_seen_and_the_rest_is():
    modes = bank()
    _, info = run(modes, first(modes, 2.0), record(100, u=2.0))
    seen = info.seen[-1]
    assert seen[0, 1] == 0.0  # upwards, beyond the limit
    assert seen[0, 0] >= 1.0
    assert seen[1].min() >= 1.0


def test_nothing_breaks_on_outliers_gaps_and_a_jump_beyond_all_bounds():
    modes = bank()
    u, y, dt = record(120)
    y[30], y[50:60], y[80:, 0], dt[60] = 1e9, np.nan, 1e150, 300.0
    _, info = run(modes, first(modes), (u, y, dt))
    assert all(np.all(np.isfinite(each)) for each in info)
    np.testing.assert_allclose(info.p.sum(axis=1), 1.0, atol=1e-12)
    assert info.p.min() >= FLOOR / 2  # floored before it is normalised
