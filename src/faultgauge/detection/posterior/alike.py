"""What follows for the posterior from faults that no data tell apart.

Two faults that the plant file lets act in the same way (`equal_faults`) may still leave the bank
with a name: where calibration found a lag that the file lacks, it stands at an input or at a
sensor, as healthy logs like it, and a bias of that input then comes a little later than a push on
the state behind it. Nobody knows whether it does. So sets that differ in nothing but such faults
share what is said of them: each is as likely as the others, and has the size that does the same,
unless its limits leave that out.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from faultgauge.detection.bank.sets import Set
from faultgauge.observers.branches import BranchInfo
from faultgauge.plants.signals import Fault
from faultgauge.products import contract

__all__ = ["Alike"]

TINY = 1e-300  # no division by 0
BEYOND = 2.0  # standard deviations outside of its limits: that fault it is not


class _Sources(NamedTuple):
    """Of every set (the unknown last) the sets that say the same, itself among them: whether there
    is one, which, and for every fault of the set which fault of that one it stands for, and by how
    much its size is the larger."""

    there: Bool[np.ndarray, "sets most"]
    sets: Int[np.ndarray, "sets most"]
    faults: Int[np.ndarray, "sets most faults"]
    times: Float[np.ndarray, "sets most faults"]


class Alike(eqx.Module):
    """`sets` of faults (the unknown, last, holds none); `first` of those that each fault is like,
    and the `size` of it that does what 1 of that does; `low` and `high` its limits."""

    low: Float[np.ndarray, "faults"]
    high: Float[np.ndarray, "faults"]
    sets: tuple[Set, ...] = eqx.field(static=True)
    first: tuple[int, ...] = eqx.field(static=True)
    size: tuple[float, ...] = eqx.field(static=True)

    @staticmethod
    def of(
        faults: Sequence[Fault], sets: tuple[Set, ...], alike: Sequence[tuple[int, int, float]]
    ) -> "Alike":
        """`alike` are two faults that no data tell apart, and how many units of the second do what
        one of the first does."""
        low, high = np.array([(fault.min, fault.max) for fault in faults], float).T
        return Alike(low, high, (*sets, ()), *_groups(len(faults), alike))

    def told(self, said: BranchInfo) -> BranchInfo:
        """`said`, shared among sets of faults that are alike."""
        if len({*self.first}) == len(self.first):
            return said
        there, sets, faults, times = _sources(self.sets, self.first, self.size)
        count = np.arange(len(self.first))
        holds = np.array([np.isin(count, each) for each in self.sets], float)
        f = times * said.f[sets[:, :, None], faults]
        sd = np.abs(times) * said.sd[sets[:, :, None], faults]
        p = jnp.where(there, said.p[sets], 0.0)
        total = jnp.sum(p, axis=1)
        w = (p / jnp.maximum(total, TINY)[:, None])[:, :, None]
        mean = jnp.sum(w * f, axis=1)
        spread = jnp.sqrt(jnp.maximum(jnp.sum(w * (sd**2 + f**2), axis=1) - mean**2, 0.0))
        mean = jnp.where(total[:, None] > 0, mean, said.f)
        spread = jnp.where(total[:, None] > 0, spread, said.sd)
        room = BEYOND * spread
        out = (holds > 0) & ((mean + room < self.low) | (mean - room > self.high))
        legal = ~jnp.any(out, axis=1)
        among = jnp.sum(jnp.where(there, legal[sets], False), axis=1)
        share = jnp.where(among > 0, legal * total / jnp.maximum(among, 1), said.p)
        there_now = contract("s,sk->k", share, holds)
        same = jnp.asarray(np.equal.outer(self.first, self.first), float)
        return said._replace(
            p=share,
            f=mean,
            sd=spread,
            # as likely as any of them ever was; at least what is there now
            ever=jnp.maximum(
                contract("ij,j->i", same / jnp.sum(same, axis=1), said.ever), there_now
            ),
            onset=_onset(same * contract("s,sk->k", said.p, holds), said.onset),
        )


def _onset(
    p: Float[Array, "faults faults"], onset: Float[Array, "faults two"]
) -> Float[Array, "faults two"]:
    """When one of those that are alike began, which have the probabilities `p`."""
    total = jnp.sum(p, axis=1)
    w = p / jnp.maximum(total, TINY)[:, None]
    when, sd = jnp.nan_to_num(onset).T  # of a fault that is not there
    mean = contract("ij,j->i", w, when)
    square = contract("ij,j->i", w, sd**2 + when**2)
    spread = jnp.sqrt(jnp.maximum(square - mean**2, 0.0))
    return jnp.where(total[:, None] > 0, jnp.stack([mean, spread], axis=1), onset)


def _groups(
    count: int, alike: Sequence[tuple[int, int, float]]
) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """The first of those that are like each fault, and the size that does what 1 of that does."""
    first, size = [*range(count)], [1.0] * count
    for one, other, by in sorted(alike):
        if first[other] == other:
            first[other], size[other] = first[one], size[one] * by
    return (*first,), (*size,)


def _sources(sets: tuple[Set, ...], first: tuple[int, ...], size: tuple[float, ...]) -> _Sources:
    kinds = [tuple(sorted(first[k] for k in each)) for each in sets]
    whole = [len(set(kind)) == len(kind) and s < len(sets) - 1 for s, kind in enumerate(kinds)]
    same = [
        [r for r in range(len(sets)) if r == s or (whole[s] and whole[r] and kinds[r] == kinds[s])]
        for s in range(len(sets))
    ]
    most = max(map(len, same))
    shape = (len(sets), most)
    there, which = np.zeros(shape, bool), np.zeros(shape, int)
    faults = np.tile(np.arange(len(first)), (*shape, 1))
    times = np.ones((*shape, len(first)))
    for s, others in enumerate(same):
        for m, r in enumerate(others):
            there[s, m], which[s, m] = True, r
            for k in sets[s]:
                j = k if r == s else next(j for j in sets[r] if first[j] == first[k])
                faults[s, m, k], times[s, m, k] = j, size[k] / size[j]
    return _Sources(there, which, faults, times)
