"""Dead times, sample by sample: what was commanded some seconds ago acts now.

The rule is that of `telemetry.dead_time`; the latest rows are kept in a ring of fixed size.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from faultgauge.plants.signals import Signals
from faultgauge.telemetry.runs import GAP_STEPS, ROUNDING

__all__ = ["DelayLine", "DelayState"]

ROOM = 2  # times the rows of the longest delay: rows may come that much faster than they usually do


class DelayState(NamedTuple):
    """The latest rows, the newest last; NaN where none has come yet."""

    t: Float[Array, "rows"]
    u: Float[Array, "rows inputs"]


class DelayLine(eqx.Module):
    """`delay` [s] of every input, and whether it is `held` between samples."""

    delay: Float[np.ndarray, "inputs"]
    held: Bool[np.ndarray, "inputs"]
    rows: int = eqx.field(static=True)

    @staticmethod
    def of(signals: Signals, step: float) -> "DelayLine":
        """For rows that are `step` [s] apart."""
        delay = np.array([each.delay for each in signals.inputs], float)
        longest = float(delay.max(initial=0.0))
        rows = ROOM * int(np.ceil(longest / step)) + 2 if longest else 0
        return DelayLine(delay, np.array([e.hold == "zero" for e in signals.inputs], bool), rows)

    def init(self) -> DelayState:
        nothing = jnp.full((self.rows, len(self.delay)), jnp.nan)
        return DelayState(jnp.full(self.rows, jnp.nan), nothing)

    def step(
        self,
        state: DelayState,
        t: Float[Array, ""],
        u: Float[Array, "inputs"],
        step: Float[Array, ""],
        averaged: Bool[Array, ""],
    ) -> tuple[DelayState, Float[Array, "inputs"]]:
        """The inputs that act at `t` [s], NaN where that is not known.

        `step` [s] is that of the rows; what is `averaged` over the intervals of a lower rate is
        averaged over the delayed ones, too.
        """
        if self.rows == 0:
            return state, u
        when = jnp.concatenate([state.t[1:], t[None]])
        past = jnp.concatenate([state.u[1:], u[None]])
        every = np.arange(len(self.delay))
        sought, near = t - self.delay, ROUNDING * step
        # a delay of whole steps meets samples, but for the rounding of t
        before = when[:, None] <= sought + near
        left = jnp.max(jnp.where(before, np.arange(self.rows)[:, None], -1), axis=0)
        at = jnp.clip(left, 0, self.rows - 2)
        first, second = past[at, every], past[at + 1, every]
        long = when[at + 1] - when[at]
        share = jnp.clip((sought - when[at]) / long, 0.0, 1.0)
        between = jnp.where(self.held & ~averaged, first, first + share * (second - first))
        between = jnp.where(long > (GAP_STEPS + ROUNDING) * step, jnp.nan, between)
        met = jnp.abs(sought - when[at]) <= near
        acting = jnp.where(left >= 0, jnp.where(met, first, between), jnp.nan)
        return DelayState(when, past), jnp.where(self.delay > 0, acting, u)
