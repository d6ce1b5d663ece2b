"""The posterior over which faults there are and when they began.

A branch is a nonlinear filter with the faults of one set in its state. Beside it runs the evidence
of one more change of every fault (`onsets`). A change that becomes likelier than none is promoted
to a branch of its own, which inherits all other signatures less what the promoted one explains of
them (the Schur complement of J).

Beside the branches run unknown ones: filters whose discrepancy is far beyond the learned one, from
some onsets on.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import logsumexp
from jaxtyping import Array, Bool, Float, Int

from faultgauge.observers.branches import (
    NEVER,
    SCALES,
    BranchInfo,
    BranchState,
    Changes,
    Lanes,
    Probe,
)
from faultgauge.observers.divided_difference import Belief, Flow, Look, Noise, Seen
from faultgauge.observers.onsets import Onsets
from faultgauge.observers.rows import where_needed

__all__ = ["Branching"]

KEPT = 1e-9  # of all probability: a branch below may go
PROMOTED = 0.0  # log-odds of a change against none, within its branch
TRIFLE = 5e-3  # of the likeliest onset: one that moves no 95 % interval


class Branching(Onsets):
    """The bank over any plant; pure `init` and `step`.

    `noise` is that of the branches and, behind them, of the unknown ones; `alien` is the variance
    that an unknown branch begins with, on top; `usual` what the states behind the plant's own have
    when a log begins. Healthy is the first set, unknown the last.
    """

    noise: Noise
    alien: Float[Array, "n n"]
    own: Float[Array, "states"]
    usual: Float[Array, "n"]
    memory: Float[Array, ""]
    recall: Float[Array, "faults"]
    declared: int = eqx.field(static=True)

    @property
    def filters(self) -> int:
        return len(self.noise.sigma)

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
        lanes = Lanes(
            jnp.broadcast_to(eta, (B, n, K, A)),
            jnp.zeros((B, K, A)),
            jnp.zeros((B, K, A)),
            jnp.zeros((B, len(SCALES), K, A)),
            jnp.zeros((B, K, A)),
            jnp.zeros((B, K * A, K * A)),
            jnp.broadcast_to(mass, (B, K, A)),
            jnp.zeros((B, K, A)),
        )
        probe = Probe(jnp.zeros((n, self.declared, 2)), jnp.zeros((self.declared, 2)))
        since = jnp.zeros((self.filters, self.filter.faults, 2))
        begun = jnp.zeros(self.filters)
        ever = jnp.zeros((self.filters, self.filter.faults))
        return BranchState(
            belief, weight, which, since, ever, begun, lanes, probe, u, jnp.zeros(())
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

        def one(belief: Belief, noise: Noise) -> tuple:
            after, *said = self.filter.step(belief, noise, state.u, u, y, dt)
            return after, said

        alive, B = state.weight > NEVER / 2, self.branches
        belief, said = where_needed(jax.vmap(one), alive, state.belief, self.noise)
        likelihood, flow, look, seen = said
        weight = state.weight + likelihood
        weight = jnp.maximum(weight - jnp.max(weight), NEVER)
        parts = tuple(jax.tree.map(lambda a: a[:B], part) for part in (flow, look, seen))
        lanes, _ = where_needed(self._signatures, alive[:B], state.lanes, parts)
        lead = jnp.argmax(weight[: self.branches])
        leading = _at(flow, lead), _at(look, lead), _at(seen, lead)
        probe = self._probed(state.probe, *leading, dt)
        state = BranchState(
            belief, weight, state.which, state.since, state.ever, state.begun, lanes, probe, u, t
        )
        changes = self._changes(state)
        info = self._info(state, changes)
        state, ell = self._promoted(state, changes)
        return self._alien(self._opened(state, ell, dt)), info

    def _probed(self, probe: Probe, flow: Flow, look: Look, seen: Seen, dt: Array) -> Probe:
        """The signature of every fault, forgotten within its `recall`: of one that began lately."""
        n, F = self.filter.states, self.declared
        fade = jnp.exp(-dt / self.recall)[:, None]
        sides = jnp.stack([flow.down, flow.up], axis=2)[:, :F]
        shown = jnp.stack([look.down, look.up], axis=2)[:, :F]
        eta = jnp.einsum("ij,jfs->ifs", flow.A[:n, :n], fade * probe.eta[:n]) + sides
        J = fade * probe.J
        for j in range(len(seen.white)):
            g = jnp.einsum("n,nfs->fs", look.C[j, :n], eta) + shown[j]
            J = J + (g / seen.root[j]) ** 2
            g = jnp.where(jnp.isfinite(seen.root[j]), g, 0.0)
            eta = eta - seen.gain[j, :n, None, None] * g
        rest = jnp.zeros((probe.eta.shape[0] - n, F, 2))
        return Probe(jnp.concatenate([eta, rest]), J)

    # -- promotion

    def _promoted(
        self, state: BranchState, changes: Changes
    ) -> tuple[BranchState, Float[Array, "branches kinds onsets"]]:
        """The likeliest change that is likelier than none, in a branch of its own; and how likely
        each onset is beside every branch."""
        B, K = self.branches, changes.ell.shape[1]
        total = logsumexp(changes.ell, axis=2)
        weight = state.weight[:B, None]
        after = weight + total
        worth = jnp.where((after > np.log(KEPT)) & (total > PROMOTED), after, NEVER)
        best = jnp.argmax(worth)
        b, k = best // K, best % K
        ell = changes.ell[:, : self.kinds]

        def go(state: BranchState) -> tuple[BranchState, Array]:
            after = self._branched(state, changes, b, k)
            new = jnp.any(after.lanes.eta != state.lanes.eta, axis=(1, 2, 3))
            return after, jnp.where(new[:, None, None], ell[b], ell)

        def stay(state: BranchState) -> tuple[BranchState, Array]:
            return state, ell

        return jax.lax.cond(worth[b, k] > NEVER, go, stay, state)

    def _branched(
        self, state: BranchState, changes: Changes, b: Int[Array, ""], k: Int[Array, ""]
    ) -> BranchState:
        B, K = self.branches, self.kinds
        more, less, owner = (jnp.asarray(np.array(a)) for a in (self.more, self.less, self.owner))
        gone = k >= K  # a recovery
        kind = jnp.where(gone, k - K, k)
        fault = owner[kind]
        which = jnp.where(gone, less[state.which[b], fault], more[state.which[b], kind])
        # the likely onsets go; the others stay beside the branch that they are of
        stays = changes.ell[b, k] <= jnp.max(changes.ell[b, k]) + np.log(TRIFLE)
        ell = jnp.where(stays, NEVER, changes.ell[b, k])
        w = jnp.exp(ell - logsumexp(ell))
        a = jnp.argmax(ell)
        eta = state.lanes.eta[b, :, kind, a]
        f, V = self._alone(state, changes, b, k, kind, a, gone)
        mean = state.belief.mean[b] + eta * f
        # the other onsets, kept or not, make the belief as wide as they lie apart from this one
        every = state.lanes.eta[b, :, kind]
        apart = (every * changes.f[b, k] - (eta * f)[:, None]) * jnp.sqrt(w)
        spread = every * jnp.sqrt(w * changes.V[b, k])
        when, blur = state.lanes.onset[b, kind], self._blur(state)[b, kind]
        between = self._slope(state, b, kind) * changes.f[b, k] * jnp.sqrt(w * blur)
        P = state.belief.P[b] + apart @ apart.T + spread @ spread.T + between @ between.T
        P = P + jnp.diag(self._entry(state, b, kind, f) ** 2)
        mean, P = self._known_gone(mean, P, fault, gone)
        onset = w @ when
        wide = w @ ((when - onset) ** 2 + blur)
        began = self._began(state, b, kind, jnp.stack([onset, wide]), f)
        since = state.since[b].at[fault].set(began)
        ever = state.ever[b].at[fault].set(1.0)
        weight = state.weight[b] + logsumexp(ell)
        # the place: where the same set stands already, or the least likely other one
        places = jnp.arange(B)
        same = (state.which[:B] == which) & ((places != b) | (which == state.which[b]))
        least = jnp.argmin(jnp.where(places == b, jnp.inf, state.weight[:B]))
        twin = jnp.argmax(jnp.where(same, state.weight[:B], -jnp.inf))
        place = jnp.where(jnp.any(same), twin, least)
        better = ~jnp.any(same) | (twin == b) | (weight >= state.weight[twin])
        both = jnp.where(jnp.any(same), jnp.logaddexp(weight, state.weight[twin]), weight)
        left = jnp.where(stays, state.lanes.mass[b, kind], NEVER)
        kept = state.lanes._replace(mass=state.lanes.mass.at[b, kind].set(left))
        lanes = self._inherited(kept, b, kind, a, place, f, V, gone)
        lanes = jax.tree.map(lambda new, old: jnp.where(better, new, old), lanes, kept)
        put = jnp.where(better, place, -1)
        here = jnp.arange(self.filters) == put

        def placed(old: Array, new: Array) -> Array:
            return jnp.where(here.reshape(-1, *([1] * new.ndim)), new, old)

        return state._replace(
            belief=Belief(placed(state.belief.mean, mean), placed(state.belief.P, P)),
            weight=jnp.where(jnp.arange(self.filters) == place, both, state.weight),
            which=placed(state.which, which),
            since=placed(state.since, since),
            ever=placed(state.ever, ever),
            lanes=lanes,
        )

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
        old, there = state.since[b, fault], self._present(state)[b, fault]
        had = state.belief.mean[b, self.filter.states + fault] ** 2
        more = jnp.where(kind < self.filter.faults, f**2, 0.0)
        share = jnp.where(there, more / jnp.maximum(had + more, 1e-300), 1.0)
        mean = (1 - share) * old[0] + share * new[0]
        within = (1 - share) * old[1] + share * new[1]
        apart = (1 - share) * share * (new[0] - old[0]) ** 2
        return jnp.stack([mean, within + apart])

    def _entry(
        self, state: BranchState, b: Int[Array, ""], kind: Int[Array, ""], f: Float[Array, ""]
    ) -> Float[Array, "n"]:
        """How far off what follows an input may be where a fault enters with it (standard
        deviations), as where the input changes."""
        n, F = self.filter.states, self.filter.faults
        z, plant = state.belief.mean[b], self.filter.plant
        before = z[n : n + F]
        after = before.at[jnp.asarray(self.owner)[kind]].add(jnp.where(kind < F, f, 0.0))
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
        i, which = self.filter.states + kind, kind * self.onsets + a
        left = lanes.eta[b, i, kind, a]
        J = lanes.J[b, which, which]
        v = 1 / (J + left**2 / (state.belief.P[b, i, i] + 1e-300))
        return jnp.where(gone, changes.f[b, k, a], f), jnp.where(gone, v, V)

    def _known_gone(
        self, mean: Array, P: Array, fault: Int[Array, ""], gone: Bool[Array, ""]
    ) -> tuple[Array, Array]:
        """The belief given that a fault that has gone is 0, and so is its growth."""
        n = self.filter.states
        for slot, owner in enumerate(self.owner):
            i = n + slot
            there = gone & (fault == owner) & (P[i, i] > 0)
            gain = jnp.where(there, P[:, i] / jnp.maximum(P[i, i], 1e-300), 0.0)
            mean = mean - gain * mean[i]
            P = P - jnp.outer(gain, P[i])
            none = jnp.where(there & (jnp.arange(len(mean)) == i), 0.0, 1.0)
            mean, P = mean * none, P * none[:, None] * none[None]
        return mean, (P + P.T) / 2

    # -- the unknown

    def _alien(self, state: BranchState) -> BranchState:
        """Unknown filters begin anew from a healthy branch where they explain nothing, each at an
        age of its own; where the unknown leads, the least branch tries whether it is over."""
        B, U, n = self.branches, self.filters - self.branches, len(self.alien)
        limits = self.memory * 4.0 ** np.arange(U)
        age = state.t - state.begun
        lead = jnp.argmax(state.weight[:B])
        rate = jnp.log(self.prior.unknown * limits)
        gain = state.weight[B:] - state.weight[lead] - rate
        again = ((age[B:] >= limits) & (gain < 1.0)) | (state.weight[B:] <= NEVER / 2)
        again = again & (state.which[lead] == 0)
        mean, P = state.belief.mean[lead], state.belief.P[lead] + self.alien
        # the unknown may be over: its states go on, but the discrepancy is the usual one again
        best = B + jnp.argmax(state.weight[B:])
        least = jnp.argmin(state.weight[:B])
        over = jnp.log(self.prior.recovery[0] * self.memory)
        won = state.weight[best] > state.weight[lead]
        back = won & (age[least] >= self.memory)
        back = back & (state.weight[least] < state.weight[best] + over)
        keep = jnp.concatenate([self.own, jnp.zeros(n - len(self.own))])
        calm = state.belief.P[best] * keep[:, None] * keep + jnp.diag(self.usual)
        fresh = jnp.concatenate([(jnp.arange(B) == least) & back, again])
        means = jnp.concatenate(
            [
                jnp.broadcast_to(state.belief.mean[best] * keep, (B, n)),
                jnp.broadcast_to(mean, (U, n)),
            ]
        )
        Ps = jnp.concatenate([jnp.broadcast_to(calm, (B, n, n)), jnp.broadcast_to(P, (U, n, n))])
        weights = jnp.concatenate(
            [jnp.full(B, state.weight[best] + over), state.weight[lead] + rate]
        )
        lanes = state.lanes

        def cleared(a: Array) -> Array:
            return jnp.where(fresh[:B].reshape(-1, *([1] * (a.ndim - 1))), 0.0, a)

        lanes = lanes._replace(
            mass=jnp.where(fresh[:B, None, None], NEVER, lanes.mass),
            score=cleared(lanes.score),
            info=cleared(lanes.info),
            gain=cleared(lanes.gain),
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
            ever=jnp.where(
                fresh[:, None],
                jnp.concatenate(
                    [
                        jnp.broadcast_to(state.ever[best], (B, self.filter.faults)),
                        jnp.broadcast_to(state.ever[lead], (U, self.filter.faults)),
                    ]
                ),
                state.ever,
            ),
            begun=jnp.where(fresh, state.t, state.begun),
            lanes=lanes,
        )

    # -- answers

    def _info(self, state: BranchState, changes: Changes) -> BranchInfo:
        B, F, n = self.branches, self.filter.faults, self.filter.states
        K = self.kinds
        sets = len(self.more)
        which = state.which[:B]
        target = jnp.concatenate([jnp.array(self.more), jnp.array(self.less)], axis=1)[which]
        log = state.weight[:B, None, None] + changes.ell
        top = jnp.maximum(jnp.max(log), jnp.max(state.weight))
        w = jnp.exp(log - top)
        alone = jnp.exp(state.weight - top)
        Z = jnp.sum(w) + jnp.sum(alone)
        w, alone = w / Z, alone / Z
        one = jnp.eye(sets)
        eta = state.lanes.eta[:, n : n + F]
        eta = jnp.concatenate([eta, eta[:, :, :F]], axis=2)
        f = state.belief.mean[:B, n : n + F, None, None] + eta * changes.f[:, None]
        v = jnp.diagonal(state.belief.P[:B], axis1=1, axis2=2)[:, n : n + F, None, None]
        v = v + eta**2 * changes.V[:, None]
        gone = np.zeros((F, K + F))
        gone[range(F), K + np.arange(F)] = 1.0
        f, v = (jnp.where(gone[None, :, :, None] > 0, 0.0, a) for a in (f, v))
        to = one[jnp.maximum(target, 0)] * (target >= 0)[:, :, None]
        own = one[state.which]
        p = jnp.einsum("bk,bks->s", jnp.sum(w, axis=2), to) + alone @ own
        # an old change of which nothing is known is unlikely, but so wide that with moments it
        # would speak for its whole set
        most = jnp.maximum(
            jnp.max(jnp.max(w, axis=2)[:, :, None] * to, axis=(0, 1)),
            jnp.max(alone[:, None] * own, axis=0),
        )
        heavy = jnp.where(w > TRIFLE * (to @ most)[:, :, None], w, 0.0)
        heavy_alone = jnp.where(alone > TRIFLE * (own @ most), alone, 0.0)
        mean = jnp.einsum("bfk,bks->sf", jnp.sum(heavy[:, None] * f, axis=3), to)
        square = jnp.einsum("bfk,bks->sf", jnp.sum(heavy[:, None] * (f**2 + v), axis=3), to)
        at = slice(n, n + F)
        f0 = state.belief.mean[:, at]
        v0 = jnp.diagonal(state.belief.P, axis1=1, axis2=2)[:, at]
        mean = mean + jnp.einsum("b,bf,bs->sf", heavy_alone, f0, own)
        square = square + jnp.einsum("b,bf,bs->sf", heavy_alone, f0**2 + v0, own)
        held = jnp.einsum("bk,bks->s", jnp.sum(heavy, axis=2), to) + heavy_alone @ own
        held = jnp.maximum(held, 1e-300)[:, None]
        mean, square = mean / held, square / held
        sd = jnp.sqrt(jnp.maximum(square - mean**2, 0.0))
        d = self.declared
        x = alone @ state.belief.mean[:, :n]
        shift = jnp.einsum("bka,bnka->bn", w[:, :K] * changes.f[:, :K], state.lanes.eta[:, :n])
        x = x + jnp.einsum("bka,bn->n", w, state.belief.mean[:B, :n]) + jnp.sum(shift, axis=0)
        seen = state.probe.J * self.prior.size[:d, None] ** 2
        onset, ever = self._past(state, w, alone, target)
        return BranchInfo(p, mean[:, :d], sd[:, :d], x, seen, onset, ever)

    def _past(
        self, state: BranchState, w: Array, alone: Array, target: Array
    ) -> tuple[Float[Array, "faults two"], Float[Array, "faults"]]:
        """(how long ago every fault began, mean and standard deviation; whether it was there)."""
        B, K, d = self.branches, self.kinds, self.declared
        held = (np.array(self.less) >= 0).astype(float)[:, :d]
        own = np.concatenate([np.eye(self.filter.faults)[self.owner, :d], np.zeros((d, d))])
        more = np.zeros((self.filter.faults - d, d))
        own = np.concatenate([own, more])
        each = jnp.sum(w, axis=2)
        there = jnp.asarray(held)[jnp.maximum(target, 0)] * (target >= 0)[:, :, None]
        here = jnp.asarray(held)[state.which[:B]]
        begins = own[None] * (1 - here[:, None])  # a change of what is there already begins nothing
        old = each[:, :, None] * there * (1 - begins)
        weight = jnp.sum(old, axis=1) + alone[:B, None] * here
        first, second = state.since[:B, :d, 0], state.since[:B, :d, 1]
        second = second + first**2
        when, begins = state.lanes.onset, begins[:, :K]
        new = w[:, :K]
        fresh = jnp.einsum("bk,bkf->f", jnp.sum(new, axis=2), begins)
        dated = jnp.einsum("bk,bkf->f", jnp.sum(new * when, axis=2), begins)
        mean = jnp.einsum("bf,bf->f", weight, first) + dated
        squares = jnp.sum(new * (when**2 + self._blur(state)), axis=2)
        square = jnp.einsum("bf,bf->f", weight, second) + jnp.einsum("bk,bkf->f", squares, begins)
        total = jnp.maximum(jnp.sum(weight, axis=0) + fresh, 1e-300)
        mean, square = mean / total, square / total
        sd = jnp.sqrt(jnp.maximum(square - mean**2, 0.0))
        ever = alone @ state.ever[:, :d]
        both = jnp.maximum(state.ever[:B, None, :d], own[None])
        ever = ever + jnp.sum(each[:, :, None] * both, axis=(0, 1))
        return jnp.stack([state.t - mean, sd], axis=1), ever


def _at(tree, k):
    return jax.tree.map(lambda a: a[k], tree)
