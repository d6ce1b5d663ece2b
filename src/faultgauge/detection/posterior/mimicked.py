"""Of what looks like a fault, how much healthy logs show too.

Where the model errs in a way that none of its noise is, and in the direction of a fault k, healthy
logs look as if that were there, for a moment or for good: at an age a, with sizes m_k(a) (one
standard deviation, its `mimicked` size). What it errs is part of any later log, too: a size f_k,
known to v_k, is made up or real,

    ln p(real) / p(made up) = ln c_k + ln N(f_k; 0, v_k + m_k^2 + s_k^2) / N(f_k; 0, v_k + m_k^2)
                              - ln (m_k^2 / (v_k + m_k^2)),

s_k being its widest prior and c_k how often it begins in as long as the healthy logs are, which
show what the model errs. As much of a set as is made up belongs to the set without that fault, and
the size of one that is real is known to v_k + m_k^2. No other fault is any less clear for it.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.posterior.inexact import sets_with, without
from faultgauge.observers.branches import BranchInfo
from faultgauge.observers.recoveries import real_odds

__all__ = ["Mimicked", "least_real"]

EXACT = 1e-12  # of the variance of a fault's widest size: no division by 0


class Mimicked(eqx.Module):
    """`holds` 1 where a set (the unknown last) has a fault; `sources` of each fault the set with it
    on top of each set, -1 where there is none; `size` the widest prior of each and `m` the size
    that healthy logs show of it before each of `ends` of its age [s], and behind the last;
    `common` how often it begins in as long as they are; `any_` whether they show any."""

    holds: Float[np.ndarray, "sets faults"]
    size: Float[np.ndarray, "faults"]
    m: Float[np.ndarray, "faults ages"]
    ends: Float[np.ndarray, "ends"]
    common: Float[np.ndarray, "faults"]
    sources: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    any_: bool = eqx.field(static=True)

    @staticmethod
    def of(bank: FaultBank) -> "Mimicked":
        holds, sources = sets_with(bank)
        return Mimicked(
            holds,
            np.asarray(bank.size, float),
            bank.mimicked,
            bank.until,
            bank.onset * bank.healthy,
            sources,
            bool(bank.mimicked.any()),
        )

    def told(self, said: BranchInfo) -> BranchInfo:
        """`said` by branches that take all that looks like a fault for one."""
        if not self.any_:
            return said
        p, f, variance, ever = said.p, said.f, said.sd**2, said.ever
        m = self.at(said.onset[:, 0])
        for k in range(len(self.size)):
            odds = self.odds(k, f[:, k], variance[:, k], m[k])
            made_up = self.holds[:, k] * (1 - jax.nn.sigmoid(odds))
            ever = ever.at[k].add(-jnp.sum(p * made_up))
            p, f, variance = without(p, f, variance, p * made_up, self.sources[k])
        variance = variance + self.holds * m**2
        return said._replace(p=p, f=f, sd=jnp.sqrt(variance), ever=jnp.maximum(ever, 0.0))

    def at(self, ages: Float[Any, "*rows faults"]) -> Float[Array, "*rows faults"]:
        """The sizes that healthy logs show of faults of such `ages` [s]."""
        behind = jnp.sum(jnp.asarray(ages)[..., None] >= self.ends, axis=-1)
        return jnp.asarray(self.m)[np.arange(len(self.m)), behind]

    def odds(
        self,
        k: int,
        f: Float[Any, "*f"],
        variance: Float[Any, "*variance"],
        m: Float[Any, "*m"],
    ) -> Float[Array, "*all"]:
        """ln p(real) / p(made up) of fault `k`, told as `f` with this `variance` where healthy logs
        show `m` [its unit]."""
        f, v, m = jnp.broadcast_arrays(f, jnp.maximum(variance, EXACT * self.size[k] ** 2), m)
        z2, s2, e2 = (each / v for each in (f**2, self.size[k] ** 2, m**2))
        return real_odds(z2, s2, e2, jnp.asarray(self.common[k]))


def least_real(bank: FaultBank, fault: int, sd: float, level: float, age: float) -> float:
    """The size [its unit] from which on a fault of an `age` [s] that is known to `sd` is real, and
    not made up, with log-odds of `level`: the above solved for f_k. 0 where healthy logs show
    nothing like it."""
    m2 = float(bank.mimicked[fault, np.sum(age >= bank.until)]) ** 2
    if not m2:
        return 0.0
    s2 = float(bank.size[fault]) ** 2
    own = sd**2 + m2
    rare = np.log(bank.onset[fault] * bank.healthy)
    needed = level - rare + np.log1p(s2 / own) / 2 + np.log(m2 / own)
    return float(np.sqrt(2 * max(needed, 0.0) * own * (1 + own / s2)))
