"""What the branches, and the changes that may have been beside each, say together of one sample."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from faultgauge.observers.branches import BranchInfo, BranchState, Changes, Sums
from faultgauge.observers.divided_difference import Belief, FilterNoise
from faultgauge.observers.recoveries import Recoveries
from faultgauge.observers.rows import where_needed
from faultgauge.products import contract

__all__ = ["TRIFLE", "Answers"]

TRIFLE = 5e-3  # of the likeliest onset, or change: one that moves no 95 % interval


class Answers(Recoveries):
    """The posterior of sets and faults, by all branches and all that may have changed. `noise` is
    that of the branches and, behind them, of the unknown ones; how well branches fit is told in
    `windows`, so many times the `memory` [s]."""

    noise: FilterNoise
    memory: Float[Array, ""]
    windows: Float[np.ndarray, "windows"]

    @property
    def filters(self) -> int:
        return len(self.noise.sigma)

    def _info(self, state: BranchState, changes: Changes) -> BranchInfo:
        F, n, d, at = self.filter.faults, self.filter.states, self.declared, slice(self.branches)
        top = jnp.max(state.weight[at, None] + changes.top)
        log = state.weight - jnp.maximum(top, jnp.max(state.weight))
        alone, own = jnp.exp(log), jnp.eye(len(self.more))[state.which]
        # an old change of which nothing is known is unlikely, but so wide that with moments it
        # would speak for its whole set
        to, _ = self._leads(state.which[at])
        peaks = jnp.exp(log[at, None] + changes.top)
        most = jnp.maximum(
            jnp.max(peaks[:, :, None] * to, axis=(0, 1)), jnp.max(alone[:, None] * own, axis=0)
        )
        parts = state.belief, log, state.which, state.since, state.ever
        parts = *parts, (state.sudden, state.sharp, state.told)
        given = (
            jax.tree.map(lambda a: a[at], parts),
            changes,
            state.lanes,
            TRIFLE * contract("bks,s->bk", to, most),
        )
        _, each = where_needed(partial(self._summed, state.t), self._alive(state), (), given)
        # and what has not changed
        heavy = (alone > TRIFLE * contract("is,s->i", own, most))[:, None] * own
        f0 = state.belief.mean[:, None, n : n + F]
        v0 = jnp.diagonal(state.belief.P, axis1=1, axis2=2)[:, None, n : n + F]
        same = Sums(
            own,
            heavy,
            heavy[:, :, None] * f0,
            heavy[:, :, None] * (f0**2 + v0),
            heavy[:, :, None] * state.sudden[:, None],
            heavy[:, :, None] * state.sharp[:, None],
            heavy[:, :, None] * state.told[:, None],
            state.belief.mean[:, :n],
            jnp.zeros((self.filters, d, 3)),
            state.ever[:, :d],
        )
        p, held, mean, square, sudden, sharp, told, x, past, ever = (
            jnp.sum(a, axis=0) + jnp.sum(jax.vmap(jnp.multiply)(alone, b), axis=0)
            for a, b in zip(each, same, strict=True)
        )
        Z = jnp.sum(p)
        p, x, ever = p / Z, x / Z, ever / Z
        held = jnp.maximum(held, 1e-300)[:, None]
        mean, square = mean / held, square / held
        sd = jnp.sqrt(jnp.maximum(square - mean**2, 0.0))
        seen = jnp.max(state.probe.J, axis=2) * self.prior.size[:d, None] ** 2
        there, first, second = past.T
        there = jnp.maximum(there, 1e-300)
        first, second = first / there, second / there
        late = jnp.sqrt(jnp.maximum(second - first**2, 0.0))
        onset = jnp.stack([state.t - first, late], axis=1)
        most = state.most[jnp.argmax(state.weight), :d]
        sudden, sharp, told = (each[:, :d] / held for each in (sudden, sharp, told))
        rest = onset, ever, most, sudden, sharp, told, state.quick
        alien = alone[self.branches :] / Z
        return BranchInfo(p, mean[:, :d], sd[:, :d], x, seen, *rest, alien, *self._fits(state))

    def _fits(self, state: BranchState) -> tuple[Float[Array, "windows"], Float[Array, ""]]:
        """How badly the likeliest branch fits, and whether it has a fault."""
        outputs = len(self.filter.plant.signals.outputs)
        usual = outputs * self.windows * self.memory / self.filter.step_s
        lead = jnp.argmax(state.weight[: self.branches])
        return state.nis[lead] / usual, jnp.where(state.which[lead] > 0, 1.0, 0.0)

    def _leads(
        self, which: Int[Array, "branches"]
    ) -> tuple[Float[Array, "branches kinds sets"], Int[Array, "branches kinds"]]:
        """(1 where a change leads to a set, its number, -1 where there is none)."""
        target = jnp.concatenate([jnp.array(self.more), jnp.array(self.less)], axis=1)[which]
        legal = (target >= 0)[:, :, None]
        return jnp.eye(len(self.more))[jnp.maximum(target, 0)] * legal, target

    def _summed(
        self, t: Float[Array, ""], nothing: tuple[()], given: tuple
    ) -> tuple[tuple[()], Sums]:
        """`given` are the belief, ln of the weight, the set, since when, whether ever, and the
        first samples of each branch and what had been told; its changes; its lanes; what an onset
        of each kind must weigh to count."""
        (belief, log, which, since, ever, firsts), changes, lanes, least = given
        F, n, K, d = self.filter.faults, self.filter.states, self.kinds, self.declared
        to, target = self._leads(which)
        each = jnp.exp(log[:, None] + changes.total)
        w = changes.share * each[:, :, None]
        eta = lanes.eta[:, n : n + F]
        eta = jnp.concatenate([eta, eta[:, :, :F]], axis=2)
        f = belief.mean[:, n : n + F, None, None] + eta * changes.f[:, None]
        v = jnp.diagonal(belief.P, axis1=1, axis2=2)[:, n : n + F, None, None]
        v = v + eta**2 * changes.V[:, None]
        gone = np.zeros((F, K + F))
        gone[range(F), K + np.arange(F)] = 1.0
        f, v = (jnp.where(gone[None, :, :, None] > 0, 0.0, a) for a in (f, v))
        heavy = jnp.where(w > least[:, :, None], w, 0.0)
        p = contract("bk,bks->bs", each, to)
        held = contract("bk,bks->bs", jnp.sum(heavy, axis=2), to)
        mean = contract("bfk,bks->bsf", jnp.sum(heavy[:, None] * f, axis=3), to)
        square = contract("bfk,bks->bsf", jnp.sum(heavy[:, None] * (f**2 + v), axis=3), to)
        shift = contract("bka,bnka->bn", w[:, :K] * changes.f[:, :K], lanes.eta[:, :n])
        x = jnp.sum(each, axis=1)[:, None] * belief.mean[:, :n] + shift
        # since when: a change of what is there already begins nothing
        holds = (np.array(self.less) >= 0).astype(float)[:, :d]
        own = np.zeros((K + F, d))
        own[range(K)] = np.eye(F)[self.owner, :d]
        there = jnp.asarray(holds)[jnp.maximum(target, 0)] * (target >= 0)[:, :, None]
        here = jnp.asarray(holds)[which]
        begins = own * (1 - here[:, None])
        old = jnp.sum(each[:, :, None] * there * (1 - begins), axis=1)
        old = old + jnp.exp(log)[:, None] * here
        sudden, sharp, told = (
            contract("bfk,bks->bsf", self._of_first(belief, own, heavy, new), to)
            for own, new in zip(firsts, (lanes.sudden, lanes.sharp, 0 * lanes.sharp), strict=True)
        )
        first, spread = since[:, :d, 0], since[:, :d, 1]
        then = jnp.stack([jnp.ones_like(old), first, spread + first**2], axis=2)
        when, new = lanes.onset, w[:, :K]
        dates = jnp.stack([new, new * when, new * (when**2 + self._blur(t, lanes))], axis=3)
        past = contract("bkt,bkf->bft", jnp.sum(dates, axis=2), begins[:, :K])
        past = past + old[:, :, None] * then
        ever = jnp.sum(each[:, :, None] * jnp.maximum(ever[:, None, :d], own), axis=1)
        return (), Sums(p, held, mean, square, sudden, sharp, told, x, past, ever)

    def _of_first(
        self, belief: Belief, own: Array, heavy: Array, lanes: Array
    ) -> Float[Array, "branches faults changes"]:
        """The `own` score, or info, of the first sample of each fault after each change, times how
        likely that is: of one that begins by the change, that of its `lanes`."""
        F, K = self.filter.faults, self.kinds
        begins = np.zeros((F, K + F))
        begins[self.owner, range(K)] = 1.0
        new = begins[None] * ~self._present(belief)[:, :, None]
        first = jnp.sum(heavy[:, :K] * lanes, axis=2)
        first = jnp.concatenate([first, jnp.zeros((len(first), F))], axis=1)[:, None]
        return (
            jnp.multiply(new, first) + (1 - new) * own[:, :, None] * jnp.sum(heavy, axis=2)[:, None]
        )
