"""The posterior over which faults there are and when they began.

A branch is a nonlinear filter with the faults of one set in its state. Beside it run, for one more
change of every fault, the signatures of a unit change at some onsets: what it would have done to
z and to the branch's innovations e since (Willsky and Jones, IEEE TAC 21 (1976), "A generalized
likelihood ratio approach"; B. Friedland, IEEE TAC 14 (1969), "Treatment of bias in recursive
filtering"):

    eta' = A eta - K g,    g = C eta,    c += g e / R,    J += g^2 / R,    V = 1 / (J + 1 / s^2)
    ln L += ln N(e; g c V, R + g^2 V) - ln N(e; 0, S)

for a change of size f ~ N(0, s^2) since then, of which f ~ N(c V, V) is left. S is the variance of
the innovation, raised where it is far off; R is raised only where e is far off from what the change
makes of it, and as S where the first sample may have had a part of the change only.
A size's prior is as likely in every decade below its widest (`SCALES`). Nothing is mixed from step
to step, so evidence adds up for as long as an onset is kept. Onsets are kept ever sparser the
older they are, but the likely ones; one that goes leaves its prior to its neighbour. A change that
becomes likelier than none is promoted to a branch of its own, which inherits all other signatures
less what the promoted one explains of them (the Schur complement of J).

Beside the branches run unknown ones: filters whose discrepancy is far beyond the learned one, from
some onsets on.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import logsumexp
from jaxtyping import Array, Bool, Float, Int

from faultgauge.observers.divided_difference import (
    Belief,
    DividedDifferenceFilter,
    Flow,
    Look,
    Noise,
    Seen,
    raised,
)
from faultgauge.observers.rows import where_needed

__all__ = ["BranchInfo", "BranchState", "Branching", "Prior"]

SCALES = (1.0, 0.15, 0.02)  # of a size's widest prior
NEVER = -1e30  # the logarithm of no probability: finite, so that sums stay numbers
KEPT = 1e-9  # of all probability: a branch below may go
PROMOTED = 0.0  # log-odds of a change against none, within its branch
HEAVY = 0.2  # of the likeliest one's weight: an onset that is not given up
LEAST = 1e-9  # of a size's probability within its limits
SHARPEST = 10.0  # nats: an onset that explains more than those beside it is missed no more
TICK = 1e-12  # s: the shortest step
TRIFLE = 5e-3  # of the likeliest onset: one that moves no 95 % interval


class Prior(NamedTuple):
    """What is known before: `size` of a step and of a growth rate (widest standard deviation),
    `low` and `high` limits of the fault, `onset` and `recovery` rates [1/s], `common` share of
    onsets that bring a second fault, `unknown` rate [1/s]; `first`, ln of the probability that a
    fault is there when a log begins; `changed`, how much likelier than onsets changes are."""

    size: Float[Array, "kinds"]
    low: Float[Array, "kinds"]
    high: Float[Array, "kinds"]
    onset: Float[Array, "kinds"]
    recovery: Float[Array, "faults"]
    common: Float[Array, ""]
    unknown: Float[Array, ""]
    first: Float[Array, "kinds"]
    changed: Float[Array, ""]


class Lanes(NamedTuple):
    """Signatures of a unit change of each kind at some onsets, beside every branch: `score` and
    `info` of its size, `gain` in ln L by each of `SCALES`; `shared` scores and `J` are in the
    branch's own noise, and so tell what one change explains of another."""

    eta: Float[Array, "branches n kinds onsets"]
    score: Float[Array, "branches kinds onsets"]
    info: Float[Array, "branches kinds onsets"]
    gain: Float[Array, "branches scales kinds onsets"]
    shared: Float[Array, "branches kinds onsets"]
    J: Float[Array, "branches lanes lanes"]
    mass: Float[Array, "branches kinds onsets"]
    onset: Float[Array, "branches kinds onsets"]


class Probe(NamedTuple):
    """What a fault of each direction (down, up) would have done to the leading branch lately, and
    how clearly it would have shown."""

    eta: Float[Array, "n faults two"]
    J: Float[Array, "faults two"]


