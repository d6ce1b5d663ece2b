"""Attitude determination: gyro propagation corrected by directions.

A multiplicative extended Kalman filter for attitude and gyro bias (E. J. Lefferts, F. L. Markley
and M. D. Shuster, "Kalman filtering for spacecraft attitude estimation", J. Guidance 5, 1982).
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from faultgauge.simulation.satellite.rotations import (
    cross_matrix,
    from_vector,
    into_frame,
    normalised,
    product,
)
from faultgauge.simulation.satellite.sensors import Direction

__all__ = ["AttitudeEstimate", "AttitudeFilter"]


class AttitudeEstimate(NamedTuple):
    """Attitude, bias [rad/s], covariance of (attitude error [rad], bias), rate [rad/s]."""

    q: Float[Array, "4"]
    bias: Float[Array, "3"]
    covariance: Float[Array, "6 6"]
    rate: Float[Array, "3"]


class AttitudeFilter(eqx.Module):
    """Noise levels that the filter assumes: those of the sensors."""

    arw: float
    rrw: float

    def propagate(
        self, estimate: AttitudeEstimate, increment: Float[Array, "3"], dt: float
    ) -> AttitudeEstimate:
        """Turn by the gyro's `increment` [rad] over `dt` [s], less the bias."""
        rate = increment / dt - estimate.bias
        turn = rate * dt
        q = normalised(product(estimate.q, from_vector(turn)))
        eye, zero = jnp.eye(3), jnp.zeros((3, 3))
        cross = cross_matrix(turn)
        phi = jnp.block([[eye - cross + cross @ cross / 2, -dt * eye], [zero, eye]])
        noise = jnp.block([[self.arw**2 * dt * eye, zero], [zero, self.rrw**2 * dt * eye]])
        return AttitudeEstimate(q, estimate.bias, phi @ estimate.covariance @ phi.T + noise, rate)

    def correct(
        self,
        estimate: AttitudeEstimate,
        measured: Direction,
        known: Float[Array, "3"],
        sigma: float,
    ) -> AttitudeEstimate:
        """Correct by one direction; `known` is it in inertial axes, `sigma` its noise [rad]."""
        predicted = into_frame(estimate.q, known)
        H = jnp.concatenate([cross_matrix(predicted), jnp.zeros((3, 3))], axis=1)
        P = estimate.covariance
        gain = P @ H.T @ _inverse(H @ P @ H.T + sigma**2 * jnp.eye(3))
        gain = jnp.where(measured.valid, gain, 0.0)
        change = gain @ (measured.vector - predicted)
        reduce = jnp.eye(6) - gain @ H
        covariance = reduce @ P @ reduce.T + sigma**2 * gain @ gain.T  # Joseph's form
        return AttitudeEstimate(
            normalised(product(estimate.q, from_vector(change[:3]))),
            estimate.bias + change[3:],
            covariance,
            estimate.rate - change[3:],
        )


def _inverse(S: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """By cofactors: a library's call would part every loop around it in two."""
    a, b, c = S
    cofactors = jnp.stack([jnp.cross(b, c), jnp.cross(c, a), jnp.cross(a, b)])
    return cofactors.T / (a @ cofactors[0])
