"""Whether the likeliest explanation explains: normalised innovations squared, as in healthy logs.

The bank weighs explanations against each other, and of those that are all wrong one is the best.
Under a right one innovations are as small as in healthy logs, in the mean of each window

    nis = sum_k nu_k^T S_k^-1 nu_k / (samples x outputs)

(Y. Bar-Shalom, X. Li and T. Kirubarajan, Estimation with Applications to Tracking and Navigation
(2001), section 5.4). Where they are larger than `limit` something undeclared is there, and no
declared fault is told until it has not shown for as long as it did: what comes and goes has an
explanation that fits in between.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.observers.branches import BranchInfo

__all__ = ["Consistency", "ConsistencyState", "limit_of"]

BEYOND = 3.0  # times as far above the median as the worst of healthy logs


class ConsistencyState(NamedTuple):
    """When what fits nothing was seen first and last [s]; NaN: not lately."""

    first: Float[Array, ""]
    last: Float[Array, ""]


class Consistency(eqx.Module):
    """`limit` of each window, the longest of which is `window` [s]. Pure `init` and `step`."""

    limit: Float[np.ndarray, "windows"]
    window: Float[np.ndarray, ""]

    @staticmethod
    def of(bank: FaultBank) -> "Consistency":
        longest = np.max(bank.modes.windows) * bank.knowledge.memory
        return Consistency(bank.nis, np.asarray(longest))

    def init(self) -> ConsistencyState:
        nothing = jnp.asarray(jnp.nan)
        return ConsistencyState(nothing, nothing)

    def step(
        self, state: ConsistencyState, t: Float[Array, ""], said: BranchInfo
    ) -> tuple[ConsistencyState, BranchInfo]:
        """`said` at `t` [s], with all that any cause is likely by given to something undeclared
        where none explains enough, and all that declared ones are for as long again."""
        lasted = jnp.maximum(state.last - state.first, self.window)
        on = t <= state.last + lasted
        now = jnp.any(said.nis > self.limit)
        first = jnp.where(on, state.first, jnp.where(now, t, jnp.nan))
        last = jnp.where(now, t, jnp.where(on, state.last, jnp.nan))
        p = said.p
        declared = np.arange(len(p)) > 0
        lost = jnp.where(now, 1.0, jnp.where(on, declared, 0.0)) * p
        p = (p - lost).at[-1].add(jnp.sum(lost))
        return ConsistencyState(first, last), said._replace(p=p)


def limit_of(nis: Float[np.ndarray, "samples windows"]) -> Float[np.ndarray, "windows"]:
    """The limits by what healthy logs show."""
    usual = np.median(nis, axis=0)
    return usual + BEYOND * (nis.max(axis=0) - usual)
