"""How far the plant is from its model, by innovation likelihood on healthy runs.

    maximise  sum_k ln N(y_k; yhat_k|k-1, S_k)

over the noise of outputs and states, the size s and the time constant tau of the discrepancy beside
every state that is not exact kinematics, and the spread of the constants from run to run (Schweppe,
IEEE TAC 11 (1965); Mehra, IEEE TAC 15 (1970)), with the healthy filter of the bank. Every stretch
begins with a discrepancy and constants of its own, so that what differs between runs counts. No
discrepancy, and one that walks without end, are limits of it: s = 0, tau without bound.

Where a log is sampled far faster than it moves, means over blocks of samples tell the same, and
what noise of a few samples' memory adds up to.

What one log cannot tell is held by weak priors: constants differ by a percent or so from run to
run, and a discrepancy is some percent of what its state does, and lasts a tenth of a log or so.

Between searches over the others, the constants' mean and spread follow from what each stretch says
of its own (the EM algorithm: Dempster, Laird and Rubin, J. R. Statist. Soc. B 39 (1977)),

    mean = avg m_r,    C = (sum_r (m_r - mean)^2 + V_r + C_0) / (R + 1),

the fitted values being those of one more run, and constants of one unit pooled, since few runs tell
each one's spread badly. What of it lies between the stretches of one run, a gap makes anew: a
vehicle that has landed flies on with another trim.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.optimize import minimize

from faultgauge.detection.judged import (
    operating_points,
    pad_stretch,
    record_arrays,
    start_from_samples,
)
from faultgauge.detection.noise import (
    Noise,
    constants_of,
    directions_of,
    disturbed,
    drifting_of,
    error_of,
    offset_of,
    process_of,
    rates_of,
    scale_of,
    spread_of_start,
    start_spread,
    usual_spread,
    width_of,
)
from faultgauge.errors import InputError
from faultgauge.identification.samples import in_effect
from faultgauge.observers import divided_difference as dd
from faultgauge.observers.divided_difference import Belief, DividedDifferenceFilter
from faultgauge.plants.disturbed import Disturbed, Error, dynamic_states, following_states
from faultgauge.plants.model import Model
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.free_run import substeps_for
from faultgauge.telemetry import Run, segments
from faultgauge.telemetry.oversampling import block_means

__all__ = ["estimate_noise"]

SAMPLES = 16384  # that tell the levels
LONGEST = 4096  # of one stretch
REACH = np.log(1e4)  # a level is looked for within this factor of its first guess
DIFFERENCE = 1e-4  # of a logarithm, for the slope of the likelihood
GRID = 4  # time constants to begin from
SMALLER = (1.0, 10.0, 100.0)  # times: sizes of the discrepancy to begin from
FACTORS = (1.0, 10.0, 100.0, 1000.0)  # of process noise, until the filter is not lost
ROUNDS = (20, 12, 8)  # steps of each search; the constants are told anew between them
USUAL_SIZE = 0.03  # of a state's rate: the discrepancy
USUAL_SHARE = 0.1  # of an input's effect: what a change of it is off by
QUICK = 10.0  # samples in which that settles
ALIKE = 10.0  # times: constants of one unit that differ by more are of two kinds
UNSURE = 1.5  # standard deviation of the logarithms of these
ENOUGH = 0.03  # of log-likelihood: a step that gains less is the last
SEARCHED = Noise._fields.index("spread")  # the levels before the constants' are
NONE = 1e-6  # times the usual: as good as no discrepancy


@dataclass(frozen=True)
class _Stretch:
    """A piece of stretch `part` of run number `run`."""

    run: int
    part: int
    x: Float[np.ndarray, "states"]
    u: Float[np.ndarray, "samples inputs"]
    y: Float[np.ndarray, "samples outputs"]
    dt: Float[np.ndarray, "samples"]


def estimate_noise(model: Model, runs: Sequence[Run], discrepancy: bool = True) -> Noise:
    """The most likely levels on healthy `runs`; without a `discrepancy` all error is noise.

    Raises `InputError` where no stretch is long enough or the filter never follows the data.
    """
    names = [n for n in model.plant.signals.output_names if n in runs[0].columns]
    total = sum(len(run.t) for run in runs)
    runs, averaged = block_means(runs, names, total / SAMPLES)
    stretches = _stretches(model, runs)
    if not stretches:
        raise InputError(
            f"{runs[0].source}: no stretch of healthy data is long enough to tell the noise; give "
            "at least 100 samples in a row."
        )
    noise = _guess(model, runs, stretches)
    low, high, pull = _limits(noise, runs[0].step, stretches)
    batch = _Batch.of(model, runs, noise, stretches)
    free = np.ones(len(low), bool)
    if not discrepancy:
        noise = noise._replace(**{n: NONE * getattr(noise, n) for n in ("size", "share", "spread")})
        fixed = ("size", "lasting", "share", "settling")
        names = np.repeat(Noise._fields[:SEARCHED], [len(part) for part in noise[:SEARCHED]])
        free = ~np.isin(names, fixed)
    center = _logs(noise)
    if discrepancy:
        noise = _started(model, batch, noise, (low, high, pull, center))
    for steps in ROUNDS:
        noise = _searched(model, batch, noise, (low, high, pull, center), free, steps)
        if discrepancy:
            noise = _retold(model, batch, noise)
    more = [averaged.get(name, 1.0) for name in model.plant.signals.output_names]
    return noise._replace(sigma=noise.sigma * np.sqrt(more))


def _started(
    model: Model,
    batch: "_Batch",
    noise: Noise,
    limits: tuple[Float[np.ndarray, "levels"], ...],
) -> Noise:
    """`noise` with process noise from which on the filter is not lost, and the likeliest of some
    time constants and sizes, whatever the rate of the log is."""
    low, high, pull, center = limits
    sizes = np.cumsum([len(part) for part in noise[:SEARCHED]])[:-1]
    least, most = (_levels(np.exp(a), sizes, noise) for a in (low, high))

    def best(many: list[Noise]) -> Noise:
        prior = [0.5 * np.sum(((_logs(each) - center) / pull) ** 2) for each in many]
        return many[int(np.argmin(batch.run(model, many)[0] + prior))]

    def between(name: str, share: float) -> Float[np.ndarray, "some"]:
        return getattr(least, name) ** (1 - share) * getattr(most, name) ** share

    many = [noise._replace(process=factor * noise.process) for factor in FACTORS]
    cost = batch.run(model, many)[0] / batch.count
    noise = many[int(np.argmax(cost < cost.min() + dd.FAR**2 / 2))]
    shares = np.arange(1, GRID + 1) / (GRID + 1)
    if len(noise.settling):
        noise = best([noise, *(noise._replace(settling=between("settling", a)) for a in shares)])
    both = [(between("lasting", a), noise.size / b) for a in shares for b in SMALLER]
    return best([noise, *(noise._replace(lasting=a, size=b) for a, b in both)])


def _logs(noise: Noise) -> Float[np.ndarray, "levels"]:
    """The logarithms of all levels but the constants'."""
    return np.log(np.concatenate(noise[:SEARCHED]))


