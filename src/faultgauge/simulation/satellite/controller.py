"""Attitude controller: proportional-derivative with gyroscopic compensation."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from faultgauge.simulation.satellite.determination import AttitudeEstimate
from faultgauge.simulation.satellite.rotations import conjugate, into_frame, product

__all__ = ["AttitudeController"]


class AttitudeController(eqx.Module):
    """tau = -I (omega_n^2 theta + 2 zeta omega_n d(theta)/dt) + omega x (I omega + h).

    `bandwidth` omega_n [rad/s], `damping` zeta, `inertia` [kg*m^2] about the body axes.
    """

    inertia: Float[Array, "3"]
    bandwidth: float = 0.1
    damping: float = 0.9

    def torque(
        self,
        estimate: AttitudeEstimate,
        target: Float[Array, "4"],
        target_rate: Float[Array, "3"],
        momentum: Float[Array, "3"],
    ) -> Float[Array, "3"]:
        """Torque wanted on the body [N*m]; `target_rate` in the target's axes, `momentum` of all
        wheels in body axes [N*m*s]."""
        error = product(conjugate(target), estimate.q)
        theta = 2.0 * jnp.where(error[0] < 0, -1.0, 1.0) * error[1:]
        rate = estimate.rate - into_frame(error, target_rate)
        feedback = self.bandwidth**2 * theta + 2 * self.damping * self.bandwidth * rate
        total = self.inertia * estimate.rate + momentum
        return -self.inertia * feedback + jnp.cross(estimate.rate, total)
