"""How far the plant is from its model, by innovation likelihood on healthy runs.

Searched are the noise of outputs and states, the size s and the time constant tau of the
discrepancy beside every state that is not exact kinematics, what a change of an input does besides,
by how much inputs and outputs err on their own where that pays, and, between the searches, the
spread of the constants from run to run. No discrepancy, and one that
walks without end, are limits of it: s = 0, tau without bound.

Where a log is sampled far faster than it moves, means over blocks of samples tell the same, and
what noise of a few samples' memory adds up to.
"""

from collections.abc import Callable, Sequence, Set
from itertools import count, product

import numpy as np
from jaxtyping import Float

from faultgauge.detection.doubted_regions import with_doubted_regions
from faultgauge.detection.innovation_likelihood import (
    SAMPLES,
    Likelihood,
    Told,
    healthy_stretches,
)
from faultgauge.detection.input_errors import with_errors_of_inputs
from faultgauge.detection.noise import DOUBT, LATE, STRAY, WANDER, Noise
from faultgauge.detection.noise_levels import (
    Bounds,
    bounds_of,
    first_guess,
    levels_of,
    logs_of,
    names_of,
    spans_of,
)
from faultgauge.detection.output_errors import with_errors_of_outputs
from faultgauge.detection.run_spread import as_unsure_as_few_runs_tell, constants_retold
from faultgauge.detection.scoring import scored
from faultgauge.errors import InputError
from faultgauge.observers import divided_difference as dd
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.oversampling import block_means

__all__ = ["estimate_noise"]

GRID = 4  # time constants to begin from
SMALLER = (1.0, 10.0, 100.0)  # times: sizes of the discrepancy to begin from
FACTORS = (1.0, 10.0, 100.0, 1000.0)  # of process noise, until the filter is not lost
ROUNDS = (16, 12, 8)  # steps of each search; the constants are told anew between them
# where searches begin, as a filter that is at times lost sees many maxima: times the process noise,
# and the discrepancy
STARTS = tuple(product((1.0, 10.0, 100.0), (1.0, 30.0)))
FIRST = 2  # steps of each; then of the better half, and so on
SEARCHES = 5  # of all ROUNDS: the plant's levels, then what each of BESIDE adds
# errors of inputs come first, as what outputs share is none of their own
BESIDE = (
    with_errors_of_inputs,
    with_errors_of_outputs,
    with_errors_of_outputs,
    with_doubted_regions,
)
ENOUGH = 0.3  # of log-likelihood: a step that gains less is the last
NONE = 1e-6  # times the usual: as good as no discrepancy


def estimate_noise(
    model: Model,
    runs: Sequence[Run],
    discrepancy: bool = True,
    progress: Callable[[float], None] = lambda share: None,
) -> Noise:
    """The most likely levels on healthy `runs`; without a `discrepancy` all error is noise.
    `progress` is told the share that is done, were all that may be needed.

    Raises `InputError` where no stretch is long enough or the filter never follows the data.
    """
    names = [n for n in model.plant.signals.output_names if n in runs[0].columns]
    total = sum(len(run.t) for run in runs)
    runs, averaged = block_means(runs, names, total / SAMPLES)
    stretches = healthy_stretches(model, runs)
    if not stretches:
        raise InputError(
            f"{runs[0].source}: no stretch of healthy data is long enough to tell the noise; give "
            "at least 100 samples in a row."
        )
    guess = first_guess(model, runs, stretches)
    batch = Likelihood.of(model, runs, guess, stretches)
    bounds = bounds_of(guess, runs[0].step, stretches)
    steps = count(1)

    def stepped() -> None:
        progress(next(steps) / (2 * len(STARTS) * FIRST + SEARCHES * sum(ROUNDS)))

    if discrepancy:
        noise = _started(model, batch, guess, bounds, stepped)
        noise = _alternated(model, batch, noise, bounds, stepped)
        spans = spans_of(runs[0].step, stretches)
        for beside in BESIDE:
            more = beside(model, batch, noise, spans)
            added = more.beside - noise.beside
            if not added:
                continue
            own = {name: getattr(more, name) for name in (*WANDER, *LATE, *STRAY, *DOUBT)}
            bounds = bounds_of(guess._replace(**own), runs[0].step, stretches)
            more = _alternated(model, batch, more, bounds, stepped)
            if _gain(model, batch, noise, more, bounds) > np.log(batch.count) * added:
                noise = more
    else:
        without = {n: NONE * getattr(guess, n) for n in ("size", "share", "spread")}
        held = {"size", "lasting", "share", "settling"}
        guess = guess._replace(**without)
        noise = _searched(model, batch, guess, bounds, held, sum(ROUNDS), stepped)
    if not batch.run(model, [noise]).cost[0] / batch.count < -dd.LOST / 4:
        raise InputError(
            "the model does not follow the healthy logs at all, so its noise cannot be told; look "
            "at `faultgauge evaluate`."
        )
    noise = as_unsure_as_few_runs_tell(model, batch, noise)
    samples = [averaged.get(name, 1.0) for name in model.plant.signals.output_names]
    return noise._replace(sigma=noise.sigma * np.sqrt(samples))


