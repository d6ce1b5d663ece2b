"""Quaternions against scipy's rotations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from faultgauge.simulation.satellite import rotations

ROUNDING = 1e-14  # tens of operations on numbers of size 1, 2e-16 each


def quaternions(seed, count=50):
    return Rotation.random(count, rng=seed).as_quat(scalar_first=True)


def as_rotation(q):
    return Rotation.from_quat(np.asarray(q), scalar_first=True)


def apart(a, b):
    """Greatest angle between two sets of rotations [rad]."""
    return np.max((a.inv() * b).magnitude())


def test_product_is_composition():
    p, q = quaternions(0), quaternions(1)
    found = jax.vmap(rotations.product)(jnp.asarray(p), jnp.asarray(q))
    assert apart(as_rotation(found), as_rotation(p) * as_rotation(q)) < ROUNDING
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, rtol=0, atol=ROUNDING)


def test_conjugate_is_the_inverse():
    q = quaternions(2)
    found = jax.vmap(rotations.conjugate)(jnp.asarray(q))
    assert apart(as_rotation(found), as_rotation(q).inv()) < ROUNDING


def test_into_frame_is_the_inverse_rotation():
    q, v = quaternions(3), np.random.default_rng(3).standard_normal((50, 3))
    found = jax.vmap(rotations.into_frame)(jnp.asarray(q), jnp.asarray(v))
    np.testing.assert_allclose(found, as_rotation(q).inv().apply(v), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-12, 1e-8, 1e-4])
def test_small_turns(size):
    """cos(a/2) = 1 and sin(a/2)/a = 1/2 but for a^2/24 = 4e-10 at the greatest of them."""
    axis = np.array([0.6, -0.64, 0.48])
    q = np.asarray(rotations.from_vector(jnp.asarray(size * axis)))
    assert q[0] == pytest.approx(np.cos(size / 2), rel=1e-15)
    np.testing.assert_allclose(q[1:], size * axis / 2, rtol=5e-10, atol=0)


@pytest.mark.parametrize("size", [0.1, 3.0, np.pi, 4.0, 2 * np.pi, 9.0])
def test_large_turns(size):
    axis = np.array([0.6, -0.64, 0.48])
    q = rotations.from_vector(jnp.asarray(size * axis))
    # the sine of an angle of size a is known to a times rounding
    assert apart(as_rotation(q), Rotation.from_rotvec(size * axis)) < 10 * ROUNDING


def test_angles_are_yaw_then_pitch_then_roll():
    rng = np.random.default_rng(4)
    roll, yaw = rng.uniform(-3.1, 3.1, (2, 50))
    pitch = rng.uniform(-1.5, 1.5, 50)  # 90 degrees is where roll and yaw are one
    q = jax.vmap(rotations.from_angles)(*map(jnp.asarray, (roll, pitch, yaw)))
    expected = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=1))
    assert apart(as_rotation(q), expected) < ROUNDING
    found = jax.vmap(rotations.to_angles)(q)
    # 1/cos(1.5) = 14 times the rounding in the sine of pitch
    np.testing.assert_allclose(found, np.stack([roll, pitch, yaw], axis=1), rtol=0, atol=1e-13)


def test_angles_of_any_rotation_are_scipys():
    q = quaternions(5)
    found = jax.vmap(rotations.to_angles)(jnp.asarray(q))
    expected = as_rotation(q).as_euler("ZYX")[:, ::-1]
    assert np.abs(expected[:, 1]).max() < 1.5  # none stands where roll and yaw are one
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)  # as above


def test_cross_matrix():
    v, w = np.random.default_rng(6).standard_normal((2, 3))
    found = rotations.cross_matrix(jnp.asarray(v)) @ w
    np.testing.assert_allclose(found, np.cross(v, w), rtol=0, atol=ROUNDING)


def test_normalised():
    q = np.array([3.0, -4.0, 12.0, 84.0])  # of length 85
    np.testing.assert_allclose(rotations.normalised(jnp.asarray(q)), q / 85, rtol=1e-15)