def _searched(
    model: Model,
    batch: "_Batch",
    noise: Noise,
    limits: tuple[Float[np.ndarray, "levels"], ...],
    free: Bool[np.ndarray, "levels"],
    most: int,
) -> Noise:
    """The likeliest `free` levels, by at most so many steps of L-BFGS from `noise`."""
    low, high, pull, center = limits
    start, at = _logs(noise), np.flatnonzero(free)
    sizes = np.cumsum([len(part) for part in noise[:SEARCHED]])[:-1]
    steps = np.concatenate([np.zeros((1, len(start))), DIFFERENCE * np.eye(len(start))[at]])

    def cost(x: Float[np.ndarray, "free"]) -> tuple[float, Float[np.ndarray, "free"]]:
        logs = start.copy()
        logs[at] = x
        many = [_levels(np.exp(row), sizes, noise) for row in logs + steps]
        total = batch.run(model, many)[0]
        total = total + 0.5 * np.sum(((logs + steps - center) / pull) ** 2, axis=1)
        return float(total[0] / batch.count), (total[1:] - total[0]) / DIFFERENCE / batch.count

    found: Any = minimize(
        cost,
        np.clip(start, low, high)[at],
        jac=True,
        method="L-BFGS-B",
        bounds=np.stack([low, high], axis=1)[at],
        options={"maxiter": most, "ftol": ENOUGH / batch.count},
    )
    if not np.all(np.isfinite(found.x)) or not found.fun < -dd.LOST / 4:
        raise InputError(
            "the model does not follow the healthy logs at all, so its noise cannot be told; look "
            "at `faultgauge evaluate`."
        )
    logs = start.copy()
    logs[at] = found.x
    return _levels(np.exp(logs), sizes, noise)


