"""When a fault estimate may be acted upon: present, settled, isolated, and for long enough."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from faultgauge.accommodation.estimator import Estimate

__all__ = ["Alarm", "AlarmState"]

SETTLED = 0.25  # of the size: an estimate that has moved less within `settling` has settled
RELEASE = 0.5  # of the limit: below it a fault is taken to be over
SIGMAS = 3.0  # of the estimate's own spread
UNEXPLAINED = 4.0  # mean square innovation, in units of what is expected


class AlarmState(NamedTuple):
    """Which faults are acted upon, for how long [s] each has spoken for a change of that, and the
    estimates' slow followers."""

    engaged: Bool[Array, "faults"]
    waited: Float[Array, "faults"]
    slow: Float[Array, "faults"]


class Alarm(eqx.Module):
    """Engages a fault once for `persistence` [s] on end its estimate

    - exceeds its limit (`limits`, the fault's unit) and three times its own spread,
    - has settled: differs by less than a quarter from where it was about `settling` [s] ago,
    - is isolated: the declared faults account for the measurements,

    and releases it once the estimate has been below half the limit for as long.
    """

    limits: Float[Array, "faults"]
    persistence: float
    settling: float

    def init(self) -> AlarmState:
        none = jnp.zeros_like(self.limits)
        return AlarmState(none.astype(bool), none, none)

    def step(
        self, state: AlarmState, estimate: Estimate, dt: Float[Array, ""]
    ) -> tuple[AlarmState, Bool[Array, "faults"]]:
        f, size = estimate.f, jnp.abs(estimate.f)
        slow = state.slow + (1.0 - jnp.exp(-dt / self.settling)) * (f - state.slow)
        present = (size > self.limits) & (size > SIGMAS * estimate.sd)
        settled = jnp.abs(f - slow) <= SETTLED * size
        isolated = estimate.unexplained < UNEXPLAINED
        over = size < RELEASE * self.limits
        speaks = jnp.where(state.engaged, over, present & settled & isolated)
        waited = jnp.where(speaks, state.waited + dt, 0.0)
        turns = waited >= self.persistence
        engaged = state.engaged ^ turns
        return AlarmState(engaged, jnp.where(turns, 0.0, waited), slow), engaged