class BranchState(NamedTuple):
    """A checkpoint. Branches come first, unknown ones behind; `which` set each is, `weight` ln of
    its posterior (up to a constant), `since` when each fault of it began (mean and variance),
    `ever` whether it has held each fault at any time, `begun` when the filter began [s]."""

    belief: Belief
    weight: Float[Array, "filters"]
    which: Int[Array, "filters"]
    since: Float[Array, "filters faults two"]
    ever: Float[Array, "filters faults"]
    begun: Float[Array, "filters"]
    lanes: Lanes
    probe: Probe
    u: Float[Array, "inputs"]
    t: Float[Array, ""]


class BranchInfo(NamedTuple):
    """What one sample leaves: the posterior of every set and, last, of the unknown; mean and
    standard deviation of every fault in each set; the states; how clearly each fault would have
    shown, downwards and upwards; how long ago it began, if it is there (mean and standard deviation
    [s]), and the probability that it is or was there."""

    p: Float[Array, "sets"]
    f: Float[Array, "sets faults"]
    sd: Float[Array, "sets faults"]
    x: Float[Array, "states"]
    seen: Float[Array, "faults two"]
    onset: Float[Array, "faults two"]
    ever: Float[Array, "faults"]


class _Changes(NamedTuple):
    """Every change that a branch may have had: ln of its prior times its likelihood, its size and
    the variance of that. First steps and growths, then recoveries of the faults."""

    ell: Float[Array, "branches kinds onsets"]
    f: Float[Array, "branches kinds onsets"]
    V: Float[Array, "branches kinds onsets"]


