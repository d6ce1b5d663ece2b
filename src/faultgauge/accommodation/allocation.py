"""Torque on the body shared out among wheels by what is left of each.

    t = -W A^T (A W A^T)^+ tau,   W = diag(e^2) over the wheels in use

is the least sum of (t/e)^2, the commands' squares, with A t = -tau (weighted pseudo-inverse;
T. A. Johansen and T. I. Fossen, "Control allocation - a survey", Automatica 49, 2013).
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from faultgauge.accommodation.policy import Accommodation, Info
from faultgauge.accommodation.units import Units, UnitsState
from faultgauge.simulation.policy import Policy

__all__ = ["NullMotion", "Reconfiguration", "ReconfigurationInfo", "allocate", "null_projector"]

RANK_TOLERANCE = 1e-6  # relative to the largest singular value


def allocate(
    axes: Float[Array, "3 wheels"], weights: Float[Array, "wheels"], tau: Float[Array, "3"]
) -> Float[Array, "wheels"]:
    """Wheel torques [N*m] that put `tau` on the body; least squares where they cannot."""
    spread = weights[:, None] * axes.T
    return -spread @ jnp.linalg.pinv(axes @ spread, rtol=RANK_TOLERANCE) @ tau


def null_projector(
    axes: Float[Array, "3 wheels"], used: Bool[Array, "wheels"]
) -> Float[Array, "wheels wheels"]:
    """Onto the torques of the wheels in use that cancel on the body."""
    A = jnp.where(used, axes, 0.0)
    return jnp.diag(used.astype(float)) - jnp.linalg.pinv(A, rtol=RANK_TOLERANCE) @ A


class NullMotion(NamedTuple):
    """Drives the wheels towards the `bias` momenta [N*m*s], away from standstill, where friction
    turns round and a wheel sticks; at `rate` [1/s], with no more than `most` [N*m] in a wheel."""

    bias: Float[Array, "wheels"]
    rate: float
    most: float


class ReconfigurationInfo(NamedTuple):
    """What each wheel's policy tells, and the array: wheels in use and the rank of their axes."""

    wheels: Info
    used: Bool[Array, "wheels"]
    rank: Int[Array, ""]


class _State(NamedTuple):
    each: Any
    units: UnitsState
    loss: Float[Array, "wheels"]


class Reconfiguration(Policy):
    """Every wheel has an estimator and a model of its own (the leaves of `each` have the wheels
    first); its declared faults hold a gain loss at `loss`. Wheels that are lost get no command,
    and what drags on them is put on the others; those in part lost get less to do.
    """

    each: Accommodation
    axes: Float[Array, "3 wheels"]
    units: Units
    loss: int = eqx.field(static=True)
    null_motion: NullMotion | None

    def init(self, x: Float[Array, "wheels"], u: Float[Array, "wheels"]) -> _State:
        one = eqx.filter_vmap(lambda p, h, u: p.init(h[None], u[None]))
        return _State(one(self.each, x, u), self.units.init(), jnp.zeros_like(x))

    def step(
        self,
        state: _State,
        wanted: Float[Array, "3"],
        y: Float[Array, "wheels outputs"],
        dt: Float[Array, ""],
    ) -> tuple[_State, Float[Array, "wheels"], ReconfigurationInfo]:
        """`wanted`: torque on the body [N*m]; a wheel's second output is its momentum."""
        units, used = self.units.step(state.units, state.loss, dt)
        h = y[:, 1]
        drag = jnp.where(used, 0.0, self._coasting(h))
        weights = jnp.where(used, (1.0 - state.loss) ** 2, 0.0)
        torque = allocate(self.axes, weights, wanted + self.axes @ drag)
        if self.null_motion is not None:
            bias, rate, most = self.null_motion
            moved = null_projector(self.axes, used) @ (rate * (bias - h))
            torque = torque + moved * jnp.minimum(1.0, most / jnp.max(jnp.abs(moved), initial=most))

        def one(policy: Accommodation, state: Any, t: Array, y: Array, used: Array) -> tuple:
            state, u, info = policy.step(state, t[None], y, dt)
            u = jnp.where(used, u, 0.0)
            return policy.overruled(state, u), u[0], info

        each, u, info = eqx.filter_vmap(one)(self.each, state.each, torque, y, used)
        engaged = info.engaged[:, self.loss]
        loss = jnp.where(engaged, jnp.clip(info.f[:, self.loss], 0.0, 1.0), 0.0)
        rank = jnp.linalg.matrix_rank(jnp.where(used, self.axes, 0.0), rtol=RANK_TOLERANCE)
        return _State(each, units, loss), u, ReconfigurationInfo(info, used, rank)

    def _coasting(self, h: Float[Array, "wheels"]) -> Float[Array, "wheels"]:
        """Torque [N*m] of each wheel without a command, by its model."""

        def one(policy: Accommodation, h: Array) -> Array:
            return policy.estimator.plant.derivative(h[None], jnp.zeros(1))[0]

        return eqx.filter_vmap(one)(self.each, h)
