"""Whether the likeliest explanation explains: normalised innovations squared, as in healthy logs.

The bank weighs explanations against each other, and of those that are all wrong one is the best.
Under a right one innovations are as small as in healthy logs, in the mean of each window

    nis = sum_k nu_k^T S_k^-1 nu_k / (samples x outputs)

(Y. Bar-Shalom, X. Li and T. Kirubarajan, Estimation with Applications to Tracking and Navigation
(2001), section 5.4). Where they are larger than `limit` something undeclared is there, and what
fits now and then is not told: a name has to have come with it, or before, and to have been likely
ever since for a window at least, as that of a broken propeller is, which shakes what it drives.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.posterior.posterior import LIKELY
from faultgauge.observers.branches import BranchInfo
from faultgauge.products import contract

__all__ = ["Consistency", "ConsistencyState", "limit_of"]

BEYOND = 3.0  # times as far above the median as the worst of healthy logs


class ConsistencyState(NamedTuple):
    """When what fits nothing was seen first and last, and since when each fault is likely [s]; NaN:
    not lately."""

    first: Float[Array, ""]
    last: Float[Array, ""]
    since: Float[Array, "faults"]


class Consistency(eqx.Module):
    """`limit` of each window, the longest of which is `window` [s]; `holds` 1 where a set (the
    unknown last) has a fault. Pure `init` and `step`."""

    limit: Float[np.ndarray, "windows"]
    window: Float[np.ndarray, ""]
    holds: Float[np.ndarray, "sets faults"]

    @staticmethod
    def of(bank: FaultBank) -> "Consistency":
        longest = np.max(bank.modes.windows) * bank.knowledge.memory
        return Consistency(bank.nis, np.asarray(longest), _holds(bank.sets, bank.modes.declared))

    def init(self) -> ConsistencyState:
        nothing = jnp.asarray(jnp.nan)
        return ConsistencyState(nothing, nothing, jnp.full(self.holds.shape[1], jnp.nan))

    def step(
        self, state: ConsistencyState, t: Float[Array, ""], said: BranchInfo
    ) -> tuple[ConsistencyState, BranchInfo]:
        """`said` at `t` [s], with all that sets without a lasting fault are likely by given to
        something undeclared while that is there: until it has not shown for as long as it has come
        and gone, a window at least."""
        lasted = jnp.maximum(state.last - state.first, self.window)
        on = t <= state.last + lasted
        now = jnp.any(said.nis > self.limit)
        first = jnp.where(on, state.first, jnp.where(now, t, jnp.nan))
        last = jnp.where(now, t, jnp.where(on, state.last, jnp.nan))
        likely = contract("s,sk->k", said.p, self.holds) >= LIKELY
        since = jnp.where(jnp.isnan(state.since), t, state.since)
        since = jnp.where(likely, since, jnp.nan)
        lasting = (t - since >= self.window) & (since <= first + self.window)
        told = jnp.any((self.holds > 0) & lasting, axis=1).at[0].set(True)
        lost = jnp.where((on | now) & ~told, said.p, 0.0)
        p = (said.p - lost).at[-1].add(jnp.sum(lost))
        return ConsistencyState(first, last, since), said._replace(p=p)


def _holds(sets: Sequence[tuple[int, ...]], faults: int) -> Float[np.ndarray, "sets faults"]:
    return np.array([[float(k in each) for k in range(faults)] for each in (*sets, ())])


def limit_of(nis: Float[np.ndarray, "samples windows"]) -> Float[np.ndarray, "windows"]:
    """The limits by what healthy logs show."""
    usual = np.median(nis, axis=0)
    return usual + BEYOND * (nis.max(axis=0) - usual)
