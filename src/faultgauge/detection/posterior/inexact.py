"""What follows for the posterior from a model whose answer to what acts on the plant is off.

A fault that acts on the plant is answered for with an error of a share of all it does, and within
that of a share of its size: `shape` and `gain` (`fidelity`). So

- no size f is surer than  gain |f|;
- what a large fault does is in part taken for a second one beside it. With z_i = f_i / sd_i how
  clearly each fault of a set shows, the second is made up with a standard deviation of

      e_k = shape sqrt(sum_i!=k z_i^2)    (in units of its own sd)

  where the error looks like it in all, and is there itself with  s_k = size_k / sd_k:

      ln p(real) / p(made up) = ln c + ln N(z; 0, 1 + e^2 + s^2) / N(z; 0, 1 + e^2)
                                - ln (e^2 / (1 + e^2)),

  c being how often one fault brings another (`real_odds`). As much of the set as is made up
  belongs to the set without that fault. No plant answers at once: what the first sample of
  a fault told is made up by no more than the others do within a sample, and is told against that
  (`told_at_once`), with J_i the info of a unit of fault i in the first sample after it and

      e_k^2 = shape^2 sum_i!=k f_i^2 J_i;

  nor does a fault make up what had been `told` of another before it came;

- what one fault leaves unexplained may be the error of what it explains. Of sets that have as many
  faults that act and the same ones of sensors, ln of how much less likely one is than the best is
  divided, in what is said of such `rivals`, by

      1 + shape^2 sum_i z_i^2 / others,

  i being its own faults, and the error looking like each of the `others` that act in equal parts;

- what constants and slow errors were told amid a large fault is off when it goes, and in part taken
  for a rest of it. Of a fault that was at least `most` once, a rest is made up likewise, with

      e_k = gain (most_k - |f_k|) / sd_k.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.observers.branches import BranchInfo
from faultgauge.observers.recoveries import real_odds, told_at_once
from faultgauge.plants.signals import Fault

__all__ = ["Inexact", "acting", "sets_with", "without"]

TINY = 1e-300  # no division by 0


class Inexact(eqx.Module):
    """`holds` 1 where a set (the unknown last) has a fault; `sources` of each fault the set with it
    on top of each set, -1 where there is none; `acts` 1 for the faults that act on the plant and
    not on a sensor alone; `size` the widest prior of each, `common` the share of onsets that bring
    a second fault; `rival_sets` those whose faults may be taken for each other, and `others` how
    many other faults act."""

    holds: Float[np.ndarray, "sets faults"]
    acts: Float[np.ndarray, "faults"]
    size: Float[np.ndarray, "faults"]
    common: Float[np.ndarray, ""]
    shape: Float[np.ndarray, ""]
    gain: Float[np.ndarray, ""]
    sources: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    rival_sets: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    others: int = eqx.field(static=True)

    @staticmethod
    def of(bank: FaultBank) -> "Inexact":
        faults = bank.model.plant.signals.faults
        holds, sources = sets_with(bank)
        return Inexact(
            holds,
            acting(faults),
            np.asarray(bank.size, float),
            np.asarray(bank.modes.prior.common),
            np.asarray(bank.shape),
            np.asarray(bank.gain),
            sources,
            _rival_sets(bank.sets, acting(faults)),
            max(int(np.sum(acting(faults))) - 1, 1),
        )

    def told(self, said: BranchInfo) -> BranchInfo:
        """`said` by branches that take the model's answer for exact."""
        by_others, by_itself = self._errors(said)
        at_once = self._at_once(said)
        made_up = self.holds * (1 - self._real(said, by_others + by_itself, at_once))
        never = self.holds * (1 - self._real(said, by_others, at_once))  # a rest of one was there
        p, f, variance, ever = said.p, said.f, said.sd**2, said.ever
        for k in range(len(self.acts)):
            ever = ever.at[k].add(-jnp.sum(p * never[:, k]))
            p, f, variance = without(p, f, variance, p * made_up[:, k], self.sources[k])
        return said._replace(p=p, f=f, sd=jnp.sqrt(variance), ever=jnp.maximum(ever, 0.0))

    def unsure(self, said: BranchInfo) -> BranchInfo:
        """`said` with sizes no surer than the model's answer is."""
        return said._replace(sd=jnp.sqrt(said.sd**2 + (self.gain * self.acts * said.f) ** 2))

    def rivals(self, said: BranchInfo) -> Float[Array, "sets"]:
        """p of the sets by which rivals are told: that of the docstring above."""
        sd2 = jnp.maximum(said.sd**2 - (self.gain * self.acts * said.f) ** 2, TINY)
        z2 = jnp.sum(jnp.where(self.holds > 0, said.f**2 / sd2, 0.0) * self.acts, axis=1)
        times, p = 1 + jnp.multiply(self.shape**2 / self.others, z2), said.p
        log = jnp.log(jnp.maximum(p, TINY))
        for each in self.rival_sets:
            own = np.isin(np.arange(len(self.holds)), each)
            top = jnp.max(jnp.where(own, log, -jnp.inf))
            likely = jnp.where(own, jnp.exp(jnp.minimum(log - top, 0.0) / times), 0.0)
            share = jnp.sum(jnp.where(own, p, 0.0)) / jnp.sum(likely)
            p = jnp.where(own, share * likely, p)
        return p

    def _errors(
        self, said: BranchInfo
    ) -> tuple[Float[Array, "sets faults"], Float[Array, "sets faults"]]:
        """e^2 by the other faults of each set, and by what each fault was once."""
        sd2 = jnp.maximum(said.sd**2, TINY)
        acting = jnp.where(self.holds > 0, said.f**2 / sd2, 0.0) * self.acts
        others = jnp.sum(acting, axis=1, keepdims=True) - acting
        gone = jnp.maximum(said.most - jnp.abs(said.f), 0.0) ** 2 / sd2
        return jnp.multiply(self.shape**2, others), jnp.multiply(self.acts * self.gain**2, gone)

    def _at_once(self, said: BranchInfo) -> Float[Array, "sets faults"]:
        """What the others do not make up: what the first sample of each told, and what had been
        told of it before another came."""
        acting = self.holds * said.f**2 * said.quick * self.acts
        others = jnp.sum(acting, axis=1, keepdims=True) - acting
        e2 = jnp.multiply(self.shape**2, others)
        told = told_at_once(said.sudden, said.sharp, said.f, said.sd**2, e2)
        # of what is left of a fault as much as it counts itself
        left = (jnp.abs(said.f) / jnp.maximum(said.most, jnp.abs(said.f) + TINY)) ** 2
        return jnp.maximum(told, left * said.told)

    def _real(
        self,
        said: BranchInfo,
        e2: Float[Array, "sets faults"],
        at_once: Float[Array, "sets faults"],
    ) -> Float[Array, "sets faults"]:
        """How likely each fault of a set is there, and not made up."""
        sd2 = jnp.maximum(said.sd**2, TINY)
        z2 = jnp.where(self.holds > 0, said.f**2 / sd2, 0.0)
        s2 = self.size**2 / sd2
        odds = real_odds(z2, jnp.asarray(s2), e2, jnp.asarray(self.common)) + at_once
        return jnp.where(e2 > TINY, jax.nn.sigmoid(odds), 1.0)


