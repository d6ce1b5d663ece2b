"""The innovation likelihood of levels of noise on healthy runs, by the healthy filter.

    sum_k ln N(y_k; yhat_k|k-1, S_k)

Every stretch begins with a discrepancy and constants of its own, so that what differs between runs
counts (Schweppe, IEEE TAC 11 (1965); Mehra, IEEE TAC 15 (1970)).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from faultgauge.detection.bank.extended import (
    directions_of,
    disturbed,
    error_of,
    jitter_of,
    offset_of,
    process_of,
    scale_of,
    spread_of_start,
    start_spread,
)
from faultgauge.detection.bank.noise import Noise
from faultgauge.detection.calibration.nearby_levels import Slopes, costs_nearby, slopes_of
from faultgauge.detection.rows.judged import pad_stretch, start_from_samples
from faultgauge.detection.rows.prepared import as_it_acts
from faultgauge.identification.optimise.cores import side_by_side
from faultgauge.observers import divided_difference as dd
from faultgauge.observers.divided_difference import Belief, DividedDifferenceFilter
from faultgauge.plants.disturbed import Disturbed, Error
from faultgauge.plants.model import Model
from faultgauge.programs import program
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.free_run import substeps_for
from faultgauge.simulation.lanes import lanes_last
from faultgauge.telemetry import Run, segments

__all__ = [
    "Followed",
    "LARGE",
    "SAMPLES",
    "Likelihood",
    "Likelihoods",
    "StretchPiece",
    "healthy_stretches",
]

SAMPLES = 16384  # that tell the levels
LONGEST = 4096  # of one stretch
EVEN = 512  # samples: stretches are padded to so many, twice as many, ...: few programs to compile
FEW = 3  # stretches: how far constants of runs lie apart is hardly told by fewer
AT_ONCE = 4  # levels: one compiled program for any number of them
REMEMBERED = 64  # levels of which is known what the stretches say
NEAR_AT_ONCE = 16  # levels near to another one
LARGE = 16  # numbers that a filter tracks in as many substeps: with fewer, the plant takes little

Own: TypeAlias = tuple[Error, Array, Array, dd.FilterNoise]  # of one of the levels
Carry: TypeAlias = tuple[Belief, Array, Array]


@dataclass(frozen=True)
class StretchPiece:
    """A piece of stretch `part` of run number `run`."""

    run: int
    part: int
    x: Float[np.ndarray, "states"]
    u: Float[np.ndarray, "samples inputs"]
    y: Float[np.ndarray, "samples outputs"]
    dt: Float[np.ndarray, "samples"]


class Likelihoods(NamedTuple):
    """Under each of some levels: -ln p(y) of all stretches; mean and covariance of each stretch's
    own xi; of every sample of every output the innovation in standard deviations (0: not sampled)
    and the logarithm of its standard deviation (0: not sampled)."""

    cost: Float[np.ndarray, "levels"]
    mean: Float[np.ndarray, "levels stretches directions"]
    P: Float[np.ndarray, "levels stretches directions directions"]
    white: Float[np.ndarray, "levels samples"]
    root: Float[np.ndarray, "levels samples"]


@dataclass(frozen=True)
class Likelihood:
    """The stretches, padded to one length and stacked, and what is the same for all levels. What
    the stretches said under the last levels is `known`."""

    model: Model
    x: Float[Array, "stretches states"]
    u: Float[Array, "stretches samples inputs"]
    y: Float[Array, "stretches samples outputs"]
    dt: Float[Array, "stretches samples"]
    runs: Int[np.ndarray, "stretches"]
    parts: Int[np.ndarray, "stretches"]
    columns: tuple[str, ...]
    substeps: int
    count: int
    known: dict[bytes, Likelihoods] = field(default_factory=dict, init=False, repr=False)

    @staticmethod
    def of(
        model: Model, runs: Sequence[Run], guess: Noise, stretches: Sequence[StretchPiece]
    ) -> "Likelihood":
        last = max(int(np.flatnonzero(s.dt).max(initial=0)) for s in stretches)
        length = min(max(len(s.dt) for s in stretches), EVEN * (last // EVEN + 1))

        def stacked(name: str, fill: float) -> Array:
            rows = []
            for s in stretches:
                a = getattr(s, name)[:length]
                more = np.full((length - len(a), *a.shape[1:]), fill)
                if name == "u":
                    more = np.repeat(a[-1:], length - len(a), axis=0)
                rows.append(np.concatenate([a, more]))
            return jnp.asarray(np.stack(rows))

        return Likelihood(
            model,
            jnp.asarray(np.stack([s.x for s in stretches])),
            stacked("u", 0.0),
            stacked("y", np.nan),
            stacked("dt", 0.0),
            np.array([s.run for s in stretches]),
            np.array([s.part for s in stretches]),
            tuple(runs[0].columns),
            substeps_for(runs[0].step, model.max_step),
            int(sum(np.isfinite(s.y).sum() for s in stretches)),
        )

    def beginning(self, samples: int) -> "Likelihood":
        """The first `samples` of every stretch."""
        u, y, dt = (each[:, :samples] for each in (self.u, self.y, self.dt))
        return replace(self, u=u, y=y, dt=dt, count=int(jnp.isfinite(y).sum()))

    def some(self, samples: int) -> "Likelihood":
        """About so many samples of stretches that are evenly spread, `FEW` of them at least."""
        own = np.asarray((self.dt > 0).sum(axis=1))
        many = int(np.ceil(len(own) * min(1.0, samples / max(int(own.sum()), 1))))
        many = min(max(many, FEW), len(own))
        length = -(-samples // many)
        if many == len(own) and length >= own.max():
            return self
        at = np.unique(np.linspace(0, len(own) - 1, many).round().astype(int))
        x, u, y, dt = (each[at] for each in (self.x, self.u, self.y, self.dt))
        few = replace(self, x=x, u=u, y=y, dt=dt, runs=self.runs[at], parts=self.parts[at])
        return few.beginning(length)

    def run(self, many: Sequence[Noise]) -> Likelihoods:
        """What the stretches say under each of `many` levels, a few at a time on every core."""
        names = [_bytes_of(each) for each in many]
        new = {name: each for name, each in zip(names, many, strict=True) if name not in self.known}
        told = {name: self.known[name] for name in names if name in self.known}
        if new:
            found = self._side_by_side([*new.values()], kept=False)[0]
            told |= self._remembered(new.values(), found)
        each = (told[name] for name in names)
        return Likelihoods(*map(np.concatenate, zip(*each, strict=True)))

    def _remembered(self, many: Iterable[Noise], told: Likelihoods) -> dict[bytes, Likelihoods]:
        """What is `told` of each of `many`, by its name in what is `known`."""
        named = {
            _bytes_of(n): Likelihoods(*(a[k : k + 1] for a in told)) for k, n in enumerate(many)
        }
        self.known.update(named)
        for name in [*self.known][:-REMEMBERED]:
            del self.known[name]
        return named

    def run_along(self, many: Sequence[Noise]) -> tuple[Likelihoods, list["Followed"]]:
        """As `run`, and how the filter went under each where it is `large`, for those `near` it."""
        found, steps = self._side_by_side(many, kept=True)
        self._remembered(many, found)
        kept = [(each, k) for each in steps if each is not None for k in range(AT_ONCE)]
        ones = [Likelihoods(*(a[k : k + 1] for a in found)) for k in range(len(many))]
        return found, [Followed(*each) for each in zip(many, ones, kept, strict=False)]

    def _side_by_side(
        self, many: Sequence[Noise], kept: bool
    ) -> tuple[Likelihoods, list[Slopes | None]]:
        padded = [*many, *[many[-1]] * (-len(many) % AT_ONCE)]
        chunks = [padded[k : k + AT_ONCE] for k in range(0, len(padded), AT_ONCE)]

        def told(some: Sequence[Noise]) -> tuple[tuple[np.ndarray, ...], Slopes | None]:
            found, steps = self._run(some)
            return found, steps if kept else None  # they are large

        found, steps = zip(*side_by_side(told, chunks), strict=True)
        joined = (np.concatenate(each)[: len(many)] for each in zip(*found, strict=True))
        return Likelihoods(*joined), list(steps)

    def large(self, noise: Noise) -> bool:
        """Whether the plant takes most of a filter's time: many numbers, tracked in many steps."""
        return len(scale_of(self.model, noise)) * self.substeps >= LARGE

    def near(
        self,
        many: Sequence[Noise],
        apart: Bool[np.ndarray, "many"],
        first: "Followed | None",
    ) -> Likelihoods:
        """As `run`, of levels near to the first of `many`. Where it is known how the filter went
        under the `first`, the slopes that the plant had there stand for those under all others, but
        under those to be told `apart`; nothing is told of xi then."""
        if first is None:
            return self.run(many)
        alike, whole = (np.flatnonzero(own).tolist() for own in (~apart, apart))
        padded = [*alike[1:], *[alike[-1]] * (-(len(alike) - 1) % NEAR_AT_ONCE)]
        chunks = [padded[k : k + NEAR_AT_ONCE] for k in range(0, len(padded), NEAR_AT_ONCE)]
        told = side_by_side(lambda some: self._near([many[k] for k in some], first), chunks)
        if whole:
            chunks, told = [*chunks, whole], [*told, self.run([many[k] for k in whole])]
        chunks, told = [[0], *chunks], [first.told, *told]
        found = Likelihoods(*(np.zeros((len(many), *each.shape[1:])) for each in told[0]))
        for places, each in zip(chunks, told, strict=True):
            for into, own in zip(found, each, strict=True):
                into[places] = own
        return found

    def about(self, many: Sequence[Noise]) -> Float[np.ndarray, "many"]:
        """`run`'s cost of levels that have what the first of `many` has, of others, where the plant
        takes most of the time, by the slopes under the first: enough to choose among them."""
        if not self.large(many[0]):
            return self.run(many).cost
        _, (first,) = self.run_along(many[:1])
        return self.near(many, np.zeros(len(many), bool), first).cost

    def _run(self, many: Sequence[Noise]) -> tuple[tuple[np.ndarray, ...], Slopes | None]:
        bare, error, levels, sd, scale = self._given(many)
        W = jnp.asarray(np.stack([directions_of(self.model, each) for each in many]))
        offset = jnp.asarray(np.stack([offset_of(self.model, each) for each in many]))
        keep = self.large(many[0])
        data = self.x, self.u, self.y, self.dt, self.substeps
        *found, steps = _costs(bare, error, offset, W, levels, sd, scale, *data, keep)
        return tuple(np.asarray(each) for each in found), steps

    def _near(self, many: Sequence[Noise], first: "Followed") -> Likelihoods:
        bare, error, levels, sd, scale = self._given(many, first.noise)
        (steps, level), S = first.steps, len(self.x)
        own = jax.tree.map(lambda a: np.asarray(a)[..., level * S : (level + 1) * S], steps)
        found = costs_nearby(
            bare, error, levels, sd, scale, self.x, self.u, self.y, self.dt, self.substeps, own
        )
        cost, white, root = (np.asarray(each) for each in found)
        mean, P = (np.zeros((len(many), *a.shape[1:])) for a in (first.told.mean, first.told.P))
        return Likelihoods(cost, mean, P, white, root)

    def _given(
        self, many: Sequence[Noise], first: Noise | None = None
    ) -> tuple[Disturbed, Error, dd.FilterNoise, Array, Array]:
        """The plant of the `first` levels without faults; errors, noise and what is not known of
        the start under each; the sizes of what is tracked."""
        first = first or many[0]
        drifted = spread_of_start(self.model, first.sigma, self.columns)[1]
        plant = disturbed(self.model, first)
        errors = [error_of(self.model, each) for each in many]
        error = jax.tree.map(lambda *parts: jnp.stack(parts), *errors)
        levels = dd.FilterNoise(
            jnp.asarray(np.stack([process_of(each, drifted) for each in many])),
            jnp.zeros((len(many), 0)),
            jnp.asarray(np.stack([each.sigma for each in many])),
            jitter_of(many),
        )
        sd = jnp.asarray(np.stack([start_spread(self.model, each, self.columns) for each in many]))
        bare = Disturbed.of(
            with_faults(self.model.plant, ()),
            plant.driven,
            plant.following,
            plant.error,
            plant.names,
            plant.offset,
            plant.directions,
            wandering=plant.wandering,
            lagging=plant.lagging,
            straying=plant.straying,
            doubted=plant.doubted,
            leaning=plant.leaning,
            trailing=plant.trailing,
            zeroed=plant.zeroed,
            bending=plant.bending,
            sticking=plant.sticking,
            positive=plant.positive,
        )
        return bare, error, levels, sd, jnp.asarray(scale_of(self.model, first))


