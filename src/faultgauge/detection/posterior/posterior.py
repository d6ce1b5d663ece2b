"""From the sets of faults to probabilities, estimates and intervals.

Every figure is of the one mixture over all sets: `p_<fault>` sums the sets that hold it, the
estimate is the mean (0 where the fault is absent), and the interval its 2.5 % and 97.5 %
quantiles, where an undeclared fault leaves each fault as uncertain as its prior.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.observers.branches import BranchInfo

__all__ = ["LIKELY", "TAIL", "WIDE", "Marginal", "Mixture", "Posterior", "mixture_quantiles"]

LIKELY = 0.5  # p of a fault from which on it is there rather than not
TAIL = 0.025  # on either side of a 95 % interval
WIDE = 1.959964  # standard deviations on either side of a 95 % interval
TURNS = 60  # of Newton's method at most: the worst of 20,000 mixtures drawn at random took 45
NARROW = 2.0**-37  # of where a quantile may lie: it is found
LIGHT = 1e-4  # weight below which a part of a mixture moves no 2.5 % quantile


class Posterior(NamedTuple):
    """Columns of one run (or one row), NaN where nothing was sampled; faults in the plant's order,
    NaN where they are disabled.

    `calm` is the probability that there is no active fault, `sd` the standard deviation of each
    fault if it is there, `seen` whether a fault of that direction (down, up) would show, `x`
    the posterior mean of [states, discrepancy, directions], `outside` what is not trusted (0:
    all is, see `envelope`), `held` whether a hold-off is on; `onset` how long ago each fault
    began if it is there (mean, standard deviation [s]), and the probability that it `ever` was.
    """

    p: Float[Any, "*samples faults"]
    f: Float[Any, "*samples faults"]
    lo: Float[Any, "*samples faults"]
    hi: Float[Any, "*samples faults"]
    healthy: Float[Any, "*samples"]
    unknown: Float[Any, "*samples"]
    calm: Float[Any, "*samples"]
    sd: Float[Any, "*samples faults"]
    seen: Bool[Any, "*samples faults two"]
    outside: Int[Any, "*samples"]
    x: Float[Any, "*samples extended"]
    onset: Float[Any, "*samples faults two"]
    ever: Float[Any, "*samples faults"]
    held: Bool[Any, "*samples"]

    @property
    def inside(self) -> Any:
        """Whether the model is trusted there."""
        return self.outside == 0


class Marginal(NamedTuple):
    """What the mixture says of each fault, and of there being none."""

    p: Float[Array, "faults"]
    f: Float[Array, "faults"]
    lo: Float[Array, "faults"]
    hi: Float[Array, "faults"]
    healthy: Float[Array, ""]
    unknown: Float[Array, ""]
    calm: Float[Array, ""]
    sd: Float[Array, "faults"]


class Mixture(eqx.Module):
    """`member` of each set (and of the unknown, last) are faults; `calm` are the sets without an
    active one; `size` is the widest prior of each fault, `low` and `high` its limits, `known` NaN
    where it is disabled and 1 elsewhere."""

    member: Float[np.ndarray, "faults sets"]
    calm: Float[np.ndarray, "sets"]
    size: Float[np.ndarray, "faults"]
    low: Float[np.ndarray, "faults"]
    high: Float[np.ndarray, "faults"]
    known: Float[np.ndarray, "faults"]

    @staticmethod
    def of(bank: FaultBank) -> "Mixture":
        faults, active = bank.model.plant.signals.faults, bank.with_monitor("active")
        member = [[float(k in each) for each in bank.sets] + [0.0] for k in range(len(faults))]
        calm = [float(not active[list(each)].any()) for each in bank.sets] + [0.0]
        return Mixture(
            np.array(member),
            np.array(calm),
            np.asarray(bank.size, float),
            np.array([fault.min for fault in faults]),
            np.array([fault.max for fault in faults]),
            np.array([np.nan if fault.monitor == "disabled" else 1.0 for fault in faults]),
        )

    def marginal(self, said: BranchInfo, seen: Bool[Array, "faults two"]) -> Marginal:
        """Of one row; a fault that would not be seen is as wide as its prior."""
        weight = self.member * said.p
        mean = jnp.clip(said.f.T, self.low[:, None], self.high[:, None])
        p, f = jnp.sum(weight, axis=1), jnp.sum(weight * mean, axis=1)
        undeclared, wide = said.p[-1], self.size[:, None]
        lo, hi = mixture_quantiles(
            jnp.concatenate([weight, jnp.broadcast_to(undeclared, wide.shape)], axis=1),
            jnp.concatenate([mean, jnp.zeros_like(wide)], axis=1),
            jnp.concatenate([said.sd.T, wide], axis=1),
        )
        blind = ~seen & (p < LIKELY)[:, None]
        lo, hi = self._no_narrower(lo, hi, blind[:, 0], blind[:, 1])
        there = jnp.maximum(p, 1e-300)
        square = jnp.sum(weight * (mean**2 + said.sd.T**2), axis=1) / there
        sd = jnp.sqrt(jnp.maximum(square - (f / there) ** 2, 0.0))
        # the mean of a mixture may lie outside
        columns = (p, f, jnp.minimum(lo, f), jnp.maximum(hi, f), sd)
        *columns, sd = (jnp.asarray(self.known * each) for each in columns)
        calm = jnp.sum(self.calm * said.p)
        return Marginal(*columns, healthy=said.p[0], unknown=undeclared, calm=calm, sd=sd)

    def untrusted(self, found: Marginal, where: Bool[Array, ""]) -> Marginal:
        """`found` with intervals as wide as the priors `where` the model is not trusted and no
        alarm that began before goes on: the network that was left may make up any fault."""
        lo, hi = self._no_narrower(found.lo, found.hi, where, where)
        return found._replace(lo=self.known * lo, hi=self.known * hi)

    def _no_narrower(self, lo: Array, hi: Array, below: Array, above: Array) -> tuple[Array, Array]:
        """The interval, as far as the prior reaches `below` and `above`, within the limits."""
        lo = jnp.where(below, jnp.minimum(lo, -WIDE * self.size), lo)
        hi = jnp.where(above, jnp.maximum(hi, WIDE * self.size), hi)
        return jnp.clip(lo, self.low, self.high), jnp.clip(hi, self.low, self.high)


def mixture_quantiles(
    weight: Float[Array, "many parts"],
    mean: Float[Array, "many parts"],
    sd: Float[Array, "many parts"],
) -> tuple[Float[Array, "many"], Float[Array, "many"]]:
    """(2.5 %, 97.5 %) quantiles of  sum_i w_i N(m_i, s_i^2), the rest being 0, by Newton's method
    between ends that close in on it."""
    counts = weight > LIGHT
    w, s = jnp.where(counts, weight, 0.0), jnp.maximum(sd, 1e-300)
    # the upper quantile is the lower one of the mirrored mixture
    m = jnp.stack([mean, -mean])
    at_zero = 1 - jnp.sum(w, axis=1)

    def under(x: Array) -> tuple[Array, Array]:
        """The mass of the parts below x, and its density there."""
        z = (m - x[..., None]) / s
        mass = jnp.sum(w * jax.lax.erfc(z / np.sqrt(2.0)), axis=-1) / 2
        return mass, jnp.sum(w * jnp.exp(-(z**2) / 2) / s, axis=-1) / np.sqrt(2 * np.pi)

    below, _ = under(jnp.zeros(m.shape[:2]))
    inside = (below < TAIL) & (below + at_zero >= TAIL)
    target = jnp.where(below >= TAIL, TAIL, TAIL - at_zero)
    low = jnp.minimum(jnp.min(jnp.where(counts, m - 9 * s, 0.0), axis=-1), 0.0)
    high = jnp.maximum(jnp.max(jnp.where(counts, m + 9 * s, 0.0), axis=-1), 0.0)
    narrow = NARROW * (high - low)
    # of one part alone this is the quantile
    first = jnp.sum(w * (m - WIDE * s), axis=-1) / jnp.maximum(jnp.sum(w, axis=1), LIGHT)

    def closer(at: _Search) -> _Search:
        mass, density = under(at.x)
        off = mass - target
        low, high = jnp.where(off < 0, at.x, at.low), jnp.where(off < 0, at.high, at.x)
        # a step is half as long as the last one at most, or the ends are halved
        newton = at.x - off / jnp.maximum(density, 1e-300)
        step = jnp.abs(newton - at.x)
        good = (newton > low) & (newton < high) & (2 * step <= at.moved)
        x = jnp.where(good, newton, (low + high) / 2)
        x = jnp.where(at.found, at.x, x)
        found = at.found | (high - low <= narrow) | (good & (step <= narrow))
        return _Search(x, low, high, jnp.abs(x - at.x), found)

    def turn(_: Int[Array, ""], at: _Search) -> _Search:
        return jax.lax.cond(jnp.all(at.found), lambda at: at, closer, at)

    # where nothing speaks of a fault, which is nearly always, all quantiles are 0
    start = _Search(jnp.clip(first, low, high), low, high, high - low, inside)
    x = jax.lax.fori_loop(0, TURNS, turn, start).x
    x = jnp.where(inside, 0.0, x * np.array([[1.0], [-1.0]]))
    return x[0], x[1]


class _Search(NamedTuple):
    """Of every quantile: the best guess, ends that it lies between, how far the guess last moved,
    and whether it is `found`."""

    x: Float[Array, "two many"]
    low: Float[Array, "two many"]
    high: Float[Array, "two many"]
    moved: Float[Array, "two many"]
    found: Bool[Array, "two many"]
