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


def directions(count=4000):
    v = np.random.default_rng(0).standard_normal((count, 3))
    return v / np.linalg.norm(v, axis=1)[:, None]


def test_earth_sensor_without_noise_is_exact_inside_its_field():
    sensor, true = EarthSensor(), directions()
    found = jax.vmap(lambda v: sensor.measure(v, jnp.zeros(2)))(jnp.asarray(true))
    inside = np.arccos(true[:, 2]) < sensor.field
    assert 100 < inside.sum() < len(true) / 2
    np.testing.assert_array_equal(found.valid, inside)
    np.testing.assert_allclose(found.vector[inside], true[inside], rtol=0, atol=ROUNDING)


def test_sun_sensors_without_noise_are_exact_inside_a_field():
    sensors, true = SunSensors(), directions()
    seen = jax.vmap(lambda v: sensors.measure(v, jnp.asarray(True), jnp.zeros(2)))(
        jnp.asarray(true)
    )
    inside = np.arccos((true @ FACES.T).max(axis=1)) < sensors.field
    assert 0 < (~inside).sum() < len(true) / 10  # a cone about +z, where there is no head
    assert np.all(true[~inside, 2] > 0)
    np.testing.assert_array_equal(seen.valid, inside)
    np.testing.assert_allclose(seen.vector[inside], true[inside], rtol=0, atol=ROUNDING)


def test_no_sun_in_shadow():
    sensors = SunSensors()
    dark = jax.vmap(lambda v: sensors.measure(v, jnp.asarray(False), jnp.zeros(2)))(
        jnp.asarray(directions(100))
    )
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
    sensors, count = SunSensors(), 4000
    noise = np.random.default_rng(face).standard_normal((count, 2))
    true = jnp.asarray(FACES[face])
    seen = jax.vmap(lambda n: sensors.measure(true, jnp.asarray(True), n))(jnp.asarray(noise))
    errors = np.asarray(seen.vector) - FACES[face]
    spread = errors[:, FACES[face] == 0].std(axis=0) / sensors.sigma
    # a standard deviation of 4000 numbers is known to 1/sqrt(8000) = 1.1 %: four of these
    np.testing.assert_allclose(spread, 1, rtol=0, atol=0.045)


def test_gyro_counts_whole_pulses():
    gyro = Gyro(quantum=0.125)  # a power of two: its multiples are exact
    angle = np.random.default_rng(1).uniform(-3, 3, (500, 3))
    counted = np.asarray(gyro.counts(jnp.asarray(angle)))
    np.testing.assert_array_equal(counted / 0.125, np.round(counted / 0.125))
    left = angle - counted
    assert left.min() >= 0
    assert left.max() < 0.125
    assert left.mean() == pytest.approx(0.0625, abs=0.004)  # 4 * 0.036 / sqrt(1500)


@pytest.fixture(scope="module")
def drifting(ideal_wheel, build, conditions):
    """(seconds, last states of 300 gyros, the rate): locked wheels and no torque, so the body
    turns at the orbital rate about -y whatever the gyro says."""
    satellite = build(ideal_wheel("0*u"), gyro=Gyro(arw=1e-5, rrw=1e-6))
    steps = 80
    wheel, quiet = conditions(satellite.wheel, steps)
    noises = np.random.default_rng(2).standard_normal((300, steps, NOISES))
    begin = start(satellite, jnp.zeros(3), jnp.zeros(3), jnp.zeros(3))
    last = jax.vmap(lambda n: fly(satellite, begin, quiet._replace(noise=n))[0])(
        jnp.asarray(noises)
    )
    assert wheel.signals == satellite.wheel.signals
    return steps * satellite.dt, last, satellite


def test_gyro_drifts_as_its_random_walks_say(drifting):
    """After t: the bias has walked rrw sqrt(t), the angle arw sqrt(t) and rrw sqrt(t^3/3)."""
    seconds, last, satellite = drifting
    gyro = satellite.gyro
    turned = np.array([0.0, -float(satellite.orbit.rate), 0.0]) * seconds
    bias = np.asarray(last.bias) - gyro.bias
    angle = np.asarray(last.angle) - turned - np.array(gyro.bias) * seconds
    expected = np.sqrt(gyro.arw**2 * seconds + gyro.rrw**2 * seconds**3 / 3)
    # 900 numbers: 1/sqrt(1800) = 2.4 %, four of these; the walk in steps adds 1.5/80 of a part
    assert bias.std() == pytest.approx(gyro.rrw * np.sqrt(seconds), rel=0.095)
    assert angle.std() == pytest.approx(expected, rel=0.1)
    assert abs(angle.mean()) < 4 * expected / np.sqrt(900)


def test_gyro_error_is_less_than_a_pulse(drifting):
    _, last, satellite = drifting
    left = np.asarray(last.counted)  # of the last sample's angle, one period before the state's
    pulses = left / satellite.gyro.quantum
    np.testing.assert_allclose(pulses, np.round(pulses), rtol=0, atol=1e-9)  # 4e4 pulses, rounding
