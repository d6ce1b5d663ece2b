"""Rotations against scipy, and the orbit against Kepler, Newton and the shadow's closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from faultgauge.simulation.satellite.orbit import Orbit
from faultgauge.simulation.satellite.rotations import (
    conjugate,
    cross_matrix,
    from_angles,
    from_vector,
    into_frame,
    normalised,
    product,
    to_angles,
)

ROUNDING = 1e-13  # some hundred roundings of numbers near 1
MU, RADIUS = 3.986004418e14, 6378137.0  # WGS 84


@pytest.fixture(scope="module")
def pairs():
    """100 pairs of random rotations, and vectors."""
    rng = np.random.default_rng(0)
    first, second = (Rotation.from_quat(rng.normal(size=(100, 4))) for _ in range(2))
    return first, second, rng.normal(size=(100, 3))


def wxyz(rotation):
    return jnp.asarray(rotation.as_quat(scalar_first=True))


def same(q, rotation):
    """The same rotations, whatever the signs of their quaternions."""
    dots = np.sum(np.asarray(q) * rotation.as_quat(scalar_first=True), axis=-1)
    np.testing.assert_allclose(np.abs(dots), 1.0, atol=ROUNDING)


def test_product_and_conjugate_compose_rotations(pairs):
    first, second, _ = pairs
    same(jax.vmap(product)(wxyz(first), wxyz(second)), first * second)
    same(jax.vmap(conjugate)(wxyz(first)), first.inv())


def test_into_frame_is_the_inverse_rotation_of_a_vector(pairs):
    rotation, _, v = pairs
    turned = jax.vmap(into_frame)(wxyz(rotation), jnp.asarray(v))
    np.testing.assert_allclose(turned, rotation.inv().apply(v), atol=10 * ROUNDING)  # |v| to 4


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-4, 1.0, 3.0, 7.0])
def test_a_rotation_vector(pairs, size):
    theta = size * pairs[2] / np.linalg.norm(pairs[2], axis=1, keepdims=True)
    q = jax.vmap(from_vector)(jnp.asarray(theta))
    same(q, Rotation.from_rotvec(theta))
    # the vector part alone, so that a small turn cannot hide behind a scalar part of 1
    expected = np.sin(size / 2) * pairs[2] / np.linalg.norm(pairs[2], axis=1, keepdims=True)
    np.testing.assert_allclose(q[:, 1:], expected, rtol=1e-12, atol=1e-300)  # few roundings


def test_angles_are_yaw_then_pitch_then_roll():
    angles = np.random.default_rng(1).uniform([-3, -1.5, -3], [3, 1.5, 3], (100, 3))
    q = jax.vmap(lambda a: from_angles(*a))(jnp.asarray(angles))
    same(q, Rotation.from_euler("ZYX", angles[:, ::-1]))
    # arcsin near 1.5 rad enlarges rounding by 1/cos(1.5) = 14
    np.testing.assert_allclose(jax.vmap(to_angles)(q), angles, atol=14 * ROUNDING)


def test_cross_matrix_and_normalised(pairs):
    v, w = pairs[2], pairs[2][::-1]
    crossed = jax.vmap(lambda v, w: cross_matrix(v) @ w)(jnp.asarray(v), jnp.asarray(w))
    np.testing.assert_allclose(crossed, np.cross(v, w), atol=20 * ROUNDING)  # products to 20
    q = normalised(jnp.array([3.0, 0.0, 4.0, 0.0]))
    np.testing.assert_allclose(q, [0.6, 0, 0.8, 0], atol=ROUNDING)


def test_a_geostationary_orbit_takes_a_sidereal_day():
    period = 2 * np.pi / float(Orbit(altitude=35.786e6).rate)
    assert period == pytest.approx(86164.1, abs=1.5)  # the altitude is given to 0.5 km


def test_period_squared_goes_with_radius_cubed():
    orbits = [Orbit(altitude=altitude) for altitude in (300e3, 540e3, 2000e3, 20200e3)]
    ratio = [(2 * np.pi / float(o.rate)) ** 2 / float(o.radius) ** 3 for o in orbits]
    np.testing.assert_allclose(ratio, 4 * np.pi**2 / MU, rtol=ROUNDING)


def test_position_obeys_gravity():
    orbit, h = Orbit(), 10.0
    t = jnp.array([1000.0 - h, 1000.0, 1000.0 + h])
    before, now, after = float(orbit.radius) * np.asarray(jax.vmap(orbit.position)(t))
    acceleration = (before - 2 * now + after) / h**2
    gravity = -MU * now / np.linalg.norm(now) ** 3
    np.testing.assert_allclose(acceleration, gravity, atol=2e-4)  # (n h)^2/12 = 1e-5 of 8.3 m/s^2


@pytest.mark.parametrize("start", [0.0, 2.0])
def test_the_frame_is_forward_anti_normal_and_nadir(start):
    orbit = Orbit(start=start)
    times = jnp.linspace(0.0, 6000.0, 13)
    frames = Rotation.from_quat(np.asarray(jax.vmap(orbit.frame)(times)), scalar_first=True)
    x, y, z = (frames.as_matrix()[:, :, k] for k in range(3))
    position = np.asarray(jax.vmap(orbit.position)(times))
    velocity = np.asarray(jax.vmap(jax.jacfwd(orbit.position))(times)) / float(orbit.rate)
    np.testing.assert_allclose(np.linalg.norm(position, axis=1), 1.0, atol=ROUNDING)
    np.testing.assert_allclose(z, -position, atol=ROUNDING)
    np.testing.assert_allclose(x, velocity, atol=ROUNDING)
    np.testing.assert_allclose(y, -np.cross(position, velocity), atol=ROUNDING)
    np.testing.assert_allclose(np.cross(x, y), z, atol=ROUNDING)


def test_frame_rate_is_how_fast_the_frame_turns():
    orbit, h = Orbit(start=0.7), 1.0
    for t in (0.0, 1234.0, 5000.0):
        one, other = (
            Rotation.from_quat(np.asarray(orbit.frame(jnp.asarray(at))), scalar_first=True)
            for at in (t - h / 2, t + h / 2)
        )
        rate = (one.inv() * other).as_rotvec() / h  # about a fixed axis: no error of the step
        np.testing.assert_allclose(rate, orbit.frame_rate, atol=1e-12)  # rounding over 1 s


@pytest.mark.parametrize("elevation", [0.0, 0.4, -0.9, 1.1])
def test_time_in_shadow_is_its_closed_form(elevation):
    """Half the angle of a cylinder's shadow is arccos(sqrt(1 - (R/r)^2) / cos beta)."""
    orbit = Orbit(sun_elevation=elevation)
    r, samples = RADIUS + 540e3, 20000
    period = 2 * np.pi * np.sqrt(r**3 / MU)
    times = jnp.arange(samples) * (period / samples)
    dark = ~np.asarray(jax.vmap(orbit.sunlit)(times))
    half = np.arccos(np.sqrt(1 - (RADIUS / r) ** 2) / np.cos(elevation))
    assert dark.mean() == pytest.approx(half / np.pi, abs=1.01 / samples)  # one sample at the ends
    middle = np.asarray(orbit.position(times[dark].mean()))  # azimuth -1.1: the shadow at 2.04
    flat = np.array([np.cos(-1.1), np.sin(-1.1), 0.0])
    np.testing.assert_allclose(middle, -flat, atol=2 * np.pi / samples)  # one sample


def test_no_shadow_when_the_sun_stands_high():
    """Beyond arcsin(R/r) = 1.17 rad the whole orbit is lit; just below it is not."""
    limit = np.arcsin(RADIUS / (RADIUS + 540e3))
    times = jnp.arange(0.0, 6000.0, 1.0)
    assert jax.vmap(Orbit(sun_elevation=limit + 0.01).sunlit)(times).all()
    assert not jax.vmap(Orbit(sun_elevation=limit - 0.01).sunlit)(times).all()


def test_the_sun_is_where_its_angles_say():
    sun = Orbit(sun_elevation=0.3, sun_azimuth=2.0).sun
    expected = Rotation.from_euler("ZY", [2.0, -0.3]).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(sun, expected, atol=ROUNDING)
