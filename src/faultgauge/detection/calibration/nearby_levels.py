"""Innovations under levels of noise near to others, by the slopes that the plant has under these.

A filter over a plant evaluates it twice for each number that it tracks, and under levels that
differ by a thousandth all evaluations give the same but for that thousandth's square. With A and C
the slopes of one step and of the outputs where the first filter has its mean m,

    x' = A_n x + (m' - A m),    y = C_n x + (y_m - C m),

A_n and C_n being A and C with what fades, and an input's random share, as the near levels have it:
so innovations are right to first order in what levels differ by, which is all that slopes of the
likelihood need (N. K. Gupta and R. K. Mehra, IEEE TAC 19 (1974)).
"""

from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from faultgauge.observers import divided_difference as dd
from faultgauge.observers.divided_difference import Belief, DividedDifferenceFilter, Look
from faultgauge.plants.disturbed import Disturbed, Error
from faultgauge.products import contract, taken
from faultgauge.programs import program
from faultgauge.simulation.lanes import lanes_last

__all__ = ["EXACT", "costs_nearby"]

EXACT = ("trail", "bend", "slip")  # levels that change what the plant does in ways not told above

Own: TypeAlias = tuple[Error, dd.FilterNoise]  # of one of the levels
Carry: TypeAlias = tuple[Belief, Belief, Array, Array]


class _Step(NamedTuple):
    """One sample of the first filter: its mean `m` before, `ahead` of the sample and the outputs
    `expected` there; the rows of A that hang on many numbers, C, by what the states may jump, and
    whether all that is a number."""

    m: Float[Array, "n"]
    ahead: Float[Array, "n"]
    expected: Float[Array, "outputs"]
    A: Float[Array, "mixed n"]
    C: Float[Array, "outputs n"]
    jump: Float[Array, "n"]
    sound: Bool[Array, ""]


@program
def costs_nearby(
    plant: Disturbed,
    error: Error,
    offset: Float[Array, "levels parameters"],
    W: Float[Array, "levels parameters directions"],
    levels: dd.FilterNoise,
    sd: Float[Array, "levels extended"],
    scale: Float[Array, "extended"],
    x: Float[Array, "stretches states"],
    u: Float[Array, "stretches samples inputs"],
    y: Float[Array, "stretches samples outputs"],
    dt: Float[Array, "stretches samples"],
    substeps: int,
) -> tuple[Array, Array, Array, Array, Array]:
    """The fields of `Likelihoods`, of levels near to the first; nothing of xi."""
    count = len(offset)
    more = jnp.zeros((len(x), len(scale) - x.shape[1]))
    stretches = jnp.moveaxis(jnp.concatenate([x, more], axis=1), 0, -1)
    plant = eqx.tree_at(lambda p: (p.offset, p.directions), plant, (offset[0], W[0]))
    error0, noise0, sd0 = jax.tree.map(lambda a: a[0], (error, levels, sd))

    def filter_of(error: Error) -> DividedDifferenceFilter:
        held = eqx.tree_at(lambda p: p.error, plant, error)
        return DividedDifferenceFilter(held, scale, jnp.zeros(0), (), substeps)

    begins = filter_of(error0)

    def started(own: Own, sd: Array, x: Array) -> Belief:
        return filter_of(own[0]).begin(x, sd)

    def followed(own: Own, *rest: Any) -> tuple[Belief, Array, Array, Array]:
        return _near(filter_of(own[0]), own[1], error0, *rest)

    def of_all(a: Array) -> Array:  # what is a stretch's, for every level
        return jnp.concatenate([a] * count, axis=-1)

    def body(carry: Carry, sample: tuple[Array, Array, Array]) -> tuple[Carry, list[Array]]:
        center, near, total, before = carry
        own_row = (center, before, *sample)
        center, step = lanes_last(lambda *row: _first(begins, noise0, *row), *own_row)
        given = jax.tree.map(of_all, (step, before, *sample))
        near, total, *said = lanes_last(followed, own, near, total, *given)
        return (center, near, total, sample[0]), said

    own, spread = jax.tree.map(
        lambda a: jnp.moveaxis(jnp.repeat(a, len(x), axis=0), 0, -1), ((error, levels), sd)
    )
    samples = jnp.moveaxis(u, 0, -1), jnp.moveaxis(y, 0, -1), jnp.moveaxis(dt, 0, -1)
    near = lanes_last(started, own, spread, of_all(stretches))
    center = lanes_last(lambda x: begins.begin(x, sd0), stretches)
    start = center, near, jnp.zeros(count * len(x)), samples[0][0]
    (_, _, total, _), said = jax.lax.scan(body, start, samples)
    white, root = (jnp.moveaxis(a, -1, 0).reshape(count, -1) for a in said)
    mean = jnp.zeros((count, len(x), W.shape[2]))
    P = jnp.zeros((*mean.shape, W.shape[2]))
    return -total.reshape(count, len(x)).sum(axis=1), mean, P, white, root


