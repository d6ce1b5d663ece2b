"""Gain and lag put into a loop, unknown to everything in it: how much of each does it bear?"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from faultgauge.simulation.policy import Policy

__all__ = ["Perturbed"]


class Perturbed(Policy):
    """u(k) = gain u_policy(k - delay): between the policy, which knows nothing of it, and the
    actuators. That is the hardest place: it disturbs the controller's loop and the estimator's."""

    policy: Policy
    gain: Float[Array, ""]
    delay: Int[Array, ""]  # samples, fewer than `depth`
    depth: int = eqx.field(static=True)

    def init(self, x: Float[Array, "*states"], u: Float[Array, "inputs"]) -> Any:
        return self.policy.init(x, u), jnp.broadcast_to(u, (self.depth, *u.shape))

    def step(
        self,
        state: Any,
        wanted: Float[Array, "channels"],
        y: Float[Array, "*outputs"],
        dt: Float[Array, ""],
    ) -> tuple[Any, Float[Array, "inputs"], Any]:
        inner, past = state
        inner, u, info = self.policy.step(inner, wanted, y, dt)
        past = jnp.concatenate([u[None], past[:-1]])
        return (inner, past), self.gain * past[self.delay], info