def _levels(
    values: Float[np.ndarray, "levels"], sizes: Int[np.ndarray, "parts"], noise: Noise
) -> Noise:
    """`values` in their places, and the constants of `noise`."""
    parts: list[Any] = [*np.split(values, sizes), *noise[SEARCHED:]]
    return Noise(*parts)


def _retold(model: Model, batch: "_Batch", noise: Noise) -> Noise:
    """`noise` with the constants' mean and spread as every stretch's own say."""
    known, skip = constants_of(model), len(drifting_of(model))
    if not known.names:
        return noise
    cost, mean, P = batch.run(model, [noise])
    for _ in range(2):
        W = directions_of(model, known, noise.spread)[skip:, skip:]
        own = mean[0, :, skip:] @ W.T
        V = np.einsum("ij,rjk,ik->ri", W, P[0][:, skip:, skip:], W)
        off = np.concatenate([noise.shift + own, np.zeros((1, own.shape[1]))])  # the fit: one more
        mean_off, count = off.mean(axis=0), len(off)
        values = [float(model.plant.parameters[n]) for n in known.names]
        usual = np.array([usual_spread(value, 0.0) for value in values])
        sums = np.sum((off - mean_off) ** 2, axis=0) + V.sum(axis=0)
        squares = _pooled(model, known.names, sums)
        spread = np.sqrt((squares + usual**2) / (count + 1) * (1 + 1 / count))
        new = _pooled(model, known.names, _within(batch, own, V)) / spread**2
        told = noise._replace(spread=spread, shift=mean_off, renewed=np.clip(new, 0.0, 1.0))
        after, mean, P = batch.run(model, [told])
        if after[0] > cost[0] + len(usual):  # what a prior may take: here the filter is lost
            break
        noise, cost = told, after
    return noise


def _within(
    batch: "_Batch",
    own: Float[np.ndarray, "stretches constants"],
    V: Float[np.ndarray, "stretches constants"],
) -> Float[np.ndarray, "constants"]:
    """Variance of the constants between the stretches of one run, beyond what is not known of them;
    0 where no run has two."""
    found = []
    for run in np.unique(batch.runs):
        parts = np.unique(batch.parts[batch.runs == run])
        if len(parts) > 1:
            means, unsure = (
                np.stack([a[batch.parts == part].mean(axis=0) for part in parts]) for a in (own, V)
            )
            found.append(np.var(means, axis=0, ddof=1) - unsure.mean(axis=0))
    return np.maximum(np.mean(found, axis=0), 0.0) if found else np.zeros(own.shape[1])


def _pooled(
    model: Model, names: Sequence[str], sums: Float[np.ndarray, "constants"]
) -> Float[np.ndarray, "constants"]:
    """`sums` as their mean over the constants of one unit and order of magnitude."""
    parameters = {p.name: p for p in model.plant.spec.parameters}
    usual = np.array([usual_spread(float(model.plant.parameters[n]), 0.0) for n in names])
    units = [parameters[n].unit or n for n in names]
    found = np.array(sums, float)
    for unit in set(units):
        own = sorted((k for k, each in enumerate(units) if each == unit), key=lambda k: usual[k])
        apart = [i for i, (a, b) in enumerate(pairwise(own), 1) if usual[b] > ALIKE * usual[a]]
        for alike in np.split(np.array(own), apart):
            found[alike] = np.mean(found[alike])
    return found