def _first(
    filtering: DividedDifferenceFilter,
    noise: dd.FilterNoise,
    belief: Belief,
    before: Float[Array, "inputs"],
    now: Float[Array, "inputs"],
    y: Float[Array, "outputs"],
    dt: Float[Array, ""],
) -> tuple[Belief, _Step]:
    """One sample of the first filter, and what the others take of it."""
    after, likelihood, flow, look, seen = filtering.step(belief, noise, before, now, y, dt)
    plant, none, there = filtering.plant, jnp.zeros(0), jnp.isfinite(seen.root)
    off = jnp.where(there, seen.root * seen.white, 0.0)
    moves = off[:, None] * seen.gain  # of the mean, by one output after another
    ahead = after.mean - jnp.sum(moves, axis=0)
    earlier = jnp.cumsum(moves, axis=0) - moves
    expected = jnp.where(there, y - off - jnp.sum(look.C * earlier, axis=1), 0.0)
    moved = ahead - plant.leans(before, now, none, none)
    jump = plant.jumps(moved, before, now, none, none)
    A = taken(flow.A, filtering.rows(len(ahead))[0])
    sound = likelihood != dd.LOST
    return after, _Step(belief.mean, ahead, expected, A, look.C, jump, sound)


def _near(
    filtering: DividedDifferenceFilter,
    noise: dd.FilterNoise,
    first: Error,
    belief: Belief,
    total: Float[Array, ""],
    step: _Step,
    before: Float[Array, "inputs"],
    now: Float[Array, "inputs"],
    y: Float[Array, "outputs"],
    dt: Float[Array, ""],
) -> tuple[Belief, Float[Array, ""], Float[Array, "outputs"], Float[Array, "outputs"]]:
    """One sample of a filter whose levels are near to the `first` ones: (belief, -cost so far, and
    of each output the innovation in standard deviations and the logarithm of one)."""
    plant, n = filtering.plant, len(step.m)
    mixed, plain, back = filtering.rows(n)
    parts, none = plant.parts, jnp.zeros(0)
    # e = share r h is in proportion to share and h, and, as a and v are, in the mean of a step to
    # what is left then; no filter has slopes over h, of which it is sure
    share = plant.error.share / first.share
    left = plant.meanwhile(dt) / eqx.tree_at(lambda p: p.error, plant, first).meanwhile(dt)
    left = left.at[parts.r].set(left[parts.h])

    def scaled(own: Array, its: Array) -> Array:
        h = jnp.where(its[parts.h] == 0, 1.0, own[parts.h] / _or_one(its[parts.h]))
        return jnp.ones(n).at[parts.r].set(share * h).at[parts.h].set(0.0)

    def moved(slopes: Array, scale: Array, own: Array, its: Array) -> Array:
        return contract("ij,j->i", slopes, jnp.where(scale == 0, 0.0, scale * own - its))

    fades = jnp.concatenate([jnp.zeros(plant.count), plant.lasting(dt)])
    led = plant.leans(before, now, none, none)
    scale = scaled(belief.mean, step.m) * left
    own = taken(step.ahead, mixed) + moved(step.A, scale, belief.mean, step.m)
    ahead = taken(jnp.concatenate([own, taken(fades * belief.mean + led, plain)]), back)
    shown = scaled(ahead, step.ahead)
    A, C = step.A * scale, step.C * shown
    late = jnp.ones(n).at[parts.lag].set(plant.error.late / first.late)
    doubts = plant.doubts(before, now)
    Q = dt * (doubts * noise.process) ** 2 + (doubts * late * step.jump) ** 2
    P = filtering.carried(A, taken(fades, plain), belief.P) + jnp.diag(Q)
    expected = step.expected + moved(step.C, shown, ahead, step.ahead)
    outputs = jnp.zeros((len(y), 0))
    look = Look(C, outputs, outputs, outputs)
    after, likelihood, seen = filtering.update(Belief(ahead, P), noise, expected, look, y)
    root = jnp.where(jnp.isfinite(seen.root), jnp.log(seen.root), 0.0)
    told = jnp.where(step.sound, likelihood, dd.LOST)
    after = jax.tree.map(lambda new, old: jnp.where(step.sound, new, old), after, belief)
    quiet = jnp.where(step.sound, seen.white, 0.0), jnp.where(step.sound, root, 0.0)
    return after, total + told, *quiet


def _or_one(values: Float[Array, "some"]) -> Float[Array, "some"]:
    """`values`, and 1 in place of 0."""
    return jnp.where(values == 0, 1.0, values)
