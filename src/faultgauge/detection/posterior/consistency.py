"""Whether the likeliest explanation explains: normalised innovations squared, as in healthy logs.

The bank weighs explanations against each other, and of those that are all wrong one is the best.
Under a right one innovations are as small as in healthy logs, in the mean of each window

    nis = sum_k nu_k^T S_k^-1 nu_k / (samples x outputs)

(Y. Bar-Shalom, X. Li and T. Kirubarajan, Estimation with Applications to Tracking and Navigation
(2001), section 5.4). Where they are larger than `limit` something undeclared is there, and what
fits now and then is not told: a name has to have been likely for as long as others were since that
began, and for as long as the model's own error lasts at least, as that of a broken propeller is,
which shakes what it drives.

Nor do names explain that take each other's place faster than faults come. How much likelier it is
that they do so every few memories (rate b) than as rarely as faults (a) a sum tells that never
falls below 0,

    S <- max(S + n ln(b / a) - (b - a) dt, 0)

with n changes within dt, two by a name in place of one that has gone, be it of the same fault's
other direction, none by the same one again, nor by one that comes beside another, nor by one that
comes after a memory in which no fault was likely, where what has gone had been so for a memory, too
(E. S. Page, Biometrika 41 (1954); of a Poisson process: J. M. Lucas, Technometrics 27 (1985)).
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from faultgauge.detection.bank.bank import CERTAIN, FaultBank
from faultgauge.detection.bank.priors import ALIEN
from faultgauge.detection.posterior.posterior import LIKELY
from faultgauge.detection.posterior.verdicts import NAMED
from faultgauge.observers.branches import BranchInfo
from faultgauge.products import contract

__all__ = ["Consistency", "ConsistencyState", "limit_of"]

BEYOND = 4.0  # times as far above the median as the worst of healthy logs
QUICK = 4.0  # memories between changes where declared faults imitate something else in turn
USUAL = 64.0  # memories between them at least where they come and go
RESTLESS = CERTAIN - float(np.log(ALIEN))  # of the sum above: from there on it is surely that


class ConsistencyState(NamedTuple):
    """How long rows have come, gaps apart (`t`); of that: since when the likeliest fault explains
    too little; when it had done so for long first and last; since when each fault is likely on its
    `side` (downwards or upwards, -1 or 1) [s]. NaN: not lately. Which faults are `named`, which of
    them, by its side, was the last that has `gone` (-1: none), whether its place is `vacant` since,
    how long that had been likely (`lived`) [s], since when no fault is (`sound`) [s], and the sum
    by which names change too often (`restless`)."""

    t: Float[Array, ""]
    too_little: Float[Array, ""]
    first: Float[Array, ""]
    last: Float[Array, ""]
    since: Float[Array, "faults"]
    side: Int[Array, "faults"]
    named: Bool[Array, "faults"]
    gone: Int[Array, ""]
    vacant: Bool[Array, ""]
    lived: Float[Array, ""]
    sound: Float[Array, ""]
    restless: Float[Array, ""]


class Consistency(eqx.Module):
    """`limit` of each window, the longest of which is `window` [s]; a fault is known within the
    `memory` [s], and outlasts the model's own error after `outlasts` [s]; names change at one of
    two `rates` [1/s], the usual one and that of something undeclared, and a fault `waits` [s] for
    its own; `holds` is 1 where a set (the unknown last) has a fault, and `active` where one raises
    alarms. Pure `init` and `step`."""

    limit: Float[np.ndarray, "windows"]
    memory: Float[np.ndarray, ""]
    window: Float[np.ndarray, ""]
    outlasts: Float[np.ndarray, ""]
    rates: Float[np.ndarray, "two"]
    waits: Float[np.ndarray, "faults"]
    holds: Float[np.ndarray, "sets faults"]
    active: Bool[np.ndarray, "faults"]

    @staticmethod
    def of(bank: FaultBank) -> "Consistency":
        memory = np.asarray(bank.knowledge.memory)
        longest = np.asarray(np.max(bank.modes.windows) * memory)
        outlasts = np.asarray(bank.outlasts)
        holds = _holds(bank.sets, bank.modes.declared)
        active = np.asarray(bank.with_monitor("active"), bool)
        rates = 1 / (np.array([USUAL, QUICK]) * memory)
        waits = bank.waits[:-1]
        return Consistency(bank.nis, memory, longest, outlasts, rates, waits, holds, active)

    def init(self) -> ConsistencyState:
        nothing = jnp.asarray(jnp.nan)
        likely = jnp.full(self.holds.shape[1], jnp.nan)
        side, zero = jnp.ones(likely.shape, int), jnp.zeros(())
        since, places = (nothing, nothing, nothing, likely), (jnp.asarray(-1), jnp.asarray(False))
        return ConsistencyState(zero, *since, side, likely > 0, *places, zero, nothing, zero)

    def step(
        self, state: ConsistencyState, dt: Float[Array, ""], said: BranchInfo
    ) -> tuple[ConsistencyState, BranchInfo]:
        """`said` `dt` [s] after the row before, 0 behind a gap; while something undeclared is
        there, until it has not shown for as long as it has come and gone, a window at least, sets
        are those of their lasting faults, and sets without one are that."""
        t = state.t + dt
        lasted = jnp.maximum(state.last - state.first, self.window)
        on = t <= state.last + lasted
        beyond = (said.faulty > 0) & jnp.any(said.nis > self.limit)
        too_little = jnp.where(jnp.isnan(state.too_little), t, state.too_little)
        too_little = jnp.where(beyond, too_little, jnp.nan)
        likely = contract("s,sk->k", said.p, self.holds)
        size = contract("s,sk->k", said.p, jnp.where(self.holds > 0, said.f, 0.0))
        side = jnp.where(size < 0, -1, 1)
        goes_on = (likely >= LIKELY) & (side == state.side) & ~jnp.isnan(state.since)
        since = jnp.where(likely >= LIKELY, jnp.where(goes_on, state.since, t), jnp.nan)
        told = (t - since >= self.waits) & (likely >= NAMED)
        named = (told | (state.named & goes_on)) & self.active
        # what comes takes the place of what went, if it is not the same again
        went, comes = state.named & ~named, named & ~state.named
        before, causes = (2 * np.arange(len(named)) + (each > 0) for each in (state.side, side))
        gone = jnp.where(jnp.any(went), jnp.max(jnp.where(went, before, -1)), state.gone)
        sound = jnp.where(jnp.isnan(state.sound), t, state.sound)
        sound = jnp.where(said.p[0] >= LIKELY, sound, jnp.nan)
        last_for = jnp.min(jnp.where(went, t - state.since, jnp.inf))
        lived = jnp.where(jnp.any(went), last_for, state.lived)
        over = (t - sound >= self.memory) & (lived >= self.memory)
        vacant = (state.vacant | jnp.any(went)) & ~over
        again = comes & (causes == gone)
        changes = 2 * (vacant & jnp.any(comes) & ~jnp.any(again))
        usual, quick = self.rates
        restless = state.restless + changes * jnp.log(quick / usual) - dt * (quick - usual)
        restless = jnp.maximum(restless, 0.0)
        now = (t - too_little >= self.memory) | (restless >= RESTLESS)
        first = jnp.where(on, state.first, jnp.where(now, t, jnp.nan))
        last = jnp.where(now, t, jnp.where(on, state.last, jnp.nan))
        lasting = t - since >= jnp.maximum(since - first, self.outlasts)
        p = jnp.where(on | now, self._lasting(said.p, lasting), said.p)
        places = gone, vacant & ~jnp.any(comes), lived, sound
        after = ConsistencyState(t, too_little, first, last, since, side, named, *places, restless)
        sampled = jnp.isfinite(said.p[0])
        after = jax.tree.map(lambda new, old: jnp.where(sampled, new, old), after, state)
        return after, said._replace(p=p)

    def _lasting(
        self, p: Float[Array, "sets"], lasting: Bool[Array, "faults"]
    ) -> Float[Array, "sets"]:
        """`p` with that of each set at the one of its `lasting` faults alone, or at the unknown;
        what raises an alarm still does, and nothing else."""
        known = self.holds[:-1]
        left = known * lasting
        becomes = jnp.all(left[:, None] == known, axis=2)  # of none: what a set without any is
        alarms = (known * self.active).any(axis=1)
        lost = jnp.where(alarms & ~jnp.any(left * self.active > 0, axis=1), p[:-1], 0.0)
        moved = contract("st,s->t", becomes.astype(float), p[:-1] - lost)
        return jnp.append(moved, p[-1] + jnp.sum(lost))


def _holds(sets: Sequence[tuple[int, ...]], faults: int) -> Float[np.ndarray, "sets faults"]:
    return np.array([[float(k in each) for k in range(faults)] for each in (*sets, ())])


def limit_of(nis: Float[np.ndarray, "samples windows"]) -> Float[np.ndarray, "windows"]:
    """The limits by what healthy logs show."""
    usual = np.median(nis, axis=0)
    return usual + BEYOND * (nis.max(axis=0) - usual)