def sets_with(
    bank: FaultBank,
) -> tuple[Float[np.ndarray, "sets faults"], tuple[tuple[int, ...], ...]]:
    """1 where a set, the unknown last, has a fault; and of each fault the set with it on top of
    each set, -1 where there is none."""
    sets, faults = (*bank.sets, ()), range(len(bank.onset))
    sources = tuple(
        tuple(-1 if k in each else row[k] for each, row in zip(sets, bank.modes.more, strict=True))
        for k in faults
    )
    return np.array([[float(k in each) for k in faults] for each in sets]), sources


def without(
    p: Float[Array, "sets"],
    f: Float[Array, "sets faults"],
    variance: Float[Array, "sets faults"],
    moved: Float[Array, "sets"],
    sources: tuple[int, ...],
) -> tuple[Float[Array, "sets"], Float[Array, "sets faults"], Float[Array, "sets faults"]]:
    """Probabilities, sizes and variances of the sets when as much as is `moved` of each belongs to
    the set without one fault, whose `sources` these are."""
    source = np.array(sources)
    comes = jnp.where(source >= 0, moved[source], 0.0)
    p = p - moved + comes
    w = jnp.where(comes > 0, comes / jnp.maximum(p, TINY), 0.0)[:, None]
    apart = f[source] - f
    mixed = (1 - w) * variance + w * variance[source] + w * (1 - w) * apart**2
    return p, f + w * apart, mixed


def _rival_sets(
    sets: Sequence[tuple[int, ...]], acts: Float[np.ndarray, "faults"]
) -> tuple[tuple[int, ...], ...]:
    """The sets that have as many faults that act on the plant, and the same ones of sensors."""
    found = dict[tuple[int, tuple[int, ...]], list[int]]()
    for k, each in enumerate(sets):
        count = int(sum(acts[fault] for fault in each))
        if count:
            others = tuple(fault for fault in each if not acts[fault])
            found.setdefault((count, others), []).append(k)
    return tuple(tuple(own) for own in found.values() if len(own) > 1)


def acting(faults: Sequence[Fault]) -> Float[np.ndarray, "faults"]:
    """1 for those that act on the plant: what a sensor's own fault shows is known exactly."""
    return np.array([float(fault.acts) for fault in faults])
