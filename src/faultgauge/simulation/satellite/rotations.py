"""Rotations by unit quaternions (w, x, y, z), Hamilton's product.

A quaternion q of a frame turns that frame's vectors into the parent's: v_parent = q v q*.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

__all__ = [
    "angle",
    "conjugate",
    "cross_matrix",
    "from_angles",
    "from_vector",
    "into_frame",
    "normalised",
    "product",
    "to_angles",
]

Quaternion = Float[Array, "4"]
Vector = Float[Array, "3"]


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """p q."""
    w = p[0] * q[0] - p[1:] @ q[1:]
    return jnp.concatenate([w[None], p[0] * q[1:] + q[0] * p[1:] + jnp.cross(p[1:], q[1:])])


def conjugate(q: Quaternion) -> Quaternion:
    """The rotation back: q* of a unit quaternion."""
    return q * jnp.array([1.0, -1.0, -1.0, -1.0])


def normalised(q: Quaternion) -> Quaternion:
    """The unit quaternion along `q`."""
    return q / jnp.linalg.norm(q)


def into_frame(q: Quaternion, v: Vector) -> Vector:
    """The parent's vector `v` in the axes of the frame of `q`: q* v q."""
    t = 2.0 * jnp.cross(v, q[1:])
    return v + q[0] * t + jnp.cross(t, q[1:])


def from_vector(theta: Vector) -> Quaternion:
    """The rotation by |theta| [rad] about theta."""
    angle = jnp.linalg.norm(theta)
    half = jnp.sinc(angle / (2 * jnp.pi)) / 2  # sin(angle/2) / angle, smooth at 0
    return jnp.concatenate([jnp.cos(angle / 2)[None], half * theta])


def angle(q: Quaternion) -> Float[Array, ""]:
    """What `q` turns by, 0 to pi [rad]."""
    return 2.0 * jnp.arctan2(jnp.linalg.norm(q[1:]), jnp.abs(q[0]))


def from_angles(roll: Array, pitch: Array, yaw: Array) -> Quaternion:
    """Yaw about z, then pitch about y, then roll about x [rad]."""
    x, y, z = jnp.eye(3)
    return product(product(from_vector(yaw * z), from_vector(pitch * y)), from_vector(roll * x))


def to_angles(q: Quaternion) -> Float[Array, "3"]:
    """(roll, pitch, yaw) [rad] of `from_angles`."""
    w, x, y, z = q
    roll = jnp.arctan2(2 * (w * x + y * z), 1 - 2 * (x**2 + y**2))
    pitch = jnp.arcsin(jnp.clip(2 * (w * y - z * x), -1.0, 1.0))
    yaw = jnp.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))
    return jnp.stack([roll, pitch, yaw])


def cross_matrix(v: Vector) -> Float[Array, "3 3"]:
    """[v x]."""
    x, y, z = v
    zero = jnp.zeros(())
    return jnp.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])
