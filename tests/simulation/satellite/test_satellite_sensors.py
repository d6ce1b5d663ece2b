"""Sensors against their geometry: what they see, when they see it, and how noisy it is."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from faultgauge.simulation.satellite.loop import NOISES, fly, start
from faultgauge.simulation.satellite.sensors import EarthSensor, Gyro, SunSensors

ROUNDING = 1e-14
FACES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, -1]], float)


COUNT = 4000
SUNS = SunSensors()
see_sun = jax.jit(jax.vmap(SUNS.measure, (0, None, 0)))
QUIET = jnp.zeros((COUNT, 2))


def directions():
    v = np.random.default_rng(0).standard_normal((COUNT, 3))
    return v / np.linalg.norm(v, axis=1)[:, None]


def test_earth_sensor_without_noise_is_exact_inside_its_field():
    sensor, true = EarthSensor(), directions()
    found = jax.vmap(lambda v: sensor.measure(v, jnp.zeros(2)))(jnp.asarray(true))
    inside = np.arccos(true[:, 2]) < sensor.field
    assert 100 < inside.sum() < len(true) / 2
    np.testing.assert_array_equal(found.valid, inside)
    np.testing.assert_allclose(found.vector[inside], true[inside], rtol=0, atol=ROUNDING)


def test_sun_sensors_without_noise_are_exact_inside_a_field():
    true = directions()
    seen = see_sun(jnp.asarray(true), jnp.asarray(True), QUIET)
    inside = np.arccos((true @ FACES.T).max(axis=1)) < SUNS.field
    assert 0 < (~inside).sum() < len(true) / 10  # a cone about +z, where there is no head
    assert np.all(true[~inside, 2] > 0)
    np.testing.assert_array_equal(seen.valid, inside)
    np.testing.assert_allclose(seen.vector[inside], true[inside], rtol=0, atol=ROUNDING)


def test_no_sun_in_shadow():
    dark = see_sun(jnp.asarray(directions()), jnp.asarray(False), QUIET)
    assert not np.any(dark.valid)


def test_earth_sensor_reads_roll_and_pitch_with_their_signs():
    """A body that has rolled by +a sees nadir at roll +a, and a noise of one sigma adds to it."""
    sensor = EarthSensor(sigma=0.01)
    noise = jnp.array([1.0, 0.0])
    for axis, which in (("X", noise), ("Y", noise[::-1])):
        nadir = Rotation.from_euler(axis, 0.2).inv().apply([0.0, 0.0, 1.0])
        expected = Rotation.from_euler(axis, 0.21).inv().apply([0.0, 0.0, 1.0])
        found = sensor.measure(jnp.asarray(nadir), which).vector
        np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("face", range(len(FACES)))
def test_sun_noise_is_sigma_on_both_axes_of_a_head(face):
    noise = np.random.default_rng(face).standard_normal((COUNT, 2))
    true = np.tile(FACES[face], (COUNT, 1))
    seen = see_sun(jnp.asarray(true), jnp.asarray(True), jnp.asarray(noise))
    errors = np.asarray(seen.vector) - FACES[face]
    spread = errors[:, FACES[face] == 0].std(axis=0) / SUNS.sigma
    # a standard deviation of 4000 numbers is known to 1/sqrt(8000) = 1.1 %: four of these
    np.testing.assert_allclose(spread, 1, rtol=0, atol=0.045)


def test_gyro_counts_whole_pulses():
    gyro = Gyro(quantum=0.125)  # a power of two: its multiples are exact
    angle = np.random.default_rng(1).uniform(-3, 3, (500, 3))
    counted = np.asarray(jax.vmap(gyro.counts)(jnp.asarray(angle)))
    np.testing.assert_array_equal(counted / 0.125, np.round(counted / 0.125))
    left = angle - counted
    assert left.min() >= 0
    assert left.max() < 0.125
    assert left.mean() == pytest.approx(0.0625, abs=0.004)  # 4 * 0.036 / sqrt(1500)


@pytest.fixture(scope="module")
def drifting(ideal_wheel, build, conditions):
    """(satellite, states every 5 s). Its wheels are locked and no torque acts, so the body turns
    at the orbital rate about -y whatever the gyro says."""
    satellite = build(ideal_wheel("0*u"), substeps=1)
    _, during = conditions(satellite.wheel, 20, substeps=1)
    rng = np.random.default_rng(2)
    states = [start(satellite, jnp.zeros(3), jnp.zeros(3), jnp.zeros(3))]
    for _ in range(200):
        now = during._replace(noise=jnp.asarray(rng.standard_normal((20, NOISES))))
        states.append(fly(satellite, states[-1], now)[0])
    return satellite, jax.tree.map(lambda *a: np.stack(a), *states)


def test_gyro_drifts_as_its_random_walks_say(drifting):
    """In 5 s the bias walks rrw sqrt(5), and the angle arw sqrt(5) beyond rate and bias."""
    satellite, states = drifting
    gyro, seconds = satellite.gyro, 20 * satellite.dt
    np.testing.assert_array_equal(states.bias[0], gyro.bias)
    walked = np.diff(states.bias, axis=0)
    turned = np.array([0.0, -float(satellite.orbit.rate), 0.0]) * seconds
    # rrw 5 s sqrt(5 s / 3) = 6e-9 rad of the bias's own walk is 0.3 % of arw sqrt(5 s)
    angle = np.diff(states.angle, axis=0) - turned - states.bias[:-1] * seconds
    # 600 numbers: 1/sqrt(1200) = 2.9 %, four of these
    assert walked.std() == pytest.approx(gyro.rrw * np.sqrt(seconds), rel=0.115)
    assert angle.std() == pytest.approx(gyro.arw * np.sqrt(seconds), rel=0.115)
    assert abs(angle.mean()) < 4 * gyro.arw * np.sqrt(seconds / 600)


def test_gyro_reads_in_whole_pulses_in_flight(drifting):
    satellite, states = drifting
    pulses = states.counted / satellite.gyro.quantum
    np.testing.assert_allclose(pulses, np.round(pulses), rtol=0, atol=1e-9)  # 2e6 of them, 1e-16
    assert np.abs(pulses).max() > 1e6
