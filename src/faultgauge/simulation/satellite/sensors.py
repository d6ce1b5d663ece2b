"""Rate-integrating gyro, infrared earth sensor and sun sensors, with their geometry."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

__all__ = ["Direction", "EarthSensor", "Gyro", "SunSensors"]

X, Y, Z = np.eye(3)
# The sun heads on +x, -x, +y, -y, -z; rows: two transverse axes and the boresight.
HEADS = np.array([[Y, Z, X], [Z, Y, -X], [Z, X, Y], [X, Z, -Y], [Y, X, -Z]])


class Direction(NamedTuple):
    """A measured direction: unit vector in body axes, and whether there was one to measure."""

    vector: Float[Array, "3"]
    valid: Bool[Array, ""]


class Gyro(eqx.Module):
    """Counts pulses of `quantum` [rad] of the integrated rate, on three axes.

    Angle random walk `arw` [rad/sqrt(s)], bias [rad/s] with random walk `rrw` [rad/s/sqrt(s)].
    """

    arw: float = 1e-6
    rrw: float = 1e-9
    bias: tuple[float, float, float] = (5e-6, -3e-6, 4e-6)
    quantum: float = 5e-7

    def counts(self, angle: Float[Array, "3"]) -> Float[Array, "3"]:
        """The accumulated `angle` [rad] in whole pulses, rad."""
        return jnp.floor(angle / self.quantum) * self.quantum


class EarthSensor(eqx.Module):
    """A static infrared horizon sensor that looks along body z.

    It gives roll and pitch of the nadir direction with noise `sigma` [rad], as long as nadir is
    within `field` [rad] of its axis.
    """

    sigma: float = 5e-4
    field: float = 0.6

    def measure(self, nadir: Float[Array, "3"], noise: Float[Array, "2"]) -> Direction:
        """`nadir`: unit vector in body axes; `noise`: standard normal."""
        x, y, z = nadir
        roll = jnp.arctan2(y, z) + self.sigma * noise[0]
        pitch = jnp.arctan2(-x, z) + self.sigma * noise[1]
        measured = jnp.stack([-jnp.tan(pitch), jnp.tan(roll), jnp.ones(())])
        return Direction(measured / jnp.linalg.norm(measured), z > jnp.cos(self.field))


class SunSensors(eqx.Module):
    """Two-axis digital sun sensors, one head on each of the faces +x, -x, +y, -y, -z.

    The head that faces the Sun best gives two angles with noise `sigma` [rad] each, as long as
    the Sun is within `field` [rad] of its axis and the satellite is not in shadow.
    """

    sigma: float = 3e-4
    field: float = 1.1

    def measure(
        self, sun: Float[Array, "3"], sunlit: Bool[Array, ""], noise: Float[Array, "2"]
    ) -> Direction:
        """`sun`: unit vector in body axes; `noise`: standard normal."""
        heads = jnp.asarray(HEADS)
        seen = heads @ sun
        best = (jnp.arange(len(heads)) == jnp.argmax(seen[:, 2]))[:, None]
        a, b, c = jnp.sum(jnp.where(best, seen, 0.0), axis=0)
        head = jnp.sum(jnp.where(best[..., None], heads, 0.0), axis=0)
        first = jnp.arctan2(a, c) + self.sigma * noise[0]
        second = jnp.arctan2(b, c) + self.sigma * noise[1]
        inside = jnp.stack([jnp.tan(first), jnp.tan(second), jnp.ones(())])
        measured = head.T @ (inside / jnp.linalg.norm(inside))
        return Direction(measured, sunlit & (c > jnp.cos(self.field)))
