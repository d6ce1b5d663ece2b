"""Innovations under levels of noise near to others, by the slopes that the plant has under these.

A filter over a plant evaluates it twice for each number that it tracks, and under levels that
differ by a thousandth all evaluations give the same but for that thousandth's square. With A and C
the slopes of one step and of the outputs where the first filter has its mean m,

    x' = A_n x + (m' - A m),    y = C_n x + (y_m - C m),

A_n and C_n being A and C with what fades, and an input's random share, as the near levels have it:
so innovations are right to first order in what levels differ by, which is all that slopes of the
likelihood need (N. K. Gupta and R. K. Mehra, IEEE TAC 19 (1974)). The filter that was run under the
first levels leaves these slopes (`Slopes`), and nothing evaluates the plant again.
"""

from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from faultgauge.observers import divided_difference as dd
from faultgauge.observers.divided_difference import (
    Belief,
    DividedDifferenceFilter,
    Flow,
    Look,
    Seen,
)
from faultgauge.plants.disturbed import Disturbed, Error
from faultgauge.products import contract, taken
from faultgauge.programs import program
from faultgauge.simulation.lanes import lanes_last

__all__ = ["EXACT", "Slopes", "costs_nearby", "slopes_of"]

EXACT = ("trail", "bend", "slip")  # levels that change what the plant does in ways not told above

Own: TypeAlias = tuple[Error, dd.FilterNoise]  # of one of the levels
Carry: TypeAlias = tuple[Belief, Array, Array]


class Slopes(NamedTuple):
    """Samples of the first filter: its mean `m` before, `ahead` of the sample and the outputs
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
    levels: dd.FilterNoise,
    sd: Float[Array, "levels extended"],
    scale: Float[Array, "extended"],
    x: Float[Array, "stretches states"],
    u: Float[Array, "stretches samples inputs"],
    y: Float[Array, "stretches samples outputs"],
    dt: Float[Array, "stretches samples"],
    substeps: int,
    steps: Slopes,
) -> tuple[Array, Array, Array]:
    """(-ln p(y) of all stretches, white and root of `Likelihoods`) of levels near to those of the
    plant's own errors, under which the filter left these `steps`, samples first and
    stretches last."""
    count = len(sd)
    more = jnp.zeros((len(x), len(scale) - x.shape[1]))
    stretches = jnp.moveaxis(jnp.concatenate([x, more], axis=1), 0, -1)

    def filter_of(error: Error) -> DividedDifferenceFilter:
        held = eqx.tree_at(lambda p: p.error, plant, error)
        return DividedDifferenceFilter(held, scale, jnp.zeros(0), (), substeps)

    def started(own: Own, sd: Array, x: Array) -> Belief:
        return filter_of(own[0]).begin(x, sd)

    def followed(own: Own, *rest: Any) -> tuple[Belief, Array, Array, Array]:
        return _near(filter_of(own[0]), own[1], plant.error, *rest)

    def of_all(a: Array) -> Array:  # what is a stretch's, for every level
        return jnp.concatenate([a] * count, axis=-1)

    def body(carry: Carry, sample: tuple[Any, ...]) -> tuple[Carry, list[Array]]:
        near, total, before = carry
        step, now, *rest = sample
        given = jax.tree.map(of_all, (step, before, now, *rest))
        near, total, *said = lanes_last(followed, own, near, total, *given)
        return (near, total, now), said

    own, spread = jax.tree.map(
        lambda a: jnp.moveaxis(jnp.repeat(a, len(x), axis=0), 0, -1), ((error, levels), sd)
    )
    samples = jnp.moveaxis(u, 0, -1), jnp.moveaxis(y, 0, -1), jnp.moveaxis(dt, 0, -1)
    near = lanes_last(started, own, spread, of_all(stretches))
    start = near, jnp.zeros(count * len(x)), samples[0][0]
    (_, total, _), said = jax.lax.scan(body, start, (steps, *samples))
    white, root = (jnp.moveaxis(a, -1, 0).reshape(count, -1) for a in said)
    return -total.reshape(count, len(x)).sum(axis=1), white, root


def slopes_of(
    filtering: DividedDifferenceFilter,
    belief: Belief,
    after: Belief,
    said: tuple[Float[Array, ""], Flow, Look, Seen],
    before: Float[Array, "inputs"],
    now: Float[Array, "inputs"],
    y: Float[Array, "outputs"],
) -> Slopes:
    """What one sample of a filter leaves to others, which brought it from `belief` to `after` and
    of which it `said` so much."""
    likelihood, flow, look, seen = said
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
    return Slopes(belief.mean, ahead, expected, A, look.C, jump, sound)


def _near(
    filtering: DividedDifferenceFilter,
    noise: dd.FilterNoise,
    first: Error,
    belief: Belief,
    total: Float[Array, ""],
    step: Slopes,
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

    led = plant.leans(before, now, none, none)
    scale = scaled(belief.mean, step.m) * left
    own = taken(step.ahead, mixed) + moved(step.A, scale, belief.mean, step.m)
    fades = jnp.concatenate([jnp.zeros(plant.count), plant.lasting(dt, belief.mean, own)])
    ahead = taken(jnp.concatenate([own, taken(fades * belief.mean + led, plain)]), back)
    shown = scaled(ahead, step.ahead)
    A, C = step.A * scale, step.C * shown
    late = jnp.ones(n).at[parts.lag].set(plant.error.late / first.late)
    doubts = plant.doubts(before, now, belief.mean, ahead, dt)
    Q = dt * (doubts * noise.process) ** 2 + (doubts * late * step.jump) ** 2
    P = filtering.carried(A, taken(fades, plain), belief.P) + jnp.diag(Q)
    expected = step.expected + moved(step.C, shown, ahead, step.ahead)
    outputs = jnp.zeros((len(y), 0))
    look = Look(C, outputs, outputs, outputs)
    noise = filtering.sampled(noise, look, belief.mean, ahead, dt)
    after, likelihood, seen = filtering.update(Belief(ahead, P), noise, expected, look, y)
    root = jnp.where(jnp.isfinite(seen.root), jnp.log(seen.root), 0.0)
    told = jnp.where(step.sound, likelihood, dd.LOST)
    after = jax.tree.map(lambda new, old: jnp.where(step.sound, new, old), after, belief)
    quiet = jnp.where(step.sound, seen.white, 0.0), jnp.where(step.sound, root, 0.0)
    return after, total + told, *quiet


def _or_one(values: Float[Array, "some"]) -> Float[Array, "some"]:
    """`values`, and 1 in place of 0."""
    return jnp.where(values == 0, 1.0, values)