def _alternated(
    model: Model,
    batch: Likelihood,
    noise: Noise,
    bounds: Bounds,
    stepped: Callable[[], None],
) -> Noise:
    """Searches of so many steps each, and the constants told anew after each."""
    for steps in ROUNDS:
        noise = _searched(model, batch, noise, bounds, set(), steps, stepped)
        noise = constants_retold(model, batch, noise)
    return noise


def _costs(
    model: Model, batch: Likelihood, many: Sequence[Noise], bounds: Bounds
) -> Float[np.ndarray, "many"]:
    """-ln of likelihood times prior."""
    logs = np.stack([logs_of(each) for each in many])
    return batch.run(model, many).cost + bounds.unlikely(logs)


def _gain(model: Model, batch: Likelihood, noise: Noise, other: Noise, bounds: Bounds) -> float:
    """By how much ln of likelihood times prior is larger with the `other`."""
    before, after = (_costs(model, batch, [each], bounds)[0] for each in (noise, other))
    return float(before - after)


def _started(
    model: Model,
    batch: Likelihood,
    noise: Noise,
    bounds: Bounds,
    stepped: Callable[[], None],
) -> Noise:
    """`noise` with process noise from which on the filter is not lost, and the likeliest of some
    time constants and sizes, whatever the rate of the log is; after the first steps of some
    searches from there the likeliest of these."""
    least, most = (levels_of(logs, noise) for logs in (bounds.low, bounds.high))

    def best(many: list[Noise]) -> Noise:
        return many[int(np.argmin(_costs(model, batch, many, bounds)))]

    def between(name: str, share: float) -> Float[np.ndarray, "some"]:
        return getattr(least, name) ** (1 - share) * getattr(most, name) ** share

    many = [noise._replace(process=factor * noise.process) for factor in FACTORS]
    cost = batch.run(model, many).cost / batch.count
    noise = many[int(np.argmax(cost < cost.min() + dd.FAR**2 / 2))]
    shares = np.arange(1, GRID + 1) / (GRID + 1)
    if len(noise.settling):
        noise = best([noise, *(noise._replace(settling=between("settling", a)) for a in shares)])
    both = [(between("lasting", a), noise.size / b) for a in shares for b in SMALLER]
    noise = best([noise, *(noise._replace(lasting=a, size=b) for a, b in both)])
    many = [noise._replace(process=a * noise.process, size=b * noise.size) for a, b in STARTS]
    while len(many) > 1:
        many = [_searched(model, batch, m, bounds, set(), FIRST, stepped) for m in many]
        order = np.argsort(_costs(model, batch, many, bounds))
        many = [many[k] for k in order[: len(many) // 2]]
    return many[0]


def _searched(
    model: Model,
    batch: Likelihood,
    noise: Noise,
    bounds: Bounds,
    held: Set[str],
    most: int,
    stepped: Callable[[], None],
) -> Noise:
    """The likeliest levels but those `held`, by at most so many steps from `noise`; each is
    `stepped`."""
    start = logs_of(noise)
    at = np.flatnonzero(np.isfinite(start) & ~np.isin(names_of(noise), list(held)))

    def tell(some: Float[np.ndarray, "many free"]) -> Told:
        logs = np.tile(start, (len(some), 1))
        logs[:, at] = some
        return batch.run(model, [levels_of(row, noise) for row in logs])

    own = [each[at] for each in (start, bounds.low, bounds.high, bounds.center, bounds.pull)]
    found, _ = scored(tell, *own, most=most, enough=ENOUGH, stepped=stepped)
    logs = start.copy()
    logs[at] = found
    return levels_of(logs, noise)
