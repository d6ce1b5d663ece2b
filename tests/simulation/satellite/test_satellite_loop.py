"""The step is pure: a run may be stopped, resumed and batched, and comes out the same."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from faultgauge.simulation.satellite.loop import NOISES, fly, start

MOMENTA = jnp.array([20.0, 40.0, -20.0])


@pytest.fixture(scope="module")
def flight(build, conditions, parts, large_wheel, happening):
    """(satellite, what happens in 20 s, its two halves): noise, and all faults 1 to 5 s long."""
    noise = np.random.default_rng(0).standard_normal((320, NOISES))
    wheel, long = conditions(large_wheel, 320, schedules=happening, faulty=1, noise=noise)
    during = jax.tree.map(lambda a: a[::4], long)  # what takes 80 s there takes 20 s here
    satellite = build(wheel, disturbance=jnp.array([[2e-3, 1e-3, -4e-3], [1e-3, 4e-3, 2e-3]]))
    return satellite, during, parts(during)


@pytest.fixture(scope="module")
def whole(flight):
    satellite, during, _ = flight
    return fly(satellite, begins(satellite, 64.0), during)


def begins(satellite, pitch):
    angles = jnp.deg2rad(jnp.array([3.0, pitch, -2.0]))
    return start(satellite, angles, MOMENTA, jnp.deg2rad(jnp.array([0.2, -0.3, 0.2])))


def test_two_halves_are_the_whole_to_the_bit(flight, whole):
    """With the checkpoint between them out to NumPy and back."""
    satellite, _, (early, late) = flight
    middle, first = fly(satellite, begins(satellite, 64.0), early)
    stored = jax.tree.map(np.array, middle)
    last, second = fly(satellite, jax.tree.map(jnp.asarray, stored), late)
    end, samples = whole
    for a, b in zip(jax.tree.leaves(end), jax.tree.leaves(last), strict=True):
        np.testing.assert_array_equal(a, b)
    for a, b, c in zip(samples, first, second, strict=True):
        np.testing.assert_array_equal(a, np.concatenate([b, c]))


def test_a_step_leaves_its_arguments_alone(flight):
    """Flown twice from one state, the result is the same to the bit."""
    satellite, _, (early, _) = flight
    begin = begins(satellite, 64.0)
    kept = jax.tree.map(np.array, (begin, early))
    once, again = fly(satellite, begin, early), fly(satellite, begin, early)
    for a, b in zip(jax.tree.leaves(once), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)
    for a, b in zip(jax.tree.leaves(kept), jax.tree.leaves((begin, early)), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_batch_is_its_single_runs(flight):
    """Starts and noises differ. Rounding (1e-16) is fed back through a stable loop: attitude to
    1e-14 rad, torque to 28 N*m/rad of that and 500 N*m*s/rad of its rate over 0.25 s. What could
    make more of it, a gyro pulse of 5e-7 rad on its edge, has one chance in 1e7."""
    satellite, _, (early, _) = flight
    pitches = [64.0, -10.0, 0.5]
    steps = len(early.noise)
    noises = jnp.asarray(np.random.default_rng(1).standard_normal((3, steps, NOISES)))
    starts = jax.tree.map(lambda *a: jnp.stack(a), *(begins(satellite, p) for p in pitches))
    batch = jax.vmap(lambda s, n: fly(satellite, s, early._replace(noise=n)))(starts, noises)
    for k, pitch in enumerate(pitches):
        alone = fly(satellite, begins(satellite, pitch), early._replace(noise=noises[k]))
        for a, b in zip(jax.tree.leaves(batch), jax.tree.leaves(alone), strict=True):
            difference = np.asarray(a[k], float) - np.asarray(b, float)
            assert np.abs(difference).max() < 1e-9


def test_telemetry_belongs_to_its_sample(whole):
    """Time from 0 in control periods; attitude and momentum as started; the torque is d(h)/dt
    until the output is stuck."""
    _, flown = whole
    np.testing.assert_array_equal(flown.t, 0.25 * np.arange(80))
    np.testing.assert_allclose(np.rad2deg(flown.attitude[0]), [3, 64, -2], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(flown.momentum[0], MOMENTA)
    np.testing.assert_array_equal(flown.torque[:70], flown.rate[:70])
    np.testing.assert_array_equal(flown.torque[60:, 1], 0.1)  # d(h)/dt is stuck, then the output
    np.testing.assert_array_equal(flown.torque[:, [0, 2]], flown.rate[:, [0, 2]])
    assert np.abs(flown.rate[70:, 1] - 0.1).min() > 0.05
    assert np.abs(flown.u).max() == 0.82


def test_the_estimate_is_near_the_truth_where_both_sensors_see(flight):
    """At half a degree of pitch the Earth and the Sun are in sight from the first sample on."""
    satellite, _, (early, _) = flight
    _, flown = fly(satellite, begins(satellite, 0.5), early)
    apart = np.abs(flown.estimated - flown.attitude)
    assert apart.max() < 4 * satellite.earth.sigma  # of the worse of both sensors
    assert apart[-4:].max() < satellite.earth.sigma  # 40 samples: 4/sqrt(40) of it
