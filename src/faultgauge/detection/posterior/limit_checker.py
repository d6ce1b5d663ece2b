"""When an alarm begins and ends: persistence, hysteresis, latching (NASA cFS Limit Checker, LC)."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

__all__ = ["LimitChecker", "LimitState"]

ROUNDING = 1e-9  # of a persistence


class LimitState(NamedTuple):
    """Since when each watch point has been over, pauses left out [s] (NaN: it is not), whether it
    is engaged, and when it was seen last [s]."""

    since: Float[Array, "*points"]
    engaged: Bool[Array, "*points"]
    last: Float[Array, ""]


class LimitChecker(eqx.Module):
    """Watch points: engaged once `over` has held for `persistence` [s], `on_end` or in all, with
    pauses in which it was not `under` either, until `under`, or for good where it latches."""

    persistence: Float[np.ndarray, "*points"]
    latch: bool = eqx.field(static=True)
    on_end: bool = eqx.field(static=True, default=True)

    def init(self, *points: int) -> LimitState:
        nan = jnp.asarray(jnp.nan)
        return LimitState(jnp.full(points, nan), jnp.zeros(points, bool), nan)

    def step(
        self,
        state: LimitState,
        t: Float[Array, ""],
        over: Bool[Array, "*points"],
        under: Bool[Array, "*points"],
    ) -> tuple[LimitState, Bool[Array, "*points"]]:
        """Whether each is engaged at `t` [s]; one that is neither over nor under stays what it
        was."""
        paused = jnp.nan if self.on_end else jnp.where(under, jnp.nan, t - state.last)
        before = jnp.where(over, state.since, state.since + paused)
        since = jnp.where(over & ~jnp.isfinite(before), t, before)
        holds = over & (t - since >= self.persistence * (1 - ROUNDING))
        engaged = holds | (state.engaged & ~(under & (not self.latch)))
        return LimitState(since, engaged, t), engaged
