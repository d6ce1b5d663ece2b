"""Many units in one call: each is told what it is told alone."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.observers.eso import ExtendedStateObserver
from faultgauge.observers.many import begin_many, observe_many
from faultgauge.observers.observer import observe
from faultgauge.plants.gray_box import load_plant

UNITS, SAMPLES = 11, 6


@pytest.fixture(scope="module")
def observer():
    """IESONN: an ESO over the wheel with two networks, whose weights are drawn."""
    rng = np.random.default_rng(0)
    wheel = jax.tree.map(
        lambda a: a + 0.3 * rng.standard_normal(a.shape) if eqx.is_array(a) and a.ndim else a,
        load_plant("reaction_wheel_network"),
    )
    gain_x, gain_f = jnp.array([[0.1, 0.3]]), jnp.array([0.0, 0.05])
    return ExtendedStateObserver(wheel, 0, 1, gain_x, gain_f, 0.5, jnp.asarray(0.1))


@pytest.fixture(scope="module")
def samples():
    """(u, y, dt); a sensor is silent now and then."""
    rng = np.random.default_rng(1)
    u, y = rng.uniform(-0.8, 0.8, (SAMPLES, 1, UNITS)), rng.normal(size=(SAMPLES, 2, UNITS))
    y[2, 0, 3] = y[4, 1, 7] = np.nan
    return u, y, np.array([0.0, 0.25, 0.25, 0.5, 0.25, 0.25])


@pytest.fixture(scope="module")
def told(observer, samples):
    u, y, dt = samples
    begin = begin_many(observer, np.zeros((1, UNITS)), u[0])
    return observe_many(observer, begin, u, y, dt, ("f", "x", "innovation"), together=4)


def test_each_unit_is_what_the_observer_tells_of_it(observer, samples, told):
    """Sums of ten numbers of size 1 in another order, six times."""
    u, y, dt = samples
    for k in range(UNITS):
        own, seen = jnp.asarray(u[..., k]), jnp.asarray(y[..., k])
        alone = observe(observer, jnp.zeros(1), own, seen, jnp.asarray(dt))
        for name, found in told[1].items():
            expected = np.asarray(getattr(alone, name))
            np.testing.assert_allclose(found[..., k], expected, rtol=1e-11, atol=1e-13)


def test_no_bit_hangs_on_who_is_beside(observer, samples, told):
    u, y, dt = samples
    for together, units in ((4, slice(3, 4)), (8, slice(0, 11)), (4, slice(5, 10))):
        own = u[..., units], y[..., units]
        begin = begin_many(observer, np.zeros((1, own[0].shape[-1])), own[0][0])
        after, found = observe_many(
            observer, begin, *own, dt, ("f", "x", "innovation"), together=together
        )
        for name, values in found.items():
            np.testing.assert_array_equal(values, told[1][name][..., units])
        np.testing.assert_array_equal(after.f, told[0].f[units])


def test_in_two_calls_it_is_the_same(observer, samples, told):
    u, y, dt = samples
    state = begin_many(observer, np.zeros((1, UNITS)), u[0])
    state, _ = observe_many(observer, state, u[:4], y[:4], dt[:4], together=4)
    state, found = observe_many(observer, state, u[4:], y[4:], dt[4:], together=4)
    np.testing.assert_array_equal(found["f"], told[1]["f"][4:])
    np.testing.assert_array_equal(state.x, told[0].x)
