"""Where the satellite is, where the Earth and the Sun stand, and when it is dark."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from faultgauge.simulation.satellite.rotations import from_vector, product

__all__ = ["Orbit"]

EARTH_MU = 3.986004418e14  # m^3/s^2, WGS 84
EARTH_RADIUS = 6.378137e6  # m, WGS 84
AT_ZERO = (0.5, -0.5, -0.5, 0.5)  # the orbit frame at argument 0: x = e2, y = -e3, z = -e1


class Orbit(eqx.Module):
    """A circular orbit in its own inertial frame: z along the orbit normal, x to the place of
    argument 0.

    `altitude` [m]; `start` argument at t = 0 [rad]; the Sun stands `sun_elevation` [rad] above
    the orbit plane (the angle beta) at the argument `sun_azimuth` [rad].
    """

    altitude: float = 540e3
    start: float = 0.0
    sun_elevation: float = 0.4
    sun_azimuth: float = -1.1

    @property
    def radius(self) -> Float[Array, ""]:
        return jnp.asarray(EARTH_RADIUS + self.altitude)

    @property
    def rate(self) -> Float[Array, ""]:
        """n = sqrt(mu / r^3), rad/s."""
        return jnp.sqrt(EARTH_MU / self.radius**3)

    def position(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        """Unit vector from the Earth's centre, inertial."""
        argument = self.start + self.rate * t
        return jnp.stack([jnp.cos(argument), jnp.sin(argument), jnp.zeros(())])

    def frame(self, t: Float[Array, ""]) -> Float[Array, "4"]:
        """Quaternion of the orbit frame: z to nadir, y against the orbit normal, x forward."""
        along_z = jnp.stack([jnp.zeros(()), jnp.zeros(()), self.start + self.rate * t])
        return product(from_vector(along_z), jnp.array(AT_ZERO))

    @property
    def frame_rate(self) -> Float[Array, "3"]:
        """Angular velocity of the orbit frame in its own axes, rad/s."""
        return jnp.stack([jnp.zeros(()), -self.rate, jnp.zeros(())])

    @property
    def sun(self) -> Float[Array, "3"]:
        """Unit vector to the Sun, inertial."""
        up, around = self.sun_elevation, self.sun_azimuth
        flat = jnp.cos(up)
        return jnp.array([flat * jnp.cos(around), flat * jnp.sin(around), jnp.sin(up)])

    def sunlit(self, t: Float[Array, ""]) -> Bool[Array, ""]:
        """False in the Earth's shadow, taken as a cylinder."""
        along = self.position(t) @ self.sun
        off_axis = self.radius * jnp.sqrt(jnp.maximum(1.0 - along**2, 0.0))
        return (along > 0) | (off_axis > EARTH_RADIUS)
