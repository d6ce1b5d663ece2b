"""How likely one more change of every fault is beside every branch, by when it began.

Signatures of a unit change at some onsets say what it would have done to z and to the branch's
innovations e since (Willsky and Jones, IEEE TAC 21 (1976), "A generalized likelihood ratio
approach"; B. Friedland, IEEE TAC 14 (1969), "Treatment of bias in recursive filtering"):

    eta' = A eta - K g,    g = C eta,    c += g e / R,    J += g^2 / R,    V = 1 / (J + 1 / s^2)
    ln L += ln N(e; g c V, R + g^2 V) - ln N(e; 0, S)

for a change of size f ~ N(0, s^2) since then, of which f ~ N(c V, V) is left. What enters with an
input that comes late does so, too. S is the variance of
the innovation, raised where it is far off; R is raised only where e is far off from what the change
makes of it, and as S where the first sample may have had a part of the change only.
A size's prior is as likely in every decade below its widest (`SCALES`). Nothing is mixed from step
to step, so evidence adds up for as long as an onset is kept. Onsets are kept ever sparser the
older they are, but the likely ones; one that goes leaves its prior to its neighbour, less what that
explains and it does not.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from faultgauge.observers.branches import NEVER, SCALES, BranchState, Changes, Lanes, Prior
from faultgauge.observers.divided_difference import (
    Belief,
    DividedDifferenceFilter,
    Flow,
    Look,
    Seen,
    raised,
)
from faultgauge.observers.rows import where_needed
from faultgauge.products import contract

__all__ = ["CLEAR", "NONE", "TICK", "Onsets"]

HEAVY = 0.2  # of the likeliest one's weight: an onset that is not given up
LEAST = 1e-9  # of a size's probability within limits that are near each other
BEYOND = 3.0  # standard deviations beyond a limit, from which on what is left within is asymptotic
ROOT = np.sqrt(0.5)  # times a standard normal: what erf takes
NONE = 1e-300  # a variance: no division by 0
CLEAR = 2.0  # standard deviations of a size, beyond which its sign is known
SHARPEST = 10.0  # nats: an onset that explains more than those beside it is missed no more
TICK = 1e-12  # s: the shortest step
TIE = 1e-9  # by how much more an onset is missed than the one before, all else equal: times of even
# steps make it equal often, and rounding, unlike from machine to machine, must not choose


class Onsets(eqx.Module):
    """The evidence of `onsets` of every kind of change, beside `branches` branches.

    A kind of change is a step of one of the faults, those that nobody declared included, a
    growth of one that has a rate, or a step so large that its effect is another one.
    `more[set][kind]` is the set that a change of that kind leads to, `less[set][fault]` the one
    without the fault, -1 where there is none.
    """

    filter: DividedDifferenceFilter
    prior: Prior
    more: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    less: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    branches: int = eqx.field(static=True)
    onsets: int = eqx.field(static=True)

    @property
    def moved(self) -> int:
        """How many places in z faults have: their own and those of their growth."""
        return self.filter.faults + len(self.filter.growing)

    @property
    def kinds(self) -> int:
        return self.moved + len(self.filter.far)

    @property
    def owner(self) -> np.ndarray:
        """The fault that each kind is of."""
        return np.array([*range(self.filter.faults), *self.filter.growing, *self.filter.far], int)

    @property
    def slots(self) -> np.ndarray:
        """The place in z that each kind moves."""
        return self.filter.states + np.array([*range(self.moved), *self.filter.far], int)

    @property
    def grows(self) -> np.ndarray:
        """1 for the kinds that are growths, 0 for steps."""
        return np.repeat(
            [0.0, 1.0, 0.0], [self.filter.faults, len(self.filter.growing), len(self.filter.far)]
        )

    # -- signatures

    def _sided(self, up: Array, step: Flow | Look, middle: Array) -> Array:
        """What each change does beyond the mean of both sides, by the side that it is on."""
        near, far = slice(self.moved), list(self.filter.far)
        above, below = ((a - middle)[:, :, self.owner[near], None] for a in (step.up, step.down))
        sides = jnp.where(up[:, :, near], above, below)
        farther = (step.far - middle[:, :, far])[..., None]
        every = jnp.broadcast_to(farther, (*farther.shape[:3], sides.shape[3]))
        return jnp.concatenate([sides, every], axis=2)

    def _upwards(
        self, lanes: Lanes, flow: Flow, look: Look, seen: Seen
    ) -> Bool[Array, "branches kinds onsets"]:
        """Whether each change is an upward one: as its score says, and until that is clear, where
        it does more, as on a side that a limit cuts off there would never be a score."""

        def does(states: Array, outputs: Array) -> Array:
            states, outputs = states / self.filter.scale[:, None], outputs / seen.usual[:, :, None]
            squares = jnp.sum(states**2, axis=1) + jnp.sum(outputs**2, axis=1)
            return squares[:, self.owner, None]

        more = does(flow.up, look.up) >= does(flow.down, look.down)
        clear = lanes.score**2 > CLEAR**2 * lanes.info
        return jnp.where(clear, lanes.score >= 0, more)

    def _signatures(self, lanes: Lanes, step: tuple[Flow, Look, Seen]) -> tuple[Lanes, tuple[()]]:
        """What every unit change has done by now."""
        B, n = lanes.eta.shape[:2]
        K, A = self.kinds, self.onsets
        flow, look, seen = step
        up = self._upwards(lanes, flow, look, seen)[:, None]
        at = self.filter.states + self.owner
        own = jnp.stack([lanes.eta[:, k, j] for j, k in enumerate(at)], 1)
        eta = jax.vmap(self.filter.through)(flow.A, lanes.eta.reshape(B, n, K * A))
        eta = eta.reshape(B, n, K, A)
        F, states = self.filter.faults, self.filter.states
        middle = flow.A[:, :states, states : states + F]
        sided = self._sided(up, flow, middle)
        eta = jnp.concatenate([eta[:, :states] + sided * own[:, None], eta[:, states:]], axis=1)
        own = jnp.stack([eta[:, k, j] for j, k in enumerate(at)], 1)
        middle = look.C[:, :, states : states + F]
        sided = self._sided(up, look, middle) * own[:, None]
        # in each row of J stands an onset of the row's own kind, of which the last has just opened
        stands = lanes.row[:, :, None] == np.arange(K * A).reshape(K, A, 1)
        onset = jnp.sum(jnp.where(stands, np.arange(A), 0), axis=3)

        def placed(G: Array) -> Array:
            return jnp.take_along_axis(G, onset, axis=2, mode="clip").reshape(B, -1)

        shared, older = lanes.shared, (onset < A - 1).reshape(B, -1)
        J = jnp.where(older[:, :, None] & older[:, None, :], lanes.J, 0.0)
        score, info, gain, least = lanes.score, lanes.info, lanes.gain, self._least()
        narrower, at_once = jnp.ones_like(gain), self._at_once()[:, None]
        for j in range(seen.white.shape[1]):
            # the faults' own sides do not change while the outputs are taken in turn
            g = contract("bn,bnka->bka", look.C[:, j], eta) + sided[:, j]
            G = g * (1 / seen.root[:, j, None, None])
            shared = shared + G * seen.white[:, j, None, None]
            H = placed(G)
            J = J + H[:, :, None] * H[:, None, :]
            # what is far off without a change of a sensor need not be so with it, and then tells
            # its size; of another change that began since the last sample it tells a part
            there = jnp.isfinite(seen.root[:, j])
            wider = jnp.where(there, seen.root[:, j] / seen.usual[:, j], 1.0)[:, None, None]
            white, G = seen.white[:, j, None, None], g * (1 / seen.usual[:, j, None, None])
            V = 1 / (info[:, None] + least)
            off = (white * wider)[:, None] - (G * score)[:, None] * V
            unsure = G[:, None] ** 2 * V
            least_times = jnp.where(at_once, 1.0, wider**2)[:, None]
            times = jnp.maximum(raised(off**2 / (1 + unsure)), least_times)
            certain, less = 1 / (times + unsure), 1 / times[:, 0]
            gain = gain + (white[:, None] ** 2 - off**2 * certain) / 2
            narrower = narrower * (wider[:, None] ** 2 * certain)
            score = score + G * white * wider * less
            info = info + G**2 * less
            g = jnp.where(there[:, None, None], g, 0.0)
            eta = eta - seen.gain[:, j, :, None, None] * g[:, None]
        gain = gain + jnp.log(narrower) / 2
        sudden, sharp = (
            jnp.concatenate([first[..., :-1], now[..., -1:]], axis=-1)
            for first, now in ((lanes.sudden, score), (lanes.sharp, info))
        )
        told = score, info, gain, sudden, sharp, shared, J
        return Lanes(eta, *told, lanes.row, lanes.mass, lanes.went, lanes.onset), ()

    def _at_once(self) -> Bool[np.ndarray, "kinds"]:
        """The kinds of change of which the first sample shows all."""
        steps = np.array([not fault.acts for fault in self.filter.plant.signals.faults])
        return steps[self.owner] & (self.grows == 0)

    def _least(self) -> Float[Array, "scales kinds one"]:
        """The information on a change's size before any data."""
        return 1 / (jnp.array(SCALES)[:, None, None] * self.prior.size[:, None]) ** 2

    # -- what changes there may have been

    def _alive(self, state: BranchState) -> Bool[Array, "branches"]:
        """The branches that have any weight: one without gets none, but by being replaced."""
        return state.weight[: self.branches] > NEVER / 2

    def _changes(self, state: BranchState) -> Changes:
        """Of every branch that is alive; beside the others nothing is likely."""
        at, alive = slice(self.branches), self._alive(state)
        belief = Belief(*(a[at] for a in state.belief))
        given = state.lanes, belief, state.which[at], state.since[at, :, 0]
        _, found = where_needed(self._likely, alive, (), given)
        top, total = (jnp.where(alive[:, None], a, NEVER) for a in (found.top, found.total))
        return found._replace(top=top, total=total)

    def _likely(
        self, nothing: tuple[()], given: tuple[Lanes, Belief, Int[Array, "branches"], Array]
    ) -> tuple[tuple[()], Changes]:
        lanes, belief, which, since = given
        prior, there = self.prior, self._present(belief)
        more, less = jnp.array(self.more), jnp.array(self.less)
        present = there[:, self.owner, None]
        least = self._least()
        V = 1 / (lanes.info[:, None] + least)
        f = lanes.score[:, None] * V
        each = lanes.gain + self._limited(lanes, belief, f, V, 1 / least)
        _, gain, share = _shared(each, 1)
        gain = gain - np.log(len(SCALES))
        mean = jnp.sum(share * f, axis=1)
        V = jnp.sum(share * (V + (f - mean[:, None]) ** 2), axis=1)
        legal = (more[which] >= 0)[:, :, None]
        legal = legal & ~(present & (np.arange(self.kinds) >= self.moved)[:, None])
        changed = jnp.where(present, jnp.log(prior.changed), 0.0)
        ell = jnp.where(legal, lanes.mass + changed + gain, NEVER)
        steps = ell, mean, V
        # a fault that goes: a step after which it is 0, where a unit of it still stands in the
        # estimate by as much as the signature has `left` there
        F = self.filter.faults
        at = slice(self.filter.states, self.filter.states + F)
        m = -belief.mean[:, at, None]
        v = jnp.diagonal(belief.P, axis1=1, axis2=2)[:, at, None] + 1e-300
        every = np.arange(len(which))[:, None, None]
        J = jnp.diagonal(lanes.J, axis1=1, axis2=2)[every, lanes.row[:, :F]]
        J = jnp.maximum(J, 0.0)
        c = lanes.shared[:, :F]
        left = jnp.stack([lanes.eta[:, self.filter.states + k, k] for k in range(F)], 1)
        V = 1 / (J + left**2 / v + 1e-300)
        told = c + left * m / v
        f = V * told
        gain = (f * told - m**2 / v - jnp.log(jnp.maximum(J * v + left**2, 1e-300))) / 2
        rare = jnp.log(prior.recovery / prior.onset[:F])[:, None]
        # before it began it would have been one of its own, which went as this one came
        before = lanes.onset[:, :F] < since[:, :, None]
        gain = gain + jnp.where(before, self._inside(f, V), 0.0)
        legal = ((less[which] >= 0) & there)[:, :, None]
        mass = lanes.mass[:, :F] + lanes.went[:, :F]
        gone = jnp.where(legal, mass + rare + gain, NEVER), f, V
        ell, f, V = (jnp.concatenate(two, axis=1) for two in zip(steps, gone, strict=True))
        return (), Changes(ell, *_shared(ell, 2), f, V)

    def _present(self, belief: Belief) -> Bool[Array, "filters faults"]:
        at = slice(self.filter.states, self.filter.states + self.filter.faults)
        return jnp.diagonal(belief.P, axis1=1, axis2=2)[:, at] > 0

    def _limited(self, lanes: Lanes, belief: Belief, f: Array, V: Array, s2: Array) -> Array:
        """ln of how likely what a change by `f`, of variance `V`, makes of a fault is within its
        limits, over that before the data, when `s2` was the change's variance."""
        m = belief.mean[:, None, self.slots, None]
        v = jnp.diagonal(belief.P, axis1=1, axis2=2)[:, None, self.slots, None]
        left = jnp.stack([lanes.eta[:, j, k] for k, j in enumerate(self.slots)], 1)[:, None]
        after = self._inside(m + left * f, v + left**2 * V)
        return after - self._inside(m, v + left**2 * s2)

    def _kept_within(self, before: Belief, after: Belief) -> Float[Array, "filters"]:
        """ln of how much likelier the faults of every filter are within their limits by a sample:
        what lies beyond them is no explanation."""

        def inside(belief: Belief) -> Array:
            at = self.slots[: self.moved]
            v = jnp.diagonal(belief.P, axis1=1, axis2=2)[:, at, None]
            each = self._inside(belief.mean[:, at, None], v)
            return jnp.sum(jnp.where(v > 0, each, 0.0), axis=(1, 2))

        return inside(after) - inside(before)

    def _inside(self, mean: Array, variance: Array) -> Array:
        """ln of the probability that a fault lies within its limits, beyond which it may seem to
        lie by as much as the model's answers are off; kinds, or the first of them, last but one."""
        first = mean.shape[-2]
        low, high = self.prior.low[:first, None], self.prior.high[:first, None]
        soft = self.prior.soft[:, :first, None] ** 2

        def mass() -> Array:
            least = jnp.maximum(variance, NONE)
            below = (mean - low) * (1 / jnp.sqrt(least + soft[0]))
            above = (high - mean) * (1 / jnp.sqrt(least + soft[1]))
            inside = (jax.lax.erf(above * ROOT) + jax.lax.erf(below * ROOT)) / 2
            # no difference of two numbers near 1 tells how little is left far beyond a limit
            beyond = jnp.maximum(-jnp.minimum(below, above), BEYOND)
            left = -(beyond**2) / 2 - jnp.log(_mills(beyond))
            near = jnp.minimum(below, above) > -BEYOND
            return jnp.where(near, jnp.log(jnp.maximum(inside, LEAST)), left)

        return jax.lax.cond(
            jnp.all(jnp.isinf(low) & jnp.isinf(high)),  # of no fault: erf is the dearest of all
            lambda: jnp.zeros(jnp.broadcast_shapes(mean.shape, variance.shape)),
            mass,
        )

    def _blur(self, t: Float[Array, ""], lanes: Lanes) -> Float[Array, "branches kinds onsets"]:
        """The variance of an onset of which only those beside it are kept: evenly between them."""
        when, used = lanes.onset, lanes.mass > NEVER / 2
        older = jnp.concatenate([when[:, :, :1], when[:, :, :-1]], axis=2)
        before = jnp.concatenate([used[:, :, :1] & False, used[:, :, :-1]], axis=2)
        younger = jnp.concatenate([when[:, :, 1:], jnp.full_like(when[:, :, :1], t)], axis=2)
        return (jnp.where(before, younger - older, younger - when) / 2) ** 2 / 3

    def _slope(
        self, state: BranchState, b: Int[Array, ""], kind: Int[Array, ""]
    ) -> Float[Array, "n onsets"]:
        """By how much the signatures of one kind grow per second that the onset lies earlier."""
        eta, when = state.lanes.eta[b, :, kind], state.lanes.onset[b, kind]
        begins = jnp.zeros((len(eta), 1)).at[jnp.asarray(self.slots)[kind]].set(1.0)
        younger = jnp.concatenate([eta[:, 1:], begins], axis=1)
        apart = jnp.diff(when, append=state.t)
        return (eta - younger) / jnp.maximum(apart, TICK)

    # -- what is passed on

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
        off: Float[Array, ""],
        known: Sequence[tuple[Int[Array, ""], list[Float[Array, "n"]]]],
    ) -> Lanes:
        """The signatures beside the new branch: less what the promoted change, of size `f` and
        variance `V`, explains of them. What a step explains is told by the innovations that `J` is
        of, as it may explain no more than all there is. What was told of others amid a fault that
        has gone is `off` by so many times its variance; `known` are faults that are 0, and by which
        gains of z that is known.
        """
        J, eta, rows = lanes.J[b], lanes.eta[b], lanes.row[b]
        column = J[:, rows[kind, a]]
        alone = 1 / (column[rows[kind, a]] + 1 / self.prior.size[kind] ** 2)
        f, V = jnp.where(gone, f, alone * lanes.shared[b, kind, a]), jnp.where(gone, V, alone)
        # another change of the same fault is none of those that were told amid it
        other = jnp.asarray(self.owner) != jnp.asarray(self.owner)[kind]
        # beside a fault that has gone the same one did not come just then
        mass = lanes.mass[b] + jnp.where(gone & ~other[:, None], lanes.went[b], 0.0)
        less = jnp.where(other, 1 / jnp.sqrt(1 + off), 1.0)
        each = jnp.repeat(less, self.onsets)  # rows of J stand by kinds
        J = (J - V * column[:, None] * column[None]) * each[:, None] * each[None]
        column = column[rows]
        shared = (lanes.shared[b] - column * f) * less[:, None] ** 2
        eta = eta - eta[:, kind, a][:, None, None] * (V * column)
        for gone_fault, gains in known:
            others = jnp.asarray(self.owner) != gone_fault
            eta = jnp.where(others[:, None], self._without(eta, gains), eta)
        # a common cause brings another fault at about the same time
        apart = jnp.abs(lanes.onset[b] - lanes.onset[b, kind, a])
        closest = apart == jnp.min(apart, axis=1, keepdims=True)
        together = closest & (mass > NEVER / 2) & ~gone
        mass = jnp.where(together, jnp.logaddexp(mass, jnp.log(self.prior.common)), mass)
        info = jnp.maximum(jnp.diagonal(J)[rows], 0.0)
        least = self._least()
        gain = (shared**2 / (info + least) - jnp.log1p(info / least)) / 2
        told = shared, info, gain, lanes.sudden[b], lanes.sharp[b], shared, J
        new = Lanes(eta, *told, rows, mass, lanes.went[b], lanes.onset[b])
        return jax.tree.map(lambda every, one: every.at[place].set(one), lanes, new)

    def _without(
        self, z: Float[Array, "n *columns"], gains: list[Float[Array, "n"]]
    ) -> Float[Array, "n *columns"]:
        """What is left of `z` where the changes of a fault that has gone are known to be 0."""
        for slot, gain in enumerate(gains):
            z = z - gain.reshape(-1, *[1] * (z.ndim - 1)) * z[self.filter.states + slot]
        return z

    def _begun(self, u: Float[Array, "inputs"], belief: Belief) -> Float[Array, "branches n kinds"]:
        """What a unit of each change does to z where it begins, beside every branch."""
        n, F = self.filter.states, self.filter.faults
        own = np.eye(self.moved)[:, self.slots - n]

        def one(mean: Array) -> Array:
            late = self.filter.plant.enters(mean[:n], u, mean[n : n + F], self.filter.probe)
            return jnp.concatenate([late[:, self.owner] * (1 - self.grows), own])

        return jax.vmap(one)(belief.mean[: self.branches])

    def _heavy(
        self, ell: Float[Array, "branches changes onsets"]
    ) -> Bool[Array, "branches kinds onsets"]:
        """The likely onsets of each kind, and the likeliest at which what came may have gone: of
        these more would leave too few for what is yet to come."""
        top, F = ell - jnp.max(ell, axis=2, keepdims=True), self.filter.faults
        came = top[:, : self.kinds] > np.log(HEAVY)
        went = (top[:, self.kinds :] >= 0) & (ell[:, self.kinds :] > NEVER / 2)
        return jnp.concatenate([came[:, :F] | went, came[:, F:]], axis=1)

    def _opened(
        self,
        t: Float[Array, ""],
        dt: Float[Array, ""],
        lanes: Lanes,
        given: tuple[Array, Array],
    ) -> tuple[Lanes, tuple[()]]:
        """An onset at this sample, behind the others, in the place of the one that is missed least:
        that whose neighbours lie closest for its age and explain what it explains, and is not
        likely."""
        every, begun = given
        ell, likely = every[:, : self.kinds], self._heavy(every)
        B, K, A = ell.shape
        used, when = lanes.mass > NEVER / 2, lanes.onset
        far = jnp.full((B, K, 1), -1e9)
        older = jnp.concatenate([far, when[:, :, :-1]], axis=2)
        younger = jnp.concatenate([when[:, :, 1:], jnp.full((B, K, 1), t)], axis=2)
        age = t + jnp.maximum(dt, TICK) - when
        gain = jnp.where(used, ell - lanes.mass, NEVER)
        none = jnp.full((B, K, 1), NEVER)
        beside = jnp.maximum(
            jnp.concatenate([none, gain[:, :, :-1]], axis=2),
            jnp.concatenate([gain[:, :, 1:], 0 * none], axis=2),
        )
        peak = jnp.exp(jnp.clip(gain - beside, 0.0, SHARPEST))
        cost = (younger - older) / age * peak + jnp.where(likely, 1e6, 0.0)
        cost = jnp.where(used, cost * (1 + TIE * np.arange(A)), -1.0)
        place = jnp.argmin(cost, axis=2)[:, :, None]
        index = np.arange(A)
        gone = index == place
        # its prior goes to the nearer neighbour, but for what that explains and it does not: no
        # change becomes likelier by what goes
        lost = jnp.where(gone & used, lanes.mass, NEVER)
        to_older = when - older <= younger - when
        more = jnp.where(gain[:, :, 1:] + gain[:, :, :-1] > NEVER / 2, jnp.diff(gain, axis=2), 0.0)
        lost_left = lost[:, :, 1:] - jnp.maximum(-more, 0.0)
        left = jnp.where(to_older[:, :, 1:], lost_left, NEVER)
        left = jnp.concatenate([left, none], axis=2)
        lost_right = lost - jnp.concatenate([jnp.maximum(more, 0.0), 0 * none], axis=2)
        right = jnp.where(to_older, NEVER, lost_right)
        fresh = jnp.log(self.prior.onset * jnp.maximum(dt, TICK))[:, None]
        fresh = jnp.logaddexp(fresh, right[:, :, -1:])
        right = jnp.concatenate([none, right[:, :, :-1]], axis=2)
        mass = jnp.logaddexp(lanes.mass, jnp.maximum(left, right))  # one of the two is none

        def moved(a: Array, new: Array | np.ndarray | float) -> Array:
            """The onsets behind the one that went, one place down; `new` at the end."""
            end = jnp.broadcast_to(new, (*a.shape[:-1], 1))
            after = jnp.concatenate([a[..., 1:], end], axis=-1)
            before = index < place if a.ndim == 3 else index < place[:, None]
            return jnp.where(before, a, after)

        # what goes leaves its row of J to what comes, which begins it anew (`_signatures`)
        row = jnp.take_along_axis(lanes.row, place, axis=2)
        told = lanes.score, lanes.info, lanes.gain, lanes.sudden, lanes.sharp, lanes.shared
        score, info, gain, sudden, sharp, shared = (moved(each, 0.0) for each in told)
        eta, row = moved(lanes.eta, begun[..., None]), moved(lanes.row, row)
        mass, went, when = moved(mass, fresh), moved(lanes.went, 0.0), moved(when, t)
        told = score, info, gain, sudden, sharp, shared, lanes.J
        return Lanes(eta, *told, row, mass, went, when), ()


def _mills(z: Float[Array, "*any"]) -> Float[Array, "*any"]:
    """exp(-z^2 / 2) / Q(z), with Q the upper tail of the normal distribution, 0.6 % too large at 3
    and less beyond (Z. W. Birnbaum, Ann. Math. Statist. 13 (1942))."""
    return np.sqrt(np.pi / 2) * (z + jnp.sqrt(z**2 + 4))


def _shared(log: Array, axis: int) -> tuple[Array, Array, Array]:
    """(the largest of `log` along `axis`, ln of the sum of exp(log), what each has of that)."""
    top = jnp.max(log, axis=axis, keepdims=True)
    each = jnp.exp(log - top)
    total = jnp.sum(each, axis=axis, keepdims=True)
    most = jnp.squeeze(top, axis)
    return most, jnp.log(jnp.squeeze(total, axis)) + most, each * (1 / total)
