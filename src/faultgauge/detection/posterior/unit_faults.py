"""What a unit of each fault leaves in the healthy filter's innovations along a log.

The filter runs over the log as it is: its inputs, operating points, slow sensors and gaps. With d
what a fault f does to the state less what the filter makes of it, and g what it leaves in the
innovations, in standard deviations,

    d_k = M_k [d_k-1, f],    g_k = G_k [d_k-1, f],    J = sum g g^T

(Willsky and Jones, IEEE TAC 21 (1976)), M and G being the filter's flow, look and gain at every
sample. 1 / sqrt(J) is the standard deviation of a constant fault's size beside noise, discrepancy
and uncertain constants. A fault that may go both ways counts with the mean of the two.
An onset at sample k acts from sample k - 1 on.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.bank.extended import start_spread
from faultgauge.detection.rows.judged import (
    start_from_samples,
    steps_to,
    stretches,
)
from faultgauge.detection.rows.prepared import Prepared
from faultgauge.observers.divided_difference import Belief, DividedDifferenceFilter, FilterNoise
from faultgauge.observers.follow import follow
from faultgauge.programs import program

__all__ = ["Effects", "Information", "effects_along", "effects_of", "information"]

MOST = 20_000  # rows, around the middle of a longer log


class Effects(NamedTuple):
    """At every row that the filter used: `t` [s], M, G, the innovations in standard deviations and
    the filter's states; faults as declared. What the filter believes at the `end`."""

    t: Float[np.ndarray, "samples"]
    M: Float[np.ndarray, "samples n more"]
    G: Float[np.ndarray, "samples outputs more"]
    white: Float[np.ndarray, "samples outputs"]
    x: Float[np.ndarray, "samples n"]
    end: Belief


class Information(NamedTuple):
    """By the rows `ends` (J up to and with them): `own` of a unit of each fault that begins at the
    reference onset, `other` of one that begins at each of some onsets, `shared` between both;
    `left` in the innovations by each fault of the reference onset."""

    own: Float[np.ndarray, "ends faults"]
    other: Float[np.ndarray, "ends faults onsets"]
    shared: Float[np.ndarray, "ends faults faults onsets"]
    left: Float[np.ndarray, "samples outputs faults"]


class _Healthy(eqx.Module):
    """The filter without a fault; `side` that each fault goes to: -1 down, 1 up, 0 both."""

    filter: DividedDifferenceFilter
    noise: FilterNoise
    side: Float[np.ndarray, "faults"]

    def step(
        self, state: tuple[Belief, Array], u: Array, y: Array, dt: Array
    ) -> tuple[tuple[Belief, Array], tuple[Array, ...]]:
        belief, before = state
        n, F = self.filter.states, len(self.side)
        after, _, flow, look, seen = self.filter.step(belief, self.noise, before, u, y, dt)
        up, down = (1 + self.side) / 2, (1 - self.side) / 2
        B, D = (up * each.up[:, :F] + down * each.down[:, :F] for each in (flow, look))
        M = jnp.concatenate([flow.A[:n, :n], B], axis=1)
        rows = []
        for j in range(len(seen.white)):
            row = look.C[j, :n] @ M + jnp.concatenate([jnp.zeros(n), D[j]])
            rows.append(row / seen.root[j])
            M = M - seen.gain[j, :n, None] * jnp.where(jnp.isfinite(seen.root[j]), row, 0.0)
        return (after, u), (M, jnp.stack(rows), seen.white, after.mean[:n])


def effects_of(bank: FaultBank, acting: Prepared) -> Effects:
    """The filter along a run whose inputs are those that act, or around its middle; no rows where
    nothing can be judged."""
    first = max(len(acting.u) - MOST, 0) // 2
    return effects_along(bank, acting.cut(slice(first, first + MOST)))


