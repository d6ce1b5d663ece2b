"""A policy for each wheel of a satellite, beneath the allocation of torque to wheels."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from faultgauge.simulation.policy import Policy

__all__ = ["EachWheel"]


class EachWheel(Policy):
    """u = policy(-allocation tau): wheels know nothing of each other. `stacked` says that the
    leaves of `policy` have the wheels first: each has a model of its own."""

    policy: Policy
    allocation: Float[Array, "wheels 3"]
    stacked: bool = eqx.field(static=True, default=False)

    def init(self, x: Float[Array, "wheels"], u: Float[Array, "wheels"]) -> Any:
        one = eqx.filter_vmap(lambda p, h, u: p.init(h[None], u[None]), in_axes=(self._axis, 0, 0))
        return one(self.policy, x, u)

    def step(
        self,
        state: Any,
        wanted: Float[Array, "3"],
        y: Float[Array, "wheels outputs"],
        dt: Float[Array, ""],
    ) -> tuple[Any, Float[Array, "wheels"], Any]:
        """`wanted`: torque on the body [N*m]."""

        def one(policy: Policy, state: Any, wanted: Array, y: Array) -> tuple[Any, Array, Any]:
            return policy.step(state, wanted[None], y, dt)

        each = eqx.filter_vmap(one, in_axes=(self._axis, 0, 0, 0))
        state, u, info = each(self.policy, state, -self.allocation @ wanted, y)
        return state, jnp.reshape(u, -1), info

    @property
    def _axis(self) -> Any:
        return eqx.if_array(0) if self.stacked else None
