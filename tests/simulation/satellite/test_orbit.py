"""The orbit against Kepler's third law, numerical derivatives and the closed form of the shadow."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from faultgauge.simulation.satellite.orbit import Orbit

TIMES = np.linspace(0, 6000, 25)


def axes(orbit, times):
    """Columns: the frame's x, y and z in inertial axes."""
    q = jax.vmap(orbit.frame)(jnp.asarray(times))
    return Rotation.from_quat(np.asarray(q), scalar_first=True).as_matrix()


def places(orbit, times):
    return np.asarray(jax.vmap(orbit.position)(jnp.asarray(times)))


@pytest.mark.parametrize(
    ("altitude", "period"),
    [
        # r = 6918.137 km: r^3 = 3.3110594e20 m^3, over mu 830671.2 s^2, root 911.4116 s, * 2 pi
        (540e3, 5726.57),
        # the geostationary orbit, r = 42164.17 km: one sidereal day
        (35_786.03e3, 86_164.1),
    ],
)
def test_period_by_keplers_third_law(altitude, period):
    orbit = Orbit(altitude=altitude)
    # the last digit of the altitude is 10 m: 1.5 * 10 / 42e6 of the period, 0.03 s of a day
    assert 2 * np.pi / float(orbit.rate) == pytest.approx(period, abs=0.05)


def test_the_satellite_comes_back_after_a_period():
    orbit = Orbit(start=0.7)
    period = 2 * np.pi / float(orbit.rate)
    there, back = places(orbit, [0.0, period])
    np.testing.assert_allclose(there, [np.cos(0.7), np.sin(0.7), 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(back, there, rtol=0, atol=1e-14)  # rounding of 2 pi


def test_frame_points_down_and_forward():
    orbit = Orbit(start=0.7)
    x, y, z = np.moveaxis(axes(orbit, TIMES), 2, 0)
    np.testing.assert_allclose(z, -places(orbit, TIMES), rtol=0, atol=1e-14)  # rounding, as below
    np.testing.assert_allclose(y, np.tile([0.0, 0.0, -1.0], (len(TIMES), 1)), rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.cross(x, y), z, rtol=0, atol=1e-14)
    half = 10.0  # s; the chord of 2 n half = 0.02 rad points along the tangent at its middle
    forward = places(orbit, TIMES + half) - places(orbit, TIMES - half)
    forward /= np.linalg.norm(forward, axis=1)[:, None]
    np.testing.assert_allclose(x, forward, rtol=0, atol=1e-13)  # rounding over 0.02


def test_frame_rate_is_the_derivative_of_the_frame():
    orbit = Orbit(start=-2.0)
    dt = 10.0
    now, later = (Rotation.from_matrix(axes(orbit, TIMES + s)) for s in (0.0, dt))
    found = (now.inv() * later).as_rotvec() / dt  # exact: the rate is constant
    expected = np.tile(orbit.frame_rate, (len(TIMES), 1))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)  # rounding of 1 rad over 10 s


def test_sun_stands_beta_above_the_plane():
    orbit = Orbit(sun_elevation=0.3, sun_azimuth=2.0)
    sun = np.asarray(orbit.sun)
    assert np.linalg.norm(sun) == pytest.approx(1.0, abs=1e-15)
    assert np.arcsin(sun[2]) == pytest.approx(0.3, abs=1e-15)
    assert np.arctan2(sun[1], sun[0]) == pytest.approx(2.0, abs=1e-15)


@pytest.mark.parametrize("beta", [0.0, 30.0, -50.0, 66.0, 67.0, 68.0, -68.0, 85.0])
def test_eclipse_is_the_closed_form_of_the_cylinder(beta):
    """Share of the orbit in shadow: acos(sqrt(r^2 - R^2) / (r cos(beta))) / pi; none beyond
    asin(R/r) = 67.2 degrees."""
    orbit = Orbit(sun_elevation=float(np.deg2rad(beta)), sun_azimuth=2.5)
    radius, earth = 6918.137, 6378.137
    cosine = np.sqrt(radius**2 - earth**2) / (radius * np.cos(np.deg2rad(beta)))
    share = np.arccos(cosine) / np.pi if cosine < 1 else 0.0
    assert (share == 0) == (abs(beta) > 67.3)
    count = 20_000
    argument = 2 * np.pi * np.arange(count) / count
    dark = ~np.asarray(jax.vmap(orbit.sunlit)(jnp.asarray(argument) / orbit.rate))
    assert dark.mean() == pytest.approx(share, abs=2 / count)  # a sample at either end
    if share:
        middle = np.angle(np.exp(1j * argument[dark]).sum())
        # opposite to the Sun, to half a sample at either end
        assert np.angle(np.exp(1j * (middle - 2.5 - np.pi))) == pytest.approx(0, abs=2e-4)