def effects_along(bank: FaultBank, acting: Prepared, before: Effects | None = None) -> Effects:
    """The filter along such a run; where it goes on from what was `before`, its rows have no
    gaps."""
    signals, lane = bank.model.plant.signals, bank.modes.filter
    low, high = (np.array([getattr(f, k) for f in signals.faults]) for k in ("min", "max"))
    side = np.where(low >= 0, 1.0, np.where(high <= 0, -1.0, 0.0))
    judge = _Healthy(lane, jax.tree.map(lambda a: np.asarray(a)[0], bank.modes.noise), side)
    unused = [n not in bank.outputs for n in signals.output_names]
    # the first sample has found the start: it is not to be believed twice
    sd = start_spread(bank.model, bank.noise, ())
    n, states = lane.states, len(signals.states)
    belief = _first(lane, *map(jax.device_put, (np.zeros(n), sd))) if before is None else before.end
    last = None if before is None else float(before.t[-1])
    parts = [_no_rows(n, len(signals.outputs), len(signals.faults))]
    for part in stretches(acting.run, signals.input_names or bank.outputs, bank.outputs):
        stretch = acting.cut(part)
        t, u, y = stretch.run.t, stretch.u, np.where(unused, np.nan, stretch.y)
        dt, keep = steps_to(t), np.ones(n)
        if before is not None and last is not None:
            dt[0] = t[0] - last
        else:
            x = start_from_samples(bank.model, stretch).x
            if last is not None:
                belief, keep = _after_gap(bank, belief, sd, float(t[0] - last))
            mean = np.concatenate([x, np.asarray(belief.mean)[states:]])
            belief = belief._replace(mean=jax.device_put(mean))
        (belief, _), said = follow(judge, (belief, jax.device_put(u[0])), (u, y, dt))
        for each in said[:2]:
            each[0, :, :n] *= keep
        parts.append((t, *said))
        last = float(t[-1])
    t, M, G, white, x = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Effects(t, M, G, white, x, belief)


@program
def _first(lane: DividedDifferenceFilter, mean: Array, sd: Array) -> Belief:
    """What is known where a log begins."""
    return lane.begin(mean, sd)


def _no_rows(n: int, outputs: int, faults: int) -> tuple[np.ndarray, ...]:
    more = n + faults
    shapes = (0,), (0, n, more), (0, outputs, more), (0, outputs), (0, n)
    return tuple(np.zeros(shape) for shape in shapes)


def _after_gap(
    bank: FaultBank, belief: Belief, sd: Float[np.ndarray, "extended"], gap: float
) -> tuple[Belief, Float[np.ndarray, "n"]]:
    """(what is known after a `gap` [s], which shares of d outlast it): states begin anew, the
    discrepancy lasts as it does, constants but for what a gap makes anew of them."""
    states = len(bank.model.plant.signals.states)
    n = bank.modes.filter.states
    keep = np.ones(n)
    keep[:states] = 0.0
    parts = bank.plant.parts
    lasting = np.exp(-gap / np.asarray(bank.plant.times))
    for part in (parts.d, parts.b, parts.a):
        keep[part] = lasting[part.start - states : part.stop - states]
    keep[n - len(bank.noise.renewed) :] = np.sqrt(1 - bank.noise.renewed)
    fresh = sd**2
    faults = len(belief.mean) - n
    whole = np.append(keep, np.ones(faults))
    more = np.append((1 - keep**2) * fresh, np.zeros(faults))
    P = np.asarray(belief.P) * np.outer(whole, whole) + np.diag(more)
    return Belief(*map(jax.device_put, (np.asarray(belief.mean) * whole, P))), keep


class _Unfolding(eqx.Module):
    """Faults that begin at some `onset` rows, the first of which is the reference."""

    onset: Int[Array, "onsets"]

    def step(self, state: tuple[Array, ...], M: Array, G: Array) -> tuple[tuple[Array, ...], Array]:
        k, d, own, other, shared = state
        n, F, A = d.shape
        there = (k >= self.onset) * 1.0
        g = (G[:, :n] @ d.reshape(n, F * A)).reshape(-1, F, A) + G[:, n:, None] * there
        d = (M[:, :n] @ d.reshape(n, F * A)).reshape(n, F, A) + M[:, n:, None] * there
        mine = g[:, :, 0]
        own = own + jnp.sum(mine**2, axis=0)
        other = other + jnp.sum(g**2, axis=0)
        shared = shared + jnp.einsum("mi,mja->ija", mine, g)
        return (k + 1, d, own, other, shared), mine


def information(
    effects: Effects, reference: int, onsets: Sequence[int], ends: Sequence[int]
) -> Information:
    """J by each of the increasing rows `ends` of faults that begin at row `reference`, and beside
    them at `onsets`."""
    n = effects.x.shape[1]
    F, A = effects.M.shape[2] - n, 1 + len(onsets)
    first = min([reference, *onsets])
    judge = _Unfolding(jax.device_put(np.array([reference, *onsets]) - first))
    shapes = (n, F, A), (F,), (F, A), (F, F, A)
    state = tuple(map(jax.device_put, (np.asarray(0), *map(np.zeros, shapes))))
    rows, left = list[tuple[np.ndarray, ...]](), [np.zeros((first, effects.G.shape[1], F))]
    for end in ends:
        if end + 1 > first:
            part = slice(first, end + 1)
            state, mine = follow(judge, state, (effects.M[part], effects.G[part]))
            left.append(mine)
            first = end + 1
        rows.append(tuple(np.asarray(each) for each in state[2:]))
    own, other, shared = (np.stack(each) for each in zip(*rows, strict=True))
    return Information(own, other[:, :, 1:], shared[:, :, :, 1:], np.concatenate(left))
