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
    # the command is held and the rate averaged over the last period, each dt/2 late: that takes
    # 2 zeta w dt = 4.5 % off the inertia, so 2 % on w and on zeta, and 1 % on the response
    assert np.abs(errors[0.25]).max() < 0.0125
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


def torque(q, rate, target, momentum=(0.0, 0.0, 0.0)):
    """For a target that turns at N about its own -y."""
    return AttitudeController(jnp.asarray(INERTIA)).torque(
        known(q, rate), jnp.asarray(target), jnp.array([0.0, -N, 0.0]), jnp.asarray(momentum)
    )


N = 1e-3  # rad/s
LEVEL, TURNED = [1.0, 0.0, 0.0, 0.0], [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]  # 90 deg about z
ROUNDING = 1e-13  # of 0.01 * sqrt(2) * 2500 N*m and less


def test_with_the_target_only_the_wheels_need_torque():
    """No error in attitude or rate: the momentum that turns along needs omega x h."""
    found = torque(LEVEL, [0.0, -N, 0.0], LEVEL, MOMENTA)
    np.testing.assert_allclose(found, np.cross([0, -N, 0], MOMENTA), rtol=0, atol=ROUNDING)


def test_the_rate_is_that_against_the_target():
    """In the target's attitude (both turned) but turning about x: 2 zeta w I on the difference."""
    found = torque(TURNED, [-N, 0.0, 0.0], TURNED)
    expected = -0.18 * INERTIA * np.array([-N, N, 0.0])
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_the_targets_rate_is_seen_from_the_body():
    """The target stands 90 degrees about z ahead: it turns about its -y, the body's +x, and the
    body is -90 degrees off, which counts as 2 sin(-45 deg)."""
    found = torque(LEVEL, [0.0, -N, 0.0], TURNED)
    rate = np.array([0.0, -N, 0.0]) - np.array([N, 0.0, 0.0])
    expected = -INERTIA * (0.01 * np.array([0.0, 0.0, -np.sqrt(2)]) + 0.18 * rate)
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)