def _bytes_of(noise: Noise) -> bytes:
    return b"".join(np.asarray(each).tobytes() for each in noise)


class Followed(NamedTuple):
    """The filter along the stretches under the levels `noise`: what is `told` by them, and `steps`
    of it, the stretches last, those of these levels being the part of that number."""

    noise: Noise
    told: Likelihoods
    steps: tuple[Slopes, int]


@program
def _costs(
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
    keep: bool,
) -> tuple[Array, Array, Array, Array, Array, Slopes | None]:
    """The fields of `Likelihoods`, and where they are to be kept the filters' steps."""
    more = jnp.zeros((len(x), len(scale) - x.shape[1]))
    x = jnp.concatenate([x, more], axis=1)
    own = error, offset, W, levels
    xi = plant.parts.xi

    def lane_of(own: Own) -> DividedDifferenceFilter:
        held = eqx.tree_at(lambda p: (p.error, p.offset, p.directions), plant, own[:3])
        return DividedDifferenceFilter(held, scale, jnp.zeros(0), (), substeps)

    def started(own: Own, sd: Array, x: Array) -> tuple[Belief, Array]:
        return lane_of(own).begin(x, sd), jnp.zeros(())

    def stepped(own: Own, *rest: Any) -> tuple[Belief, Array, Array, Array, Slopes | None]:
        return _sampled(lane_of(own), own[3], keep, *rest)

    # every level beside every stretch, the two in one axis that stands last
    def of_levels(a: Array) -> Array:
        return jnp.moveaxis(jnp.repeat(a, len(x), axis=0), 0, -1)

    def of_stretches(a: Array) -> Array:
        return jnp.moveaxis(jnp.concatenate([a] * len(offset)), 0, -1)

    samples = of_stretches(u), of_stretches(y), of_stretches(dt)
    given = jax.tree.map(of_levels, own), of_levels(sd), samples
    # else they would be spread anew at every step, by places that no vector is read from
    own, sd, samples = jax.lax.optimization_barrier(given)
    start = jax.vmap(started, -1, -1)(own, sd, of_stretches(x))

    def body(carry: Carry, sample: tuple[Array, Array, Array]) -> tuple[Carry, list[Any]]:
        belief, total, before = carry
        belief, total, *said = lanes_last(stepped, own, belief, total, before, *sample)
        return (belief, total, sample[0]), said

    (belief, total, _), (*said, steps) = jax.lax.scan(body, (*start, samples[0][0]), samples)

    def each(a: Array) -> Array:  # levels first, then stretches
        return jnp.moveaxis(a, -1, 0).reshape(len(offset), len(x), *a.shape[:-1])

    white, root = (each(a).reshape(len(offset), -1) for a in said)
    mean, P = each(belief.mean)[..., xi], each(belief.P)[..., xi, xi]
    return -jnp.sum(each(total), axis=1), mean, P, white, root, steps


