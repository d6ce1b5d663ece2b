"""Accommodation in the loop: estimate, decide, compensate."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from faultgauge.accommodation.alarm import Alarm, AlarmState
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
    sd: Float[Array, "faults"]
    engaged: Bool[Array, "faults"]
    c: Float[Array, "inputs"]
    short: Bool[Array, "inputs"]


class _State(NamedTuple):
    estimator: Any
    alarm: AlarmState
    c: Float[Array, "inputs"]


class Accommodation(Policy):
    """u = u_wanted + c, with c from the faults that the alarm has engaged.

    c moves at its slew limit at most, so that it comes and goes without a bump, and takes no more
    than its authority: the rest of the actuator stays with the controller. Without an `alarm`
    every estimate is acted upon at once; without a `feed_forward` none is.
    """

    estimator: Estimator
    alarm: Alarm | None
    feed_forward: FeedForward | None
    limits: Limits

    def init(self, x: Float[Array, "states"], u: Float[Array, "inputs"]) -> _State:
        faults = jnp.zeros(len(self.estimator.plant.signals.faults))
        always = AlarmState(jnp.ones_like(faults, bool), faults, faults)
        alarm = always if self.alarm is None else self.alarm.init()
        return _State(self.estimator.init(x, u), alarm, jnp.zeros_like(u))

    def step(
        self,
        state: _State,
        wanted: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
        dt: Float[Array, ""],
    ) -> tuple[_State, Float[Array, "inputs"], Info]:
        inner, estimate = self.estimator.read(state.estimator, y, dt)
        alarm, engaged = state.alarm, state.alarm.engaged
        if self.alarm is not None:
            alarm, engaged = self.alarm.step(state.alarm, estimate, dt)
        c, short = state.c, jnp.zeros_like(wanted, bool)
        if self.feed_forward is not None:
            f = jnp.where(engaged, estimate.f, 0.0)
            needed = self.feed_forward.command(estimate.x, wanted, f)
            c, short = limited(needed, state.c, self.limits, dt)
        inputs = self.estimator.plant.signals.inputs
        lower = jnp.array([each.min for each in inputs])
        upper = jnp.array([each.max for each in inputs])
        u = wanted + c
        short = short | (u > upper) | (u < lower)
        inner = self.estimator.commanded(inner, jnp.clip(u, lower, upper))
        return _State(inner, alarm, c), u, Info(estimate.f, estimate.sd, engaged, c, short)

    def overruled(self, state: _State, u: Float[Array, "inputs"]) -> _State:
        """The state when `u` stands in place of what the last step commanded."""
        return state._replace(estimator=self.estimator.commanded(state.estimator, u))


def accommodation(
    name: str,
    estimator: Estimator,
    alarm: Alarm,
    desired: Plant,
    limits: Limits,
    outcome: Float[Array, "regulated states"],
    floor: float,
) -> Accommodation:
    """One of `POLICIES` by its name.

    - "none" estimates and alarms, and leaves the command alone.
    - "estimate" cancels engaged faults: the plant does what it would do healthy.
    - "estimate_and_friction" also cancels what the model knows to differ from `desired`, which
      it does from the first sample on: on a wheel, the learned friction.
    - "adrc" cancels whatever differs from `desired`, which is then also the estimator's plant, at
      once and without an alarm (J. Han, "From PID to active disturbance rejection control", IEEE
      TIE 56, 2009).
    """
    if name == "none":
        return Accommodation(estimator, alarm, None, limits)
    target = estimator.plant if name == "estimate" else desired
    feed_forward = FeedForward(estimator.plant, target, outcome, floor)
    return Accommodation(estimator, None if name == "adrc" else alarm, feed_forward, limits)
