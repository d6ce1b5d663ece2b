"""Accommodation in the loop: what the posterior names is compensated."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from faultgauge.accommodation.estimator import Estimator
from faultgauge.accommodation.feed_forward import FeedForward, Limits, limited
from faultgauge.plants.plant import Plant
from faultgauge.simulation.policy import Policy

__all__ = ["POLICIES", "Accommodation", "Info", "accommodation"]

POLICIES = ("none", "estimate", "estimate_and_friction", "adrc")


class Info(NamedTuple):
    """What a step tells: estimated faults, which are acted upon, the compensation (input unit),
    and whether limits of compensation or actuator leave it short of what is needed."""

    f: Float[Array, "faults"]
    engaged: Bool[Array, "faults"]
    c: Float[Array, "inputs"]
    short: Bool[Array, "inputs"]


class AccommodationState(NamedTuple):
    """The estimator's own state, and the compensation that stands (input unit)."""

    estimator: Any
    c: Float[Array, "inputs"]


class Accommodation(Policy):
    """u = u_wanted + c, with c from the faults that the `estimator` says to act upon.

    c moves at its slew limit at most, so that it comes and goes without a bump, and takes no more
    than its authority: the rest of the actuator stays with the controller. Without a `feed_forward`
    none is acted upon.
    """

    estimator: Estimator
    feed_forward: FeedForward | None
    limits: Limits

    def init(self, x: Float[Array, "states"], u: Float[Array, "inputs"]) -> AccommodationState:
        return AccommodationState(self.estimator.init(x, u), jnp.zeros_like(u))

    def step(
        self,
        state: AccommodationState,
        wanted: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
        dt: Float[Array, ""],
    ) -> tuple[AccommodationState, Float[Array, "inputs"], Info]:
        inner, estimate = self.estimator.read(state.estimator, y, dt)
        c, short = state.c, jnp.zeros_like(wanted, bool)
        if self.feed_forward is not None:
            f = jnp.where(estimate.engaged, estimate.f, 0.0)
            needed = self.feed_forward.command(estimate.x, wanted, f)
            c, short = limited(needed, state.c, self.limits, dt)
        inputs = self.estimator.plant.signals.inputs
        lower = jnp.array([each.min for each in inputs])
        upper = jnp.array([each.max for each in inputs])
        u = wanted + c
        short = short | (u > upper) | (u < lower)
        inner = self.estimator.commanded(inner, jnp.clip(u, lower, upper))
        return AccommodationState(inner, c), u, Info(estimate.f, estimate.engaged, c, short)

    def overruled(self, state: AccommodationState, u: Float[Array, "inputs"]) -> AccommodationState:
        """The state when `u` stands in place of what the last step commanded."""
        return state._replace(estimator=self.estimator.commanded(state.estimator, u))


def accommodation(
    name: str,
    estimator: Estimator,
    desired: Plant,
    limits: Limits,
    outcome: Float[Array, "regulated states"],
    floor: float,
) -> Accommodation:
    """One of `POLICIES` by its name.

    - "none" estimates and decides, and leaves the command alone.
    - "estimate" cancels the faults that are named: the plant does what it would do healthy.
    - "estimate_and_friction" also cancels what the model knows to differ from `desired`, which
      it does from the first sample on: on a wheel, the learned friction.
    - "adrc" cancels whatever differs from `desired`, at once: its estimator is `TotalDisturbance`
      over that plant (J. Han, "From PID to active disturbance rejection control", IEEE TIE 56,
      2009).
    """
    if name == "none":
        return Accommodation(estimator, None, limits)
    target = estimator.plant if name == "estimate" else desired
    return Accommodation(estimator, FeedForward(estimator.plant, target, outcome, floor), limits)
