"""The posterior over which faults there are and when they began.

A branch is a nonlinear filter with the faults of one set in its state. Beside it runs the evidence
of one more change of every fault (`onsets`). A change that becomes likelier than none is promoted
to a branch of its own (of a fault that is there, in place of its branch, when nothing else is left
of that), which inherits all other signatures less what the promoted one explains of
them (the Schur complement of J).

Beside the branches run unknown ones: filters whose discrepancy is far beyond the learned one, from
some onsets on.
"""

from functools import partial

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
    Sums,
)
from faultgauge.observers.divided_difference import Belief, FilterNoise, Flow, Look, Seen
from faultgauge.observers.onsets import CLEAR, Onsets
from faultgauge.observers.rows import where_needed
from faultgauge.products import contract

__all__ = ["Branching"]

KEPT = 1e-9  # of all probability: a branch below may go
PROMOTED = 0.0  # log-odds of a change against none, within its branch
HOPELESS = 745.0  # nats behind the likeliest branch: a probability that is no number
TRIFLE = 5e-3  # of the likeliest onset, or change: one that moves no 95 % interval


class Branching(Onsets):
    """The bank over any plant; pure `init` and `step`.

    `noise` is that of the branches and, behind them, of the unknown ones; `alien` is the variance
    that an unknown branch begins with, on top; `usual` what the states behind the plant's own have
    when a log begins; `shape` the share of all that a fault does by which the answer to it is off.
    Healthy is the first set, unknown the last.
    """

    noise: FilterNoise
    alien: Float[Array, "n n"]
    own: Float[Array, "states"]
    usual: Float[Array, "n"]
    memory: Float[Array, ""]
    recall: Float[Array, "faults"]
    shape: Float[Array, ""]
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
            jnp.zeros((B, K, A)),
            jnp.zeros((B, K * A, K * A)),
            jnp.broadcast_to(np.arange(K * A).reshape(K, A), (B, K, A)),
            jnp.broadcast_to(mass, (B, K, A)),
            jnp.zeros((B, K, A)),
        )
        probe = Probe(jnp.zeros((n, self.declared, 2)), jnp.zeros((self.declared, 2)))
        since = jnp.zeros((self.filters, self.filter.faults, 2))
        begun = jnp.zeros(self.filters)
        none = jnp.zeros((self.filters, self.filter.faults))
        told = none, none, none, jnp.zeros(self.declared)
        return BranchState(
            belief, weight, which, since, *told, begun, lanes, probe, u, jnp.zeros(())
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
        """The signature of every fault, forgotten within its `recall`: of one that began lately."""
        n, F = self.filter.states, self.declared
        fade = jnp.exp(-dt / self.recall)[:, None]
        sides = jnp.stack([flow.down, flow.up], axis=2)[:, :F]
        shown = jnp.stack([look.down, look.up], axis=2)[:, :F]
        eta = contract("ij,jfs->ifs", flow.A[:n, :n], fade * probe.eta[:n]) + sides
        J = fade * probe.J
        for j in range(len(seen.white)):
            g = contract("n,nfs->fs", look.C[j, :n], eta) + shown[j]
            J = J + (g / seen.root[j]) ** 2
            g = jnp.where(jnp.isfinite(seen.root[j]), g, 0.0)
            eta = eta - seen.gain[j, :n, None, None] * g
        rest = jnp.zeros((probe.eta.shape[0] - n, F, 2))
        return Probe(jnp.concatenate([eta, rest]), J)

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
        when, blur = state.lanes.onset[b, kind], self._blur(state.t, state.lanes)[b, kind]
        between = self._slope(state, b, kind) * changes.f[b, k] * jnp.sqrt(w * blur)
        each = jnp.concatenate([apart, spread, between], axis=1)
        P = state.belief.P[b] + contract("ia,ja->ij", each, each)
        P = P + jnp.diag(self._late(state, b, kind, f) ** 2)
        off = self._off(_at(state.belief, b), fault, gone)
        mean, P, gains = self._known_gone(mean, P, fault, gone, off)
        onset = contract("a,a->", w, when)
        wide = contract("a,a->", w, (when - onset) ** 2 + blur)
        began = self._began(state, b, kind, jnp.stack([onset, wide]), f)
        since = state.since[b].at[fault].set(began)
        ever = state.ever[b].at[fault].set(1.0)
        there = self._present(state.belief)[b, fault]
        first = jnp.where(there, state.sudden[b, fault], state.lanes.sudden[b, kind, a])
        sudden = state.sudden[b].at[fault].set(jnp.where(gone, 0.0, first))
        weight = state.weight[b] + logsumexp(ell) - self._overtold(state, b, mean, P, fault, off)
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
        lanes = self._inherited(kept, b, kind, a, place, f, V, gone, off, gains)
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
            most=placed(state.most, state.most[b]),
            sudden=placed(state.sudden, sudden),
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
        old, there = state.since[b, fault], self._present(state.belief)[b, fault]
        had = state.belief.mean[b, self.filter.states + fault] ** 2
        more = jnp.where(kind < self.filter.faults, f**2, 0.0)
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
        i, which = self.filter.states + kind, lanes.row[b, kind, a]
        left = lanes.eta[b, i, kind, a]
        J = lanes.J[b, which, which]
        v = 1 / (J + left**2 / (state.belief.P[b, i, i] + 1e-300))
        return jnp.where(gone, changes.f[b, k, a], f), jnp.where(gone, v, V)

    def _known_gone(
        self,
        mean: Array,
        P: Array,
        fault: Int[Array, ""],
        gone: Bool[Array, ""],
        off: Float[Array, ""],
    ) -> tuple[Array, Array, list[Array]]:
        """The belief given that a fault that has gone is 0, and so is its growth; and by which
        gains of z that is known."""
        n, gains = self.filter.states, []
        for slot, owner in enumerate(self.owner):
            i = n + slot
            there = gone & (fault == owner) & (P[i, i] > 0)
            gain = jnp.where(there, P[:, i] / jnp.maximum(P[i, i], 1e-300), 0.0)
            gains.append(gain)
            P = P - jnp.outer(gain, P[i])
            none = jnp.where(there & (jnp.arange(len(mean)) == i), 0.0, 1.0)
            P = P * none[:, None] * none[None]
        P = (P + P.T) / 2
        return self._without(mean, gains), P + jnp.diag(self._untold(P, off)), gains

    # what was told amid a fault that acts on the plant is off as the answer to it is

    def _acts(self) -> Float[np.ndarray, "faults"]:
        return np.array([float(each.acts) for each in self.filter.plant.signals.faults])

    def _off(
        self, before: Belief, fault: Int[Array, ""], gone: Bool[Array, ""]
    ) -> Float[Array, ""]:
        """(shape z)^2 of a fault that has gone, z being how clearly it showed `before`: by so much
        of its own variance is off what was told amid it. 0 where it does not act on the plant."""
        i = self.filter.states + fault
        z2 = before.mean[i] ** 2 / jnp.maximum(before.P[i, i], 1e-300)
        return jnp.where(gone, jnp.asarray(self._acts())[fault] * self.shape**2 * z2, 0.0)

    def _untold(self, P: Float[Array, "n n"], off: Float[Array, ""]) -> Float[Array, "n"]:
        """Variance to add to constants, slow errors and other faults once a fault has gone; they
        are as unsure as when a log, or a fault, begins at most."""
        known, n, F = jnp.diagonal(P), self.filter.states, self.filter.faults
        there = known[n : n + F] > 0
        usual = self.usual.at[n : n + F].set(jnp.where(there, self.prior.size[:F] ** 2, 0.0))
        return jnp.minimum(off * known, jnp.maximum(usual - known, 0.0))

    def _overtold(
        self,
        state: BranchState,
        b: Int[Array, ""],
        mean: Float[Array, "n"],
        P: Float[Array, "n n"],
        fault: Int[Array, ""],
        off: Float[Array, ""],
    ) -> Float[Array, ""]:
        """By how much (ln) the other faults of a branch were told amid one that has gone, beyond
        what its error leaves: of a size z ~ N(0, 1 + s^2) in its own standard deviations,

            ln N(z; 0, 1 + s^2) / N(z; 0, 1),   not   ln N(z; 0, 1 + e^2 + s^2) / N(z; 0, 1 + e^2)

        with e^2 = `off`, beside what the first sample of a sensor's told, which no plant makes up
        but for what it does within a sample. `mean` and `P` are after it has gone."""
        F, n = self.filter.faults, self.filter.states
        before = jnp.diagonal(state.belief.P[b])[n : n + F]
        others = (before > 0) & (np.arange(F) != fault)
        v = jnp.maximum(before, 1e-300)
        z2, s2 = mean[n : n + F] ** 2 / v, self.prior.size[:F] ** 2 / v

        def told(e2: Array | float) -> Array:
            wide = 1 + e2 + s2
            return (z2 / (1 + e2) - z2 / wide - jnp.log(wide / (1 + e2))) / 2

        size = state.belief.mean[b, n + fault]
        quick = jnp.where(
            fault < self.declared, state.quick[jnp.minimum(fault, self.declared - 1)], 0.0
        )
        at_once = jnp.maximum(state.sudden[b], 0.0) * (1 - self._acts())
        left = told(off) + at_once / (1 + self.shape**2 * size**2 * quick)
        return jnp.sum(jnp.where(others & (off > 0), jnp.maximum(told(0.0) - left, 0.0), 0.0))

    # -- the unknown

    def _alien(self, state: BranchState) -> BranchState:
        """Unknown filters begin anew from a healthy branch where they explain nothing, each at an
        age of its own; where the unknown leads, the least branch tries whether it is over."""
        B, U = self.branches, self.filters - self.branches
        limits = self.memory * 4.0 ** np.arange(U)
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
        B, U, n = self.branches, self.filters - self.branches, len(self.alien)
        mean, P = state.belief.mean[lead], state.belief.P[lead] + self.alien
        keep = jnp.concatenate([self.own, jnp.zeros(n - len(self.own))])
        calm = state.belief.P[best] * keep[:, None] * keep + jnp.diag(self.usual)
        means = jnp.concatenate(
            [
                jnp.broadcast_to(state.belief.mean[best] * keep, (B, n)),
                jnp.broadcast_to(mean, (U, n)),
            ]
        )
        Ps = jnp.concatenate([jnp.broadcast_to(calm, (B, n, n)), jnp.broadcast_to(P, (U, n, n))])
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
            begun=jnp.where(fresh, state.t, state.begun),
            lanes=lanes,
        )

    # -- answers

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
        parts = state.belief, log, state.which, state.since, state.ever, state.sudden
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
            state.belief.mean[:, :n],
            jnp.zeros((self.filters, d, 3)),
            state.ever[:, :d],
        )
        p, held, mean, square, sudden, x, past, ever = (
            jnp.sum(a, axis=0) + jnp.sum(jax.vmap(jnp.multiply)(alone, b), axis=0)
            for a, b in zip(each, same, strict=True)
        )
        Z = jnp.sum(p)
        p, x, ever = p / Z, x / Z, ever / Z
        held = jnp.maximum(held, 1e-300)[:, None]
        mean, square, sudden = mean / held, square / held, sudden / held
        sd = jnp.sqrt(jnp.maximum(square - mean**2, 0.0))
        seen = state.probe.J * self.prior.size[:d, None] ** 2
        there, first, second = past.T
        there = jnp.maximum(there, 1e-300)
        first, second = first / there, second / there
        late = jnp.sqrt(jnp.maximum(second - first**2, 0.0))
        onset = jnp.stack([state.t - first, late], axis=1)
        most = state.most[jnp.argmax(state.weight), :d]
        told = seen, onset, ever, most, sudden[:, :d], state.quick
        return BranchInfo(p, mean[:, :d], sd[:, :d], x, *told)

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
        """`given` are the belief, ln of the weight, the set, since when, whether ever and how
        sudden of each branch; its changes; its lanes; what an onset of each kind must weigh to
        count."""
        (belief, log, which, since, ever, sudden), changes, lanes, least = given
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
        told = self._told_at_once(belief, sudden, heavy, lanes)
        told = contract("bfk,bks->bsf", told, to)
        first, spread = since[:, :d, 0], since[:, :d, 1]
        then = jnp.stack([jnp.ones_like(old), first, spread + first**2], axis=2)
        when, new = lanes.onset, w[:, :K]
        dates = jnp.stack([new, new * when, new * (when**2 + self._blur(t, lanes))], axis=3)
        past = contract("bkt,bkf->bft", jnp.sum(dates, axis=2), begins[:, :K])
        past = past + old[:, :, None] * then
        ever = jnp.sum(each[:, :, None] * jnp.maximum(ever[:, None, :d], own), axis=1)
        return (), Sums(p, held, mean, square, told, x, past, ever)

    def _told_at_once(
        self, belief: Belief, sudden: Array, heavy: Array, lanes: Lanes
    ) -> Float[Array, "branches faults changes"]:
        """What the first sample told of each fault after each change, times how likely that is: of
        one that begins by the change, what told of its onsets."""
        F, K = self.filter.faults, self.kinds
        begins = np.zeros((F, K + F))
        begins[self.owner, range(K)] = 1.0
        new = begins[None] * ~self._present(belief)[:, :, None]
        first = jnp.sum(heavy[:, :K] * lanes.sudden, axis=2)
        first = jnp.concatenate([first, jnp.zeros((len(first), F))], axis=1)[:, None]
        return new * first + (1 - new) * sudden[:, :, None] * jnp.sum(heavy, axis=2)[:, None]


def _at(tree, k):
    return jax.tree.map(lambda a: a[k], tree)
