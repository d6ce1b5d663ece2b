"""Which of several redundant units are in use: the decision to give one up."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

__all__ = ["Units", "UnitsState"]


class UnitsState(NamedTuple):
    """Which units are lost, and for how long [s] each has looked so."""

    lost: Bool[Array, "units"]
    waited: Float[Array, "units"]


class Units(eqx.Module):
    """A unit in use is lost once its engaged loss of effectiveness has been above `1 - floor` for
    `persistence` [s] on end. It stays lost: without commands it could not show otherwise, and
    nothing switches back and forth. A spare, `spare_of` naming the unit that it stands in for (-1:
    none), is in use from the loss of that unit until its own.
    """

    spare_of: tuple[int, ...] = eqx.field(static=True)
    floor: float
    persistence: float

    def init(self) -> UnitsState:
        count = len(self.spare_of)
        return UnitsState(jnp.zeros(count, bool), jnp.zeros(count))

    def step(
        self, state: UnitsState, loss: Float[Array, "units"], dt: Float[Array, ""]
    ) -> tuple[UnitsState, Bool[Array, "units"]]:
        """(state, units in use) from the engaged `loss` of each, 0 where none is engaged."""
        gone = self.in_use(state.lost) & (loss > 1.0 - self.floor)
        waited = jnp.where(gone, state.waited + dt, 0.0)
        lost = state.lost | (waited >= self.persistence)
        return UnitsState(lost, waited), self.in_use(lost)

    def in_use(self, lost: Bool[Array, "units"]) -> Bool[Array, "units"]:
        needed = [jnp.asarray(True) if k < 0 else lost[k] for k in self.spare_of]
        return ~lost & jnp.stack(needed)