def _sampled(
    filtering: DividedDifferenceFilter,
    noise: dd.FilterNoise,
    keep: bool,
    belief: Belief,
    total: Float[Array, ""],
    before: Float[Array, "inputs"],
    now: Float[Array, "inputs"],
    y: Float[Array, "outputs"],
    dt: Float[Array, ""],
) -> tuple[
    Belief, Float[Array, ""], Float[Array, "outputs"], Float[Array, "outputs"], Slopes | None
]:
    """The belief and the `total` likelihood after a sample, of each output the innovation and the
    logarithm of its standard deviation, and what is to be kept."""
    after, more, flow, look, seen = filtering.step(belief, noise, before, now, y, dt)
    root = jnp.where(jnp.isfinite(seen.root), jnp.log(seen.root), 0.0)
    said = more, flow, look, seen
    steps = slopes_of(filtering, belief, after, said, before, now, y) if keep else None
    return after, total + more, seen.white, root, steps


def healthy_stretches(model: Model, runs: Sequence[Run]) -> list[StretchPiece]:
    """The stretches of healthy `runs` that are long enough, each a piece of its own."""
    parts = []
    for number, log in enumerate(runs):
        acting = as_it_acts(model.plant.signals, log)
        outputs = [n for n in model.plant.signals.output_names if n in log.columns]
        for part in segments(acting.run, [*model.plant.signals.input_names, *outputs]):
            if part.stop - part.start >= 100:
                parts.append((number, acting, part))
    if not parts:
        return []
    total = sum(part.stop - part.start for *_, part in parts)
    share = min(1.0, SAMPLES / total)
    found = []
    for at, (number, acting, part) in enumerate(parts):
        count = part.stop - part.start
        pieces = max(1, int(np.ceil(share * count / LONGEST)))
        length = max(min(int(share * count / pieces), LONGEST), 100)
        for k in range(pieces):
            first = part.start + k * (count // pieces)
            piece = slice(first, min(first + length, part.stop))
            stretch = acting.cut(piece)
            start = start_from_samples(model, stretch)
            u, y, dt = pad_stretch(stretch.u, stretch.y, stretch.run.t)
            found.append(StretchPiece(number, at, start.x, u, y, dt))
    return found
