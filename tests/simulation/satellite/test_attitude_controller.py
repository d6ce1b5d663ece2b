"""The attitude controller against the second-order response that it is designed for."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal
from scipy.spatial.transform import Rotation

from faultgauge.simulation.satellite.controller import AttitudeController
from faultgauge.simulation.satellite.determination import AttitudeEstimate
from faultgauge.simulation.satellite.loop import fly, start
from faultgauge.simulation.satellite.orbit import Orbit
from faultgauge.simulation.satellite.sensors import Gyro

INERTIA = np.array([3000.0, 2800.0, 2500.0])
SMALL = np.array([1e-3, -8e-4, 6e-4])  # rad
MOMENTA = np.array([20.0, 40.0, -20.0])
SECONDS = 60.0


def known(q, rate=(0.0, 0.0, 0.0)):
    return AttitudeEstimate(jnp.asarray(q), jnp.zeros(3), jnp.eye(6), jnp.asarray(rate))


@pytest.fixture(scope="module")
def response(ideal_wheel, build, conditions):
    """{control period: attitude (samples, 3)} after a small step, with spinning ideal wheels.

    So far from the Earth that the orbit frame stands still; without noise, bias or pulses.
    """
    still = {
        "orbit": Orbit(altitude=1e10),
        "gyro": Gyro(bias=(0.0, 0.0, 0.0), quantum=1e-14),
    }
    found = {}
    for dt in (0.25, 0.125):
        satellite = build(ideal_wheel("u"), dt=dt, **still)
        _, quiet = conditions(satellite.wheel, round(SECONDS / dt), dt=dt)
        begin = start(satellite, jnp.asarray(SMALL), jnp.asarray(MOMENTA), jnp.zeros(3))
        found[dt] = np.asarray(fly(satellite, begin, quiet)[1].attitude)
    return found


def test_the_closed_loop_has_a_tenth_of_a_radian_per_second_and_damping_0_9(response):
    """From SMALL to 0 by w^2/(s^2 + 2 zeta w s + w^2), on all three axes at once: the rates'
    gyroscopic coupling (h/I = 0.016 rad/s, a sixth of w) is compensated."""
    w, zeta = 0.1, 0.9
    errors = {}
    for dt, attitude in response.items():
        t = dt * np.arange(len(attitude))
        _, risen = signal.step((w**2, [1, 2 * zeta * w, w**2]), T=t)
        errors[dt] = attitude / SMALL - (1 - risen)[:, None]
    # a held command and a rate averaged over the last period are dt/2 late each: 2 zeta w dt/2
    # of the response, which is of size 1, and a little for the step's own start
    assert np.abs(errors[0.25]).max() < 0.02
    extrapolated = 2 * errors[0.125][::2] - errors[0.25]
    # the delay's own effect is first order in dt; (w dt)^2 = 6e-4 is second order
    assert np.abs(extrapolated).max() < 6e-4
    assert np.abs(errors[0.25]).max() > 5 * np.abs(extrapolated).max()


def test_other_damping_would_be_seen(response):
    """The tolerance above tells 0.9 from 0.95 and 0.1 rad/s from 0.105."""
    attitude = response[0.25]
    t = 0.25 * np.arange(len(attitude))
    for w, zeta in ((0.1, 0.95), (0.105, 0.9)):
        _, risen = signal.step((w**2, [1, 2 * zeta * w, w**2]), T=t)
        assert np.abs(attitude / SMALL - (1 - risen)[:, None]).max() > 0.0125


def test_torque_turns_the_body_back():
    """At rest, turned by a about an axis: -I w^2 2 sin(a/2) about it."""
    controller = AttitudeController(jnp.asarray(INERTIA))
    target = Rotation.from_euler("ZYX", [0.3, -0.2, 1.0])
    for axis in range(3):
        turn = 0.4 * np.eye(3)[axis]
        q = (target * Rotation.from_rotvec(turn)).as_quat(scalar_first=True)
        for sign in (1.0, -1.0):  # q and -q are one attitude
            torque = controller.torque(
                known(sign * q),
                jnp.asarray(target.as_quat(scalar_first=True)),
                jnp.zeros(3),
                jnp.zeros(3),
            )
            expected = -INERTIA * 0.01 * 2 * np.sin(0.2) * np.eye(3)[axis]
            np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-12)  # rounding of 30 N*m


def test_the_rate_is_held_against_the_moving_target():
    """Turned by 90 degrees about z, the target's y is the body's x; there is no feedback when the
    body turns with the target, only the torque that holds the wheels' momentum up."""
    controller = AttitudeController(jnp.asarray(INERTIA))
    q = np.array([1.0, 0.0, 0.0, 1.0]) / np.sqrt(2)
    n = 1e-3
    moving = jnp.array([0.0, -n, 0.0])
    held = controller.torque(
        known([1.0, 0, 0, 0], [0.0, -n, 0.0]), known(q).q, moving, jnp.zeros(3)
    )
    turned = controller.torque(known(q, [-n, 0.0, 0.0]), known(q).q, moving, jnp.zeros(3))
    with_target = controller.torque(
        known([1.0, 0, 0, 0], [0.0, -n, 0.0]), known([1.0, 0, 0, 0]).q, moving, jnp.asarray(MOMENTA)
    )
    np.testing.assert_allclose(with_target, np.cross([0.0, -n, 0.0], MOMENTA), rtol=0, atol=1e-15)
    # aligned with the target in attitude but turning about its own x: 2 zeta w I against it
    np.testing.assert_allclose(
        turned, 2 * 0.9 * 0.1 * INERTIA * np.array([n, -n, 0.0]), rtol=0, atol=1e-12
    )
    # attitude 90 degrees off about z, -2 sin(45 deg); the target's -y is this body's +x... by n
    rate = np.array([0.0, -n, 0.0]) - Rotation.from_euler("Z", -90, degrees=True).inv().apply(
        moving
    )
    theta = np.array([0.0, 0.0, -np.sqrt(2)])
    expected = -INERTIA * (0.01 * theta + 0.18 * rate)
    np.testing.assert_allclose(held, expected, rtol=0, atol=1e-12)