@dataclass(frozen=True)
class _Batch:
    """The stretches, padded to one length and stacked, and what is the same for all levels."""

    x: Float[Array, "stretches states"]
    u: Float[Array, "stretches samples inputs"]
    y: Float[Array, "stretches samples outputs"]
    dt: Float[Array, "stretches samples"]
    runs: Int[np.ndarray, "stretches"]
    parts: Int[np.ndarray, "stretches"]
    columns: tuple[str, ...]
    substeps: int
    count: int

    @staticmethod
    def of(
        model: Model, runs: Sequence[Run], guess: Noise, stretches: Sequence[_Stretch]
    ) -> "_Batch":
        length = max(len(s.dt) for s in stretches)

        def stacked(name: str, fill: float) -> Array:
            rows = []
            for s in stretches:
                a = getattr(s, name)
                more = np.full((length - len(a), *a.shape[1:]), fill)
                if name == "u":
                    more = np.repeat(a[-1:], length - len(a), axis=0)
                rows.append(np.concatenate([a, more]))
            return jnp.asarray(np.stack(rows))

        return _Batch(
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

    def run(
        self, model: Model, many: Sequence[Noise]
    ) -> tuple[
        Float[np.ndarray, "levels"],
        Float[np.ndarray, "levels stretches directions"],
        Float[np.ndarray, "levels stretches directions directions"],
    ]:
        """(-ln p(y) of all stretches under each of `many` levels; mean and covariance of each
        stretch's own xi)."""
        known = constants_of(model)
        drifted = spread_of_start(model, many[0].sigma, self.columns)[1]
        plant = disturbed(model, many[0])
        W = jnp.asarray(np.stack([directions_of(model, known, each.spread) for each in many]))
        offset = jnp.asarray(np.stack([offset_of(model, each) for each in many]))
        errors = [error_of(each) for each in many]
        error = jax.tree.map(lambda *parts: jnp.stack(parts), *errors)
        levels = dd.Noise(
            jnp.asarray(np.stack([process_of(each, drifted) for each in many])),
            jnp.zeros((len(many), 0)),
            jnp.asarray(np.stack([each.sigma for each in many])),
        )
        sd = jnp.asarray(np.stack([start_spread(model, each, self.columns) for each in many]))
        scale = jnp.asarray(scale_of(model, many[0]))
        base = with_faults(model.plant, ())
        bare = Disturbed.of(
            base,
            plant.driven,
            plant.following,
            plant.error,
            plant.names,
            plant.offset,
            plant.directions,
        )
        found = _costs(
            bare,
            error,
            offset,
            W,
            levels,
            sd,
            scale,
            self.x,
            self.u,
            self.y,
            self.dt,
            self.substeps,
        )
        total, mean, P = (np.asarray(each) for each in found)
        return -total, mean, P


@eqx.filter_jit
def _costs(
    plant: Disturbed,
    error: Error,
    offset: Float[Array, "levels parameters"],
    W: Float[Array, "levels parameters directions"],
    levels: dd.Noise,
    sd: Float[Array, "levels extended"],
    scale: Float[Array, "extended"],
    x: Float[Array, "stretches states"],
    u: Float[Array, "stretches samples inputs"],
    y: Float[Array, "stretches samples outputs"],
    dt: Float[Array, "stretches samples"],
    substeps: int,
) -> tuple[Array, Array, Array]:
    """(ln p(y), mean and covariance of xi at the end of every stretch) under every level."""
    more = jnp.zeros((len(x), len(scale) - x.shape[1]))
    begin = jnp.concatenate([x, more], axis=1)

    first = plant.count + len(plant.driven) + len(plant.following)

    def of(
        error: Error, offset: Array, W: Array, noise: dd.Noise, sd: Array
    ) -> tuple[Array, Array, Array]:
        parts = error, offset, W
        own = eqx.tree_at(lambda p: (p.error, p.offset, p.directions), plant, parts)
        lane = DividedDifferenceFilter(own, scale, jnp.zeros(0), (), substeps)

        def stretch(x: Array, u: Array, y: Array, dt: Array) -> tuple[Array, Array, Array]:
            def body(
                carry: tuple[Belief, Array, Array], sample: tuple[Array, Array, Array]
            ) -> tuple[tuple[Belief, Array, Array], None]:
                belief, before, total = carry
                now, y, dt = sample
                belief, more, *_ = lane.step(belief, noise, before, now, y, dt)
                return (belief, now, total + more), None

            begin = lane.begin(x, sd), u[0], jnp.zeros(())
            belief, _, total = jax.lax.scan(body, begin, (u, y, dt))[0]
            return total, belief.mean[first:], belief.P[first:, first:]

        total, mean, P = jax.vmap(stretch)(begin, u, y, dt)
        return jnp.sum(total), mean, P

    return jax.vmap(of)(error, offset, W, levels, sd)


def _stretches(model: Model, runs: Sequence[Run]) -> list[_Stretch]:
    parts = []
    for number, log in enumerate(runs):
        run = in_effect(model.plant.signals, log)
        outputs = [n for n in model.plant.signals.output_names if n in run.columns]
        for part in segments(run, [*model.plant.signals.input_names, *outputs]):
            if part.stop - part.start >= 100:
                parts.append((number, run, part))
    if not parts:
        return []
    total = sum(part.stop - part.start for *_, part in parts)
    share = min(1.0, SAMPLES / total)
    found = []
    for at, (number, run, part) in enumerate(parts):
        count = part.stop - part.start
        pieces = max(1, int(np.ceil(share * count / LONGEST)))
        length = max(min(int(share * count / pieces), LONGEST), 100)
        for k in range(pieces):
            first = part.start + k * (count // pieces)
            piece = slice(first, min(first + length, part.stop))
            start = start_from_samples(model, run, piece)
            u, y = record_arrays(model, run, piece)
            u, y, dt = pad_stretch(u, y, run.t[piece])
            found.append(_Stretch(number, at, start.x, u, y, dt))
    return found


def _guess(model: Model, runs: Sequence[Run], stretches: Sequence[_Stretch]) -> Noise:
    """First guesses: sigma from second differences, a state as unsure as a tenth of its own
    output's noise in one sample, or a thousandth of its range where it is hidden."""
    signals, step = model.plant.signals, runs[0].step
    sigma = np.ones(len(signals.outputs))
    for j, output in enumerate(signals.outputs):
        own = [s.y[np.isfinite(s.y[:, j]), j] for s in stretches]
        second = np.concatenate([np.diff(y, 2) for y in own])
        if len(second):
            sigma[j] = 1.4826 * np.median(np.abs(second)) / np.sqrt(6)
            sigma[j] = max(sigma[j], 1e-2 * np.std(second), 1e-12)
        if output.sigma:
            sigma[j] = output.sigma
    process = 1e-3 * np.ptp(operating_points(model).x, axis=0) + 1e-12
    for j, output in enumerate(signals.outputs):
        if output.measures is not None:
            process[signals.state_names.index(output.measures)] = 0.1 * sigma[j]
    process = process / np.sqrt(step)
    values = {p.name: p for p in model.plant.spec.parameters}
    length = float(np.mean([np.sum(s.dt) for s in stretches]))
    drift = [
        (0.1 * abs(values[n].value) or width_of(values[n].min, values[n].max) / 10) / length**0.5
        for n in drifting_of(model)
    ]
    driven = list(dynamic_states(model.plant))
    size = USUAL_SIZE * rates_of(model)[driven]
    known = constants_of(model)
    se = np.sqrt(np.diag(known.covariance))
    spread = [
        usual_spread(float(model.plant.parameters[n]), s)
        for n, s in zip(known.names, se, strict=True)
    ]
    lasting = np.full(len(driven), max(length / 10, 20 * step))
    following = len(following_states(model.plant))
    share = np.full(following, USUAL_SHARE)
    settling = np.full(following, QUICK * step)
    return Noise(
        sigma, process, np.array(drift, float), size, lasting, share, settling,
        np.array(spread, float), np.zeros(len(spread)), np.zeros(len(spread)),
    )  # fmt: skip


def _limits(
    guess: Noise, step: float, stretches: Sequence[_Stretch]
) -> tuple[Float[np.ndarray, "levels"], Float[np.ndarray, "levels"], Float[np.ndarray, "levels"]]:
    """(lowest, highest, how far from the guess they are likely) of the logarithms."""
    length = float(max(np.sum(s.dt) for s in stretches))
    logs: list[Any] = [np.log(part) for part in guess[:SEARCHED]]
    lowest: list[Any] = [each - REACH for each in logs] + list(guess[SEARCHED:])
    highest: list[Any] = [each + REACH for each in logs] + list(guess[SEARCHED:])
    low, high = Noise(*lowest), Noise(*highest)
    wide: list[Any] = [np.full(len(part), np.inf) for part in guess]
    pull = Noise(*wide)
    low.lasting[:], high.lasting[:] = np.log(2 * step), np.log(100 * length)
    if len(guess.drift):
        high.lasting[:] = np.log(
            max(length / 10, 20 * step)
        )  # what is slower, the parameters follow
    low.settling[:], high.settling[:] = np.log(2 * step), np.log(length / 4)
    high.share[:] = 0.0
    pull.size[:] = pull.share[:] = pull.lasting[:] = UNSURE
    return (
        np.concatenate(low[:SEARCHED]),
        np.concatenate(high[:SEARCHED]),
        np.concatenate(pull[:SEARCHED]),
    )