class Branching(eqx.Module):
    """The bank over any plant; pure `init` and `step`.

    A kind of change is a step of one of the faults, those that nobody declared included, or a
    growth of one that has a rate. `noise` is that of the branches and, behind them, of the unknown
    ones; `alien` is the variance that an unknown branch begins with, on top; `usual` what the
    states behind the plant's own have when a log begins. `more[set][kind]` is the set that a change
    of that kind leads to, `less[set][fault]` the one without the fault, -1 where there is none;
    healthy is the first set, unknown the last.
    """

    filter: DividedDifferenceFilter
    noise: Noise
    prior: Prior
    alien: Float[Array, "n n"]
    own: Float[Array, "states"]
    usual: Float[Array, "n"]
    memory: Float[Array, ""]
    recall: Float[Array, "faults"]
    more: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    less: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    declared: int = eqx.field(static=True)
    branches: int = eqx.field(static=True)
    onsets: int = eqx.field(static=True)

    @property
    def kinds(self) -> int:
        return self.filter.faults + len(self.filter.growing)

    @property
    def owner(self) -> np.ndarray:
        """The fault that each kind is of."""
        return np.array([*range(self.filter.faults), *self.filter.growing], int)

    @property
    def filters(self) -> int:
        return len(self.noise.sigma)

    @property
    def slots(self) -> np.ndarray:
        """The place in z that each kind moves."""
        return self.filter.states + np.arange(self.kinds)

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

    # -- signatures

    def _signatures(self, lanes: Lanes, step: tuple[Flow, Look, Seen]) -> tuple[Lanes, tuple[()]]:
        """What every unit change has done by now."""
        B, n = lanes.eta.shape[:2]
        K, A = self.kinds, self.onsets
        flow, look, seen = step
        up = (lanes.score >= 0)[:, None]
        own = jnp.stack(
            [lanes.eta[:, self.filter.states + k, j] for j, k in enumerate(self.owner)], 1
        )
        eta = jnp.einsum("bij,bjl->bil", flow.A, lanes.eta.reshape(B, n, K * A))
        eta = eta.reshape(B, n, K, A)
        middle = (flow.up + flow.down) / 2
        sided = jnp.where(
            up,
            (flow.up - middle)[:, :, self.owner, None],
            (flow.down - middle)[:, :, self.owner, None],
        )
        states = eta[:, : self.filter.states] + sided * own[:, None]
        eta = jnp.concatenate([states, eta[:, self.filter.states :]], axis=1)
        own = jnp.stack([eta[:, self.filter.states + k, j] for j, k in enumerate(self.owner)], 1)
        middle = (look.up + look.down) / 2
        sided = jnp.where(
            up,
            (look.up - middle)[:, :, self.owner, None],
            (look.down - middle)[:, :, self.owner, None],
        )
        sided = sided * own[:, None]
        shared, J = lanes.shared.reshape(B, -1), lanes.J
        score, info, gain, least = lanes.score, lanes.info, lanes.gain, self._least()
        narrower, at_once = jnp.ones_like(gain), self._at_once()[:, None]
        for j in range(seen.white.shape[1]):
            # the faults' own sides do not change while the outputs are taken in turn
            g = jnp.einsum("bn,bnka->bka", look.C[:, j], eta) + sided[:, j]
            G = (g / seen.root[:, j, None, None]).reshape(B, -1)
            shared = shared + G * seen.white[:, j, None]
            J = J + G[:, :, None] * G[:, None, :]
            # what is far off without a change of a sensor need not be so with it, and then tells
            # its size; of another change that began since the last sample it tells a part
            there = jnp.isfinite(seen.root[:, j])
            wider = jnp.where(there, seen.root[:, j] / seen.usual[:, j], 1.0)[:, None, None]
            white, G = seen.white[:, j, None, None], g / seen.usual[:, j, None, None]
            V = 1 / (info[:, None] + least)
            off = (white * wider)[:, None] - (G * score)[:, None] * V
            unsure = G[:, None] ** 2 * V
            least_times = jnp.where(at_once, 1.0, wider**2)[:, None]
            times = jnp.maximum(raised(off**2 / (1 + unsure)), least_times)
            gain = gain + (white[:, None] ** 2 - off**2 / (times + unsure)) / 2
            narrower = narrower * wider[:, None] ** 2 / (times + unsure)
            score = score + G * white * wider / times[:, 0]
            info = info + G**2 / times[:, 0]
            g = jnp.where(there[:, None, None], g, 0.0)
            eta = eta - seen.gain[:, j, :, None, None] * g[:, None]
        gain, shared = gain + jnp.log(narrower) / 2, shared.reshape(B, K, A)
        return lanes._replace(eta=eta, score=score, info=info, gain=gain, shared=shared, J=J), ()

    def _at_once(self) -> Bool[np.ndarray, "kinds"]:
        """The kinds of change of which the first sample shows all."""
        faults = self.filter.plant.signals.faults
        steps = [fault.enters in ("output", "output_gain") for fault in faults]
        return np.array([*steps, *[False] * len(self.filter.growing)])

    def _least(self) -> Float[Array, "scales kinds one"]:
        """The information on a change's size before any data."""
        return 1 / (jnp.array(SCALES)[:, None, None] * self.prior.size[:, None]) ** 2

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

    # -- what changes there may have been

    def _changes(self, state: BranchState) -> _Changes:
        lanes, prior = state.lanes, self.prior
        B, K, A = lanes.score.shape
        which = state.which[:B]
        more, less = jnp.array(self.more), jnp.array(self.less)
        present = self._present(state)[:, self.owner, None]
        least = self._least()
        V = 1 / (lanes.info[:, None] + least)
        f = lanes.score[:, None] * V
        inside = self._inside(f, V, 1 / least)
        each = lanes.gain + jnp.where(present[:, None], 0.0, inside)
        gain = logsumexp(each, axis=1) - np.log(len(SCALES))
        share = jnp.exp(each - logsumexp(each, axis=1, keepdims=True))
        mean = jnp.sum(share * f, axis=1)
        V = jnp.sum(share * (V + (f - mean[:, None]) ** 2), axis=1)
        legal = (more[which] >= 0)[:, :, None]
        changed = jnp.where(present, jnp.log(prior.changed), 0.0)
        ell = jnp.where(legal, lanes.mass + changed + gain, NEVER)
        steps = _Changes(ell, mean, V)
        # a fault that goes: a step after which it is 0, where a unit of it still stands in the
        # estimate by as much as the signature has `left` there
        F = self.filter.faults
        at = slice(self.filter.states, self.filter.states + F)
        m = -state.belief.mean[:B, at, None]
        v = jnp.diagonal(state.belief.P[:B], axis1=1, axis2=2)[:, at, None] + 1e-300
        J = jnp.maximum(jnp.diagonal(lanes.J, axis1=1, axis2=2), 0.0).reshape(B, K, A)[:, :F]
        c = lanes.shared[:, :F]
        left = jnp.stack([lanes.eta[:, self.filter.states + k, k] for k in range(F)], 1)
        V = 1 / (J + left**2 / v + 1e-300)
        f = V * (c + left * m / v)
        gain = (f**2 / V - m**2 / v - jnp.log(jnp.maximum(J * v + left**2, 1e-300))) / 2
        rare = jnp.log(prior.recovery / prior.onset[:F])[:, None]
        legal = ((less[which] >= 0) & self._present(state))[:, :, None]
        gone = _Changes(jnp.where(legal, lanes.mass[:, :F] + rare + gain, NEVER), f, V)
        return _Changes(*(jnp.concatenate(two, axis=1) for two in zip(steps, gone, strict=True)))

    def _present(self, state: BranchState) -> Bool[Array, "branches faults"]:
        at = slice(self.filter.states, self.filter.states + self.filter.faults)
        return jnp.diagonal(state.belief.P[: self.branches], axis1=1, axis2=2)[:, at] > 0

    def _inside(self, f: Array, V: Array, s2: Array | np.ndarray) -> Array:
        """ln of the share of the posterior within the fault's limits over that of the prior."""
        low, high = self.prior.low[:, None], self.prior.high[:, None]

        def mass(mean: Array, sd: Array) -> Array:
            wide = np.sqrt(2.0) * sd
            inside = (jax.lax.erf((high - mean) / wide) - jax.lax.erf((low - mean) / wide)) / 2
            return jnp.log(jnp.maximum(inside, LEAST))

        return jax.lax.cond(
            jnp.all(jnp.isinf(low) & jnp.isinf(high)),  # of no fault: erf is the dearest of all
            lambda: jnp.zeros_like(f),
            lambda: mass(f, jnp.sqrt(V)) - mass(jnp.zeros_like(f), jnp.sqrt(s2)),
        )

    def _blur(self, state: BranchState) -> Float[Array, "branches kinds onsets"]:
        """The variance of an onset of which only those beside it are kept: evenly between them."""
        when, used = state.lanes.onset, state.lanes.mass > NEVER / 2
        older = jnp.concatenate([when[:, :, :1], when[:, :, :-1]], axis=2)
        before = jnp.concatenate([used[:, :, :1] & False, used[:, :, :-1]], axis=2)
        younger = jnp.concatenate([when[:, :, 1:], jnp.full_like(when[:, :, :1], state.t)], axis=2)
        return (jnp.where(before, younger - older, younger - when) / 2) ** 2 / 3

    # -- promotion

    def _promoted(
        self, state: BranchState, changes: _Changes
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
        self, state: BranchState, changes: _Changes, b: Int[Array, ""], k: Int[Array, ""]
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

    def _slope(
        self, state: BranchState, b: Int[Array, ""], kind: Int[Array, ""]
    ) -> Float[Array, "n onsets"]:
        """By how much the signatures of one kind grow per second that the onset lies earlier."""
        eta, when = state.lanes.eta[b, :, kind], state.lanes.onset[b, kind]
        begins = jnp.zeros((len(eta), 1)).at[self.filter.states + kind].set(1.0)
        younger = jnp.concatenate([eta[:, 1:], begins], axis=1)
        apart = jnp.diff(when, append=state.t)
        return (eta - younger) / jnp.maximum(apart, TICK)

    def _alone(
        self,
        state: BranchState,
        changes: _Changes,
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

    def _inherited(
        self,
        lanes: Lanes,
        b: Int[Array, ""],
        kind: Int[Array, ""],
        a: Int[Array, ""],
        place: Int[Array, ""],
        f: Float[Array, ""],
        V: Float[Array, ""],
        gone: Bool[Array, ""],
    ) -> Lanes:
        """The signatures beside the new branch: less what the promoted change, of size `f` and
        variance `V`, explains of them."""
        K, A = self.kinds, self.onsets
        which = kind * A + a
        J, eta, mass = lanes.J[b], lanes.eta[b], lanes.mass[b]
        column = J[:, which]
        shared = lanes.shared[b].reshape(-1) - column * f
        J = J - V * column[:, None] * column[None]
        eta = eta - eta[:, kind, a][:, None, None] * (V * column).reshape(1, K, A)
        # a common cause brings another fault at about the same time
        apart = jnp.abs(lanes.onset[b] - lanes.onset[b, kind, a])
        closest = apart == jnp.min(apart, axis=1, keepdims=True)
        together = closest & (mass > NEVER / 2) & ~gone
        mass = jnp.where(together, jnp.logaddexp(mass, jnp.log(self.prior.common)), mass)
        shared, info = (a.reshape(K, A) for a in (shared, jnp.maximum(jnp.diagonal(J), 0.0)))
        least = self._least()
        gain = (shared**2 / (info + least) - jnp.log1p(info / least)) / 2
        new = Lanes(eta, shared, info, gain, shared, J, mass, lanes.onset[b])
        return jax.tree.map(lambda every, one: every.at[place].set(one), lanes, new)

    # -- onsets

    def _opened(self, state: BranchState, ell: Array, dt: Array) -> BranchState:
        """An onset at this sample, behind the others, in the place of the one that is missed least:
        that whose neighbours lie closest for its age and explain what it explains, and is not
        likely."""
        lanes, K, A = state.lanes, self.kinds, self.onsets
        B = self.branches
        likely = jnp.exp(ell - jnp.max(ell, axis=2, keepdims=True)) > HEAVY
        used, when = lanes.mass > NEVER / 2, lanes.onset
        far = jnp.full((B, K, 1), -1e9)
        older = jnp.concatenate([far, when[:, :, :-1]], axis=2)
        younger = jnp.concatenate([when[:, :, 1:], jnp.full((B, K, 1), state.t)], axis=2)
        age = state.t + jnp.maximum(dt, TICK) - when
        gain = jnp.where(used, ell - lanes.mass, NEVER)
        none = jnp.full((B, K, 1), NEVER)
        beside = jnp.maximum(
            jnp.concatenate([none, gain[:, :, :-1]], axis=2),
            jnp.concatenate([gain[:, :, 1:], 0 * none], axis=2),
        )
        peak = jnp.exp(jnp.clip(gain - beside, 0.0, SHARPEST))
        cost = (younger - older) / age * peak + jnp.where(likely, 1e6, 0.0)
        cost = jnp.where(used, cost, -1.0)
        place = jnp.argmin(cost, axis=2)[:, :, None]
        index = np.arange(A)
        gone = index == place
        # its prior goes to the nearer neighbour
        lost = jnp.where(gone & used, lanes.mass, NEVER)
        to_older = when - older <= younger - when
        left = jnp.concatenate([jnp.where(to_older, lost, NEVER)[:, :, 1:], none], axis=2)
        right = jnp.where(to_older, NEVER, lost)
        fresh = jnp.log(self.prior.onset * jnp.maximum(dt, TICK))[:, None]
        fresh = jnp.logaddexp(fresh, right[:, :, -1:])
        right = jnp.concatenate([none, right[:, :, :-1]], axis=2)
        mass = jnp.logaddexp(lanes.mass, jnp.logaddexp(left, right))

        def moved(a: Array, new: Array | np.ndarray | float) -> Array:
            """The onsets behind the one that went, one place down; `new` at the end."""
            end = jnp.broadcast_to(new, (*a.shape[:-1], 1))
            after = jnp.concatenate([a[..., 1:], end], axis=-1)
            before = index < place if a.ndim == 3 else index < place[:, None]
            return jnp.where(before, a, after)

        # rows and columns of J one place down, as one long axis: a vector for compilers
        kept = (index < place).reshape(B, K * A)
        last = np.tile(index == A - 1, K)

        def down(a: Array, axis: int) -> Array:
            mask = [1, 1, 1]
            mask[0], mask[axis] = B, K * A
            one = jnp.roll(a, -1, axis)
            one = jnp.where(last.reshape(1, *mask[1:]), 0.0, one)
            return jnp.where(kept.reshape(mask), a, one)

        J = down(down(lanes.J, 2), 1)
        start = np.zeros((lanes.eta.shape[1], K, 1))
        start[self.slots, range(K), 0] = 1.0
        new = Lanes(
            moved(lanes.eta, jnp.asarray(start)),
            moved(lanes.score, 0.0),
            moved(lanes.info, 0.0),
            moved(lanes.gain, 0.0),
            moved(lanes.shared, 0.0),
            J,
            moved(mass, fresh),
            moved(when, state.t),
        )
        return state._replace(lanes=new)

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

    def _info(self, state: BranchState, changes: _Changes) -> BranchInfo:
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
