"""Sensors against their geometry, and the attitude filter against its own covariance."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Stuck
from faultgauge.plants.plant_file import parse_plant
from faultgauge.simulation.satellite.loop import NOISES, Now, fly, start
from faultgauge.simulation.satellite.sensors import EarthSensor, Gyro, SunSensors
from faultgauge.studies.paper.satellite import HOLD, paper_satellite, paper_start

DT, SUBSTEPS, SEEDS = 0.25, 5, 100
WHEEL = GrayBoxPlant.untrained(
    parse_plant(
        """name = "frictionless wheel"
[states.h]
derivative = "u"
[inputs.u]
[outputs.T]
value = "d(h)"
[outputs.hm]
value = "h"
"""
    )
)


def directions(count=500, seed=0):
    v = np.random.default_rng(seed).normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def healthy(noise):
    free = np.full((len(noise), SUBSTEPS, 3, 1), np.nan)
    stuck = Stuck(free, free, np.concatenate([free, free], axis=-1))
    f = jnp.zeros((len(noise), SUBSTEPS, 3, 0))
    return Now(jnp.asarray(noise), f, jax.tree.map(jnp.asarray, stuck))


def fly_seeds(satellite, begin, seconds):
    """(final states, last telemetry), one row per seed."""
    steps = round(seconds / DT)
    quiet = healthy(np.zeros((steps, NOISES)))

    def one(noise):
        state, telemetry = fly(satellite, begin, quiet._replace(noise=noise))
        return state, jax.tree.map(lambda a: a[-1], telemetry)

    noise = np.random.default_rng(7).standard_normal((SEEDS, steps, NOISES))
    return jax.device_get(jax.vmap(one)(jnp.asarray(noise)))


@pytest.fixture(scope="module")
def flown():
    """100 satellites that hold for 500 s, all with the same wrong first estimate."""
    satellite = paper_satellite(WHEEL)
    return fly_seeds(satellite, paper_start(satellite, HOLD), 500.0)


@pytest.fixture(scope="module")
def drifting():
    """100 satellites without any torque for 100 s: they turn at the orbital rate for ever."""
    satellite = paper_satellite(WHEEL)
    satellite = eqx.tree_at(
        lambda s: (s.allocation, s.disturbance),
        satellite,
        (jnp.zeros((3, 3)), jnp.zeros((2, 3))),
    )
    zero = jnp.zeros(3)
    return satellite, *fly_seeds(satellite, start(satellite, zero, zero, zero), 100.0)


def test_the_earth_sensor_sees_nadir_within_its_field():
    sensor, nadir = EarthSensor(), directions()
    measured = jax.vmap(lambda v: sensor.measure(v, jnp.zeros(2)))(jnp.asarray(nadir))
    inside = np.arccos(nadir[:, 2]) < 0.6
    assert inside.any()
    assert not inside.all()
    np.testing.assert_array_equal(measured.valid, inside)
    np.testing.assert_allclose(measured.vector[inside], nadir[inside], atol=1e-14)  # rounding


def test_the_sun_sensors_see_the_sun_but_near_plus_z_and_in_shadow():
    sensor, sun = SunSensors(), directions()
    look = jax.vmap(sensor.measure, in_axes=(0, None, None))
    measured = look(jnp.asarray(sun), jnp.asarray(True), jnp.zeros(2))
    to_x, to_y = np.arccos(np.abs(sun[:, 0])), np.arccos(np.abs(sun[:, 1]))
    inside = np.minimum(np.minimum(to_x, to_y), np.arccos(-sun[:, 2])) < 1.1
    assert not inside.all()
    assert inside.mean() > 0.9, "only a cone about +z is blind"
    np.testing.assert_array_equal(measured.valid, inside)
    np.testing.assert_allclose(measured.vector[inside], sun[inside], atol=1e-14)  # rounding
    assert not look(jnp.asarray(sun), jnp.asarray(False), jnp.zeros(2)).valid.any()


@pytest.mark.parametrize("boresight", [[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])
def test_the_noise_of_a_sun_head_on_its_axis(boresight):
    noise = np.random.default_rng(2).standard_normal((5000, 2))
    axis = jnp.array(boresight)
    look = jax.vmap(lambda n: SunSensors().measure(axis, jnp.asarray(True), n).vector)
    across = np.asarray(look(jnp.asarray(noise)))[:, np.array(boresight) == 0]
    # 5000 samples: 1 % of sigma, times 4
    np.testing.assert_allclose(across.std(axis=0), 3e-4, rtol=0.04)
    assert abs(np.corrcoef(across.T)[0, 1]) < 4 / np.sqrt(5000)


def test_the_noise_of_the_earth_sensor_is_in_roll_and_pitch():
    """Roll rocks nadir along +y, pitch along -x."""
    look = EarthSensor(sigma=1e-3).measure
    x, y, _ = look(jnp.array([0.0, 0.0, 1.0]), jnp.array([1.0, 2.0])).vector
    np.testing.assert_allclose([x, y], [-2e-3, 1e-3], rtol=1e-5)  # tan and norm: sigma^2


def test_the_gyro_counts_whole_pulses():
    gyro = Gyro(quantum=5e-7)
    angle = np.linspace(-1e-5, 1e-5, 999, endpoint=False)[:, None] * np.ones(3)
    counted = np.asarray(jax.vmap(gyro.counts)(jnp.asarray(angle)))
    pulses = counted / 5e-7
    np.testing.assert_allclose(pulses, np.round(pulses), atol=1e-12)  # rounding of 20 pulses
    assert ((angle - counted >= -1e-20) & (angle - counted < 5e-7)).all()
    assert len(np.unique(np.round(pulses))) == 40  # 2e-5/5e-7


def test_gyro_random_walks(drifting):
    """Over T: arw sqrt(T) of the angle beside bias T, and rrw sqrt(T) of the bias."""
    satellite, state, _ = drifting
    seconds, gyro = 100.0, satellite.gyro
    bias = np.array(gyro.bias)
    turned = np.array([0.0, -float(satellite.orbit.rate), 0.0]) * seconds
    walked = state.angle - turned - bias * seconds
    # 300 values: their spread is known to 1/sqrt(600) = 4 %, times 4; the bias walk adds 0.2 %
    assert walked.std() == pytest.approx(1e-6 * 10, rel=0.16)
    assert abs(walked.mean()) < 4 * 1e-5 / np.sqrt(300)
    assert (state.bias - bias).std() == pytest.approx(1e-9 * 10, rel=0.16)


@pytest.mark.parametrize(
    ("degrees", "left", "bias_left"),
    [
        # nearly linear: what is left of the start is (sigma at the end / sigma at first)^2
        ((0.2, -0.3, 0.2), 1e-6, 1e-8),
        # 0.2 rad wrong: second-order terms of 0.02 rad pass for bias and fade with it, so a
        # tenth of one earth measurement, and a tenth of the bias
        ((5.0, -8.0, 6.0), 5e-5, 5e-7),
    ],
)
def test_filter_converges_from_a_wrong_start_without_noise(degrees, left, bias_left):
    # counting by 3e-12 rad is no noise
    satellite = replace(paper_satellite(WHEEL), gyro=Gyro(quantum=3e-12))
    momenta = jnp.array([20.0, 40.0, -20.0])
    begin = start(satellite, jnp.zeros(3), momenta, jnp.deg2rad(jnp.array(degrees)))
    state, telemetry = fly(satellite, begin, healthy(np.zeros((2000, NOISES))))
    error = np.asarray(telemetry.estimated - telemetry.attitude)
    np.testing.assert_allclose(error[-1], 0.0, atol=left)
    np.testing.assert_allclose(state.estimate.bias, state.bias, atol=bias_left)


def test_filter_errors_are_as_large_as_it_says(flown):
    """Normalised estimation error squared, over 100 seeds: chi-square with 6 each."""
    state, last = flown
    # near zero the angles' difference is the rotation vector; the bias moves 5e-10 within a step
    error = np.concatenate(
        [last.attitude - last.estimated, state.bias - state.estimate.bias], axis=1
    )
    nees = np.einsum("si,sij,sj->s", error, np.linalg.inv(state.estimate.covariance), error)
    low, high = chi2.ppf([0.001, 0.999], 6 * SEEDS) / SEEDS
    assert low < nees.mean() < high


def test_filter_covariance_stays_a_covariance(flown):
    covariance = flown[0].estimate.covariance
    np.testing.assert_allclose(
        covariance, covariance.transpose(0, 2, 1), rtol=1e-6, atol=1e-22
    )  # rounding, and nothing of a 1e-14 variance
    assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_gyro_bias_is_recovered(flown):
    state, _ = flown
    sigma = np.sqrt(np.diagonal(state.estimate.covariance, axis1=1, axis2=2))[:, 3:]
    assert (sigma < 5e-7).all(), "a tenth of the bias itself, and less"
    error = state.estimate.bias - state.bias
    assert (np.abs(error.mean(axis=0)) < 4 * sigma.mean(axis=0) / np.sqrt(SEEDS)).all()
