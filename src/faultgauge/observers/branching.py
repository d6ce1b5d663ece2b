"""The posterior over which faults there are and when they began.

A branch is a nonlinear filter with the faults of one set in its state. Beside it runs the evidence
of one more change of every fault (`onsets`). A change that becomes likelier than none is promoted
to a branch of its own (of a fault that is there, in place of its branch, when nothing else is left
of that), which inherits all other signatures less what the promoted one explains of
them (the Schur complement of J).

Beside the branches run unknown ones: filters whose discrepancy, or the noise of one sensor, is far
beyond the learned one, from some onsets on.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import logsumexp
from jaxtyping import Array, Bool, Float, Int

from faultgauge.observers.answers import TRIFLE, Answers
from faultgauge.observers.branches import (
    NEVER,
    SCALES,
    BranchInfo,
    BranchState,
    Changes,
    Lanes,
    Probe,
)
from faultgauge.observers.divided_difference import Belief, FilterNoise, Flow, Look, Seen
from faultgauge.observers.onsets import CLEAR
from faultgauge.observers.rows import where_needed
from faultgauge.products import contract

__all__ = ["Branching"]

KEPT = 1e-9  # of all probability: a branch below may go
PROMOTED = 0.0  # log-odds of a change against none, within its branch
HOPELESS = 745.0  # nats behind the likeliest branch: a probability that is no number


class Branching(Answers):
    """The bank over any plant; pure `init` and `step`.

    `alien` is the variance that each unknown branch begins with, on top, and `ages` how many times
    as long as the `memory` it is kept where it explains nothing. Healthy is the first set, unknown
    the last.
    """

    alien: Float[Array, "unknown n n"]
    ages: Float[np.ndarray, "unknown"]
    own: Float[Array, "states"]
    recall: Float[Array, "faults"]

    def init(
        self, x: Float[Array, "states"], sd: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> BranchState:
        """Start at state `x` +- `sd`: healthy, or with a fault that is older than the log."""
        one = self.filter.begin(x, sd)
        n, B = len(one.mean), self.branches
        belief = jax.tree.map(lambda a: jnp.broadcast_to(a, (self.filters, *a.shape)), one)
        weight = jnp.where(jnp.arange(self.filters) == 0, 0.0, NEVER)
        which = jnp.where(jnp.arange(self.filters) < B, 0, len(self.more) - 1)
        K, A = self.kinds, self.onsets
        eta = np.zeros((n, K, A))
        eta[self.slots, range(K), -1] = 1.0
        never = jnp.full((K, A - 1), NEVER)
        mass = jnp.concatenate([never, self.prior.first[:, None]], axis=1)
        none = jnp.zeros((B, K, A))
        lanes = Lanes(
            jnp.broadcast_to(eta, (B, n, K, A)),
            none,
            none,
            jnp.zeros((B, len(SCALES), K, A)),
            none,
            none,
            none,
            jnp.zeros((B, K * A, K * A)),
            jnp.broadcast_to(np.arange(K * A).reshape(K, A), (B, K, A)),
            jnp.broadcast_to(mass, (B, K, A)),
            none,
            none,
        )
        d = self.declared
        probe = Probe(jnp.zeros((n, d, 2, 2)), jnp.zeros((d, 2, 2)), self.recall)
        since = jnp.zeros((self.filters, self.filter.faults, 2))
        begun = jnp.zeros(self.filters)
        none = jnp.zeros((self.filters, self.filter.faults))
        told = none, none, none, none, none, jnp.zeros(self.declared)
        nis = jnp.zeros((self.filters, len(self.windows)))
        return BranchState(
            belief, weight, which, since, *told, begun, nis, lanes, probe, u, jnp.zeros(())
        )

    def step(
        self,
        state: BranchState,
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
        dt: Float[Array, ""],
    ) -> tuple[BranchState, BranchInfo]:
        """One sample: `u` and `y` (NaN: not sampled) now, `dt` s after the last."""
        t = state.t + dt

        def one(belief: Belief, noise: FilterNoise) -> tuple:
            after, *said = self.filter.step(belief, noise, state.u, u, y, dt)
            return after, said

        alive, B = state.weight > NEVER / 2, self.branches
        belief, said = where_needed(jax.vmap(one), alive, state.belief, self.noise)
        likelihood, flow, look, seen = said
        weight = state.weight + likelihood + self._kept_within(state.belief, belief)
        weight = jnp.maximum(weight - jnp.max(weight), NEVER)
        hopeless = (jnp.arange(len(weight)) < B) & (weight < jnp.max(weight[:B]) - HOPELESS)
        weight = jnp.where(hopeless, NEVER, weight)
        parts = tuple(jax.tree.map(lambda a: a[:B], part) for part in (flow, look, seen))
        lanes, _ = where_needed(self._signatures, alive[:B], state.lanes, parts)
        lead = jnp.argmax(weight[: self.branches])
        leading = _at(flow, lead), _at(look, lead), _at(seen, lead)
        probe = self._probed(state.probe, *leading, dt)
        quick = lanes.info[lead, : self.declared, -1]
        state = state._replace(
            belief=belief,
            weight=weight,
            most=jnp.maximum(state.most, self._clearly(belief)),
            quick=jnp.where(quick > 0, quick, state.quick),  # a row without samples tells none
            nis=state.nis * jnp.exp(-dt / (self.windows * self.memory))
            + jnp.sum(seen.white**2, axis=1)[:, None],
            lanes=lanes,
            probe=probe,
            u=u,
            t=t,
        )
        changes = self._changes(state)
        info = self._info(state, changes)
        state, ell = self._promoted(state, changes)
        opened = partial(self._opened, t, dt)
        given = ell, self._begun(u, state.belief)
        lanes, _ = where_needed(opened, self._alive(state), state.lanes, given)
        return self._alien(state._replace(lanes=lanes)), info

    def _probed(self, probe: Probe, flow: Flow, look: Look, seen: Seen, dt: Array) -> Probe:
        """The signatures of every fault since two onsets, of which the earlier one is its `recall`
        to twice that ago: a fault may show at once or by what it does since, so that no mean over
        onsets tells how clearly."""
        n, F = self.filter.states, self.declared
        sides = jnp.stack([flow.down, flow.up], axis=2)[:, :F, :, None]
        shown = jnp.stack([look.down, look.up], axis=2)[:, :F, :, None]
        eta = contract("ij,jfsa->ifsa", flow.A[:n, :n], probe.eta[:n]) + sides
        J = probe.J
        for j in range(len(seen.white)):
            g = contract("n,nfsa->fsa", look.C[j, :n], eta) + shown[j]
            J = J + (g / seen.root[j]) ** 2
            g = jnp.where(jnp.isfinite(seen.root[j]), g, 0.0)
            eta = eta - seen.gain[j, :n, None, None, None] * g
        age = probe.age + dt
        due = age >= self.recall
        later = jnp.stack([eta[..., 1], jnp.zeros_like(eta[..., 1])], axis=-1)
        eta = jnp.where(due[:, None, None], later, eta)
        later = jnp.stack([J[..., 1], jnp.zeros_like(J[..., 1])], axis=-1)
        J = jnp.where(due[:, None, None], later, J)
        rest = jnp.zeros((probe.eta.shape[0] - n, F, 2, 2))
        return Probe(jnp.concatenate([eta, rest]), J, jnp.where(due, 0.0, age))

    def _clearly(self, belief: Belief) -> Float[Array, "filters faults"]:
        """How large each fault is at least; 0 of one that is not there."""
        at = slice(self.filter.states, self.filter.states + self.filter.faults)
        sd = jnp.sqrt(jnp.maximum(jnp.diagonal(belief.P, axis1=1, axis2=2)[:, at], 0.0))
        return jnp.maximum(jnp.abs(belief.mean[:, at]) - CLEAR * sd, 0.0)

    # -- promotion

    def _promoted(
        self, state: BranchState, changes: Changes
    ) -> tuple[BranchState, Float[Array, "branches kinds onsets"]]:
        """The likeliest change that is likelier than none, in a branch of its own; and how likely
        each onset is beside every branch."""
        B, K = self.branches, changes.total.shape[1]
        after = state.weight[:B, None] + changes.total
        # a change within a set takes the place of its branch, once all that might be there instead
        # is a trifle
        within = self._leads(state.which[:B])[1] == state.which[:B, None]
        instead = jnp.max(jnp.where(within, PROMOTED, changes.total), axis=1, keepdims=True)
        ready = changes.total > jnp.where(within, instead - np.log(TRIFLE), PROMOTED)
        ready = ready & (after > np.log(KEPT))
        worth = jnp.where(ready, after, NEVER)
        best = jnp.argmax(worth)
        b, k = (of(best, jnp.asarray(K, best.dtype)) for of in (jax.lax.div, jax.lax.rem))
        ell = changes.ell

        def go(state: BranchState) -> tuple[BranchState, Array]:
            def one(after: BranchState, without: Array) -> tuple[BranchState, tuple[()]]:
                return self._branched(after, changes, b, k, without), ()

            after, _ = jax.lax.scan(one, state, jnp.array([False, True]))
            new = jnp.any(after.lanes.eta != state.lanes.eta, axis=(1, 2, 3))
            return after, jnp.where(new[:, None, None], ell[b], ell)

        def stay(state: BranchState) -> tuple[BranchState, Array]:
            return state, ell

        return jax.lax.cond(worth[b, k] > NEVER, go, stay, state)

    def _branched(
        self,
        state: BranchState,
        changes: Changes,
        b: Int[Array, ""],
        k: Int[Array, ""],
        without: Bool[Array, ""],
    ) -> BranchState:
        """`state` with the change `k` of branch `b` promoted; `without` another fault that one
        which has gone may have made up, or with all others."""
        K = self.kinds
        more, less, owner = (jnp.asarray(np.array(a)) for a in (self.more, self.less, self.owner))
        gone = k >= K  # a recovery
        kind = jnp.where(gone, k - K, k)
        fault = owner[kind]
        which = jnp.where(gone, less[state.which[b], fault], more[state.which[b], kind])
        # the likely onsets that agree go; the others stay beside the branch that they are of
        stays = self._staying(changes, b, k)
        ell = jnp.where(stays, NEVER, changes.ell[b, k])
        a = jnp.argmax(ell)
        f, V = self._alone(state, changes, b, k, kind, a, gone)
        mean, P, began = self._moved(state, changes, b, k, kind, ell, f)
        off = self._off(_at(state.belief, b), fault, gone)
        mean, P, gains = self._known_gone(mean, P, fault, gone, off)
        real = self._real(state, b, mean, fault, off)
        doubted = jnp.argmin(real)
        mean, P, also = self._known_gone(mean, P, doubted, without, jnp.zeros(()))
        which = jnp.where(without, less[jnp.maximum(which, 0), doubted], which)
        since = state.since[b].at[fault].set(began)
        share = jnp.where(without, -real[doubted], real[doubted])
        weight = state.weight[b] + logsumexp(ell) - jax.nn.softplus(-share)
        place, better, both = self._placed(state, b, which, weight)
        kept = self._left(state.lanes, b, kind, stays, gone)
        known = (fault, gains), (doubted, also)
        lanes = self._inherited(kept, b, kind, a, place, f, V, gone, off, known)
        lanes = jax.tree.map(lambda new, old: jnp.where(better, new, old), lanes, kept)
        here = better & (jnp.arange(self.filters) == place)

        def placed(old: Array, new: Array) -> Array:
            return jnp.where(here.reshape(-1, *([1] * new.ndim)), new, old)

        def first(own: Array, new: Array) -> Array:
            there = self._present(state.belief)[b, fault]
            first = jnp.where(there, own[b, fault], new[b, kind, a])  # a change begins nothing
            return own[b].at[fault].set(jnp.where(gone, 0.0, first))

        return state._replace(
            belief=Belief(placed(state.belief.mean, mean), placed(state.belief.P, P)),
            weight=jnp.where(jnp.arange(self.filters) == place, both, state.weight),
            which=placed(state.which, which),
            since=placed(state.since, since),
            ever=placed(state.ever, state.ever[b].at[fault].set(1.0)),
            most=placed(state.most, state.most[b]),
            sudden=placed(state.sudden, first(state.sudden, state.lanes.sudden)),
            sharp=placed(state.sharp, first(state.sharp, state.lanes.sharp)),
            told=placed(state.told, self._told_before(state, b, fault, gone)),
            nis=placed(state.nis, self._explained(state, changes, b, k, kind, ell, gone)),
            lanes=lanes,
        )

    def _staying(
        self, changes: Changes, b: Int[Array, ""], k: Int[Array, ""]
    ) -> Bool[Array, "onsets"]:
        """Onsets that are no part of a promoted change: the unlikely ones, and those whose size is
        clearly another one than that of the likeliest, as what is neither lies between the two."""
        ell, f, V = changes.ell[b, k], changes.f[b, k], changes.V[b, k]
        a = jnp.argmax(ell)
        return (ell <= ell[a] + np.log(TRIFLE)) | ((f - f[a]) ** 2 > CLEAR**2 * (V + V[a]))

    def _left(
        self,
        lanes: Lanes,
        b: Int[Array, ""],
        kind: Int[Array, ""],
        stays: Bool[Array, "onsets"],
        gone: Bool[Array, ""],
    ) -> Lanes:
        """`lanes` without what a promoted change of branch `b` takes with it: all of an onset, or,
        of one at which a fault has `gone`, that alone, as it may have changed there, too."""
        mass = jnp.where(stays | gone, lanes.mass[b, kind], NEVER)
        went = jnp.where(stays | ~gone, lanes.went[b, kind], NEVER)
        return lanes._replace(
            mass=lanes.mass.at[b, kind].set(mass), went=lanes.went.at[b, kind].set(went)
        )

    def _explained(
        self,
        state: BranchState,
        changes: Changes,
        b: Int[Array, ""],
        k: Int[Array, ""],
        kind: Int[Array, ""],
        ell: Float[Array, "onsets"],
        gone: Bool[Array, ""],
    ) -> Float[Array, "windows"]:
        """How badly a branch fits with the change `k` of it: by twice what ln L gains the less."""
        fault, prior = jnp.asarray(self.owner)[kind], self.prior
        rare = jnp.log(prior.recovery / prior.onset[: self.filter.faults])[fault]
        changed = jnp.where(self._present(state.belief)[b, fault], jnp.log(prior.changed), 0.0)
        before = state.lanes.mass[b, kind] + jnp.where(gone, rare, changed)
        gain = jnp.max(jnp.where(ell > NEVER / 2, ell - before, 0.0))
        return jnp.maximum(state.nis[b] - 2 * jnp.maximum(gain, 0.0), 0.0)

    def _moved(
        self,
        state: BranchState,
        changes: Changes,
        b: Int[Array, ""],
        k: Int[Array, ""],
        kind: Int[Array, ""],
        ell: Float[Array, "onsets"],
        f: Float[Array, ""],
    ) -> tuple[Float[Array, "n"], Float[Array, "n n"], Float[Array, "two"]]:
        """What a change of size `f`, at one of its onsets, each as likely as `ell` says, makes of a
        branch: its mean, its variance, and since when its fault is there (mean, variance)."""
        w, a = jnp.exp(ell - logsumexp(ell)), jnp.argmax(ell)
        eta = state.lanes.eta[b, :, kind, a]
        mean = state.belief.mean[b] + eta * f
        # the other onsets, kept or not, make the belief as wide as they lie apart from this one
        every = state.lanes.eta[b, :, kind]
        apart = (every * changes.f[b, k] - (eta * f)[:, None]) * jnp.sqrt(w)
        spread = every * jnp.sqrt(w * changes.V[b, k])
        when, blur = state.lanes.onset[b, kind], self._blur(state.t, state.lanes)[b, kind]
        between = self._slope(state, b, kind) * changes.f[b, k] * jnp.sqrt(w * blur)
        each = jnp.concatenate([apart, spread, between], axis=1)
        P = state.belief.P[b] + contract("ia,ja->ij", each, each)
        P = P + jnp.diag(self._late(state, b, kind, f) ** 2)
        onset = contract("a,a->", w, when)
        wide = contract("a,a->", w, (when - onset) ** 2 + blur)
        return mean, P, self._began(state, b, kind, jnp.stack([onset, wide]), f)

    def _placed(
        self,
        state: BranchState,
        b: Int[Array, ""],
        which: Int[Array, ""],
        weight: Float[Array, ""],
    ) -> tuple[Int[Array, ""], Bool[Array, ""], Float[Array, ""]]:
        """(where a new branch goes, whether it is better than what stands there, the weight of
        both): where the same set stands already, or in place of the least likely other one."""
        places = jnp.arange(self.branches)
        own = state.which[: self.branches]
        same = (own == which) & ((places != b) | (which == state.which[b]))
        least = jnp.argmin(jnp.where(places == b, jnp.inf, state.weight[: self.branches]))
        twin = jnp.argmax(jnp.where(same, state.weight[: self.branches], -jnp.inf))
        there = jnp.any(same)
        better = ~there | (twin == b) | (weight >= state.weight[twin])
        place = jnp.where(there, twin, least)
        both = jnp.where(there, jnp.logaddexp(weight, state.weight[twin]), weight)
        # no place is made for next to nothing
        worth = there | (weight > state.weight[least])
        worth = worth & (weight > NEVER)
        return place, better & worth, jnp.where(worth, both, state.weight[place])

    def _began(
        self,
        state: BranchState,
        b: Int[Array, ""],
        kind: Int[Array, ""],
        new: Float[Array, "two"],
        f: Float[Array, ""],
    ) -> Float[Array, "two"]:
        """When a fault began (mean, variance) to which a change by `f` is added at `new`: at one of
        the two times, each as likely as the square of what came then is large."""
        fault = jnp.asarray(self.owner)[kind]
        old, there = state.since[b, fault], self._present(state.belief)[b, fault]
        had = state.belief.mean[b, self.filter.states + fault] ** 2
        more = jnp.where(jnp.asarray(self.grows)[kind] > 0, 0.0, f**2)
        share = jnp.where(there, more / jnp.maximum(had + more, 1e-300), 1.0)
        mean = (1 - share) * old[0] + share * new[0]
        within = (1 - share) * old[1] + share * new[1]
        apart = (1 - share) * share * (new[0] - old[0]) ** 2
        return jnp.stack([mean, within + apart])

    def _late(
        self, state: BranchState, b: Int[Array, ""], kind: Int[Array, ""], f: Float[Array, ""]
    ) -> Float[Array, "n"]:
        """How far off what an output shows late may be where a fault enters with an input (standard
        deviations), as where the input changes. What follows an input is not: what it errs by in
        healthy logs is mostly friction and the like, that no fault brings."""
        n, F = self.filter.states, self.filter.faults
        z, plant = state.belief.mean[b], self.filter.plant
        before, step = z[n : n + F], jnp.where(jnp.asarray(self.grows)[kind] > 0, 0.0, f)
        after = before.at[jnp.asarray(self.owner)[kind]].add(step)
        jump = plant.jumps(z[:n], state.u, state.u, before, after)
        return jnp.concatenate([jump, jnp.zeros(len(z) - n)])

    def _alone(
        self,
        state: BranchState,
        changes: Changes,
        b: Int[Array, ""],
        k: Int[Array, ""],
        kind: Int[Array, ""],
        a: Int[Array, ""],
        gone: Bool[Array, ""],
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """(size, variance) of one change with the widest prior, which is Gaussian: what a branch
        and the signatures beside it can both be told."""
        lanes = state.lanes
        V = 1 / (lanes.info[b, kind, a] + 1 / self.prior.size[kind] ** 2)
        f = V * lanes.score[b, kind, a]
        i, which = jnp.asarray(self.slots)[kind], lanes.row[b, kind, a]
        left = lanes.eta[b, i, kind, a]
        J = lanes.J[b, which, which]
        v = 1 / (J + left**2 / (state.belief.P[b, i, i] + 1e-300))
        return jnp.where(gone, changes.f[b, k, a], f), jnp.where(gone, v, V)

    # -- the unknown

    def _alien(self, state: BranchState) -> BranchState:
        """Unknown filters begin anew from a healthy branch where they explain nothing, each at an
        age of its own; where the unknown leads, the least branch tries whether it is over."""
        B = self.branches
        limits = self.memory * self.ages
        age = state.t - state.begun
        lead = jnp.argmax(state.weight[:B])
        rate = jnp.log(self.prior.unknown * limits)
        gain = state.weight[B:] - state.weight[lead] - rate
        again = ((age[B:] >= limits) & (gain < 1.0)) | (state.weight[B:] <= NEVER / 2)
        again = again & (state.which[lead] == 0)
        # the unknown may be over: its states go on, but the discrepancy is the usual one again
        best = B + jnp.argmax(state.weight[B:])
        least = jnp.argmin(state.weight[:B])
        over = jnp.log(self.prior.recovery[0] * self.memory)
        won = state.weight[best] > state.weight[lead]
        back = won & (age[least] >= self.memory)
        back = back & (state.weight[least] < state.weight[best] + over)
        fresh = jnp.concatenate([(jnp.arange(B) == least) & back, again])
        weights = jnp.concatenate(
            [jnp.full(B, state.weight[best] + over), state.weight[lead] + rate]
        )
        anew = partial(self._anew, fresh, weights, lead, best)
        return jax.lax.cond(jnp.any(fresh), anew, lambda state: state, state)

    def _anew(
        self,
        fresh: Bool[Array, "filters"],
        weights: Float[Array, "filters"],
        lead: Int[Array, ""],
        best: Int[Array, ""],
        state: BranchState,
    ) -> BranchState:
        """The `fresh` filters begin anew with `weights`: unknown ones from the branch `lead`,
        branches from the unknown one that is `best`."""
        B, (U, n) = self.branches, self.alien.shape[:2]
        mean, Ps = state.belief.mean[lead], state.belief.P[lead] + self.alien
        keep = jnp.concatenate([self.own, jnp.zeros(n - len(self.own))])
        calm = state.belief.P[best] * keep[:, None] * keep + jnp.diag(self.usual)
        means = jnp.concatenate(
            [
                jnp.broadcast_to(state.belief.mean[best] * keep, (B, n)),
                jnp.broadcast_to(mean, (U, n)),
            ]
        )
        Ps = jnp.concatenate([jnp.broadcast_to(calm, (B, n, n)), Ps])
        lanes = state.lanes

        def cleared(a: Array) -> Array:
            return jnp.where(fresh[:B].reshape(-1, *([1] * (a.ndim - 1))), 0.0, a)

        def passed_on(a: Array) -> Array:
            """Of each fault, by the filter that a fresh one begins from."""
            own = jnp.where((jnp.arange(B + U) < B)[:, None], a[best], a[lead])
            return jnp.where(fresh[:, None], own, a)

        lanes = lanes._replace(
            mass=jnp.where(fresh[:B, None, None], NEVER, lanes.mass),
            score=cleared(lanes.score),
            info=cleared(lanes.info),
            gain=cleared(lanes.gain),
            sudden=cleared(lanes.sudden),
            sharp=cleared(lanes.sharp),
            shared=cleared(lanes.shared),
            J=cleared(lanes.J),
        )
        return state._replace(
            belief=Belief(
                jnp.where(fresh[:, None], means, state.belief.mean),
                jnp.where(fresh[:, None, None], Ps, state.belief.P),
            ),
            weight=jnp.where(fresh, weights, state.weight),
            which=jnp.where(jnp.concatenate([fresh[:B], np.zeros(U, bool)]), 0, state.which),
            ever=passed_on(state.ever),
            most=passed_on(state.most),
            sudden=jnp.where(fresh[:, None], 0.0, state.sudden),
            sharp=jnp.where(fresh[:, None], 0.0, state.sharp),
            told=jnp.where(fresh[:, None], 0.0, state.told),
            nis=passed_on(state.nis),
            begun=jnp.where(fresh, state.t, state.begun),
            lanes=lanes,
        )


def _at(tree, k):
    return jax.tree.map(lambda a: a[k], tree)
