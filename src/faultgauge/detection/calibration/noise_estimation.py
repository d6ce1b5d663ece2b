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
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.bank.extended import scale_of
from faultgauge.detection.bank.fidelity import Following
from faultgauge.detection.bank.noise import (
    BEND,
    GRIP,
    JITTER,
    LATE,
    LEAN,
    OPTIONAL,
    STRAY,
    TRAIL,
    VARY,
    WANDER,
    ZERO,
    Noise,
)
from faultgauge.detection.bank.uncertain_constants import constants_of
from faultgauge.detection.calibration.doubted_regions import with_doubted_regions
from faultgauge.detection.calibration.grips import with_grips
from faultgauge.detection.calibration.innovation_likelihood import (
    LARGE,
    SAMPLES,
    Followed,
    Likelihood,
    Likelihoods,
    StretchPiece,
    healthy_stretches,
)
from faultgauge.detection.calibration.input_curves import with_curves_of_inputs
from faultgauge.detection.calibration.input_errors import with_errors_of_inputs
from faultgauge.detection.calibration.input_lags import with_lags_of_inputs
from faultgauge.detection.calibration.nearby_levels import EXACT
from faultgauge.detection.calibration.noise_levels import (
    LEAST_LAG,
    Bounds,
    Spans,
    bounds_of,
    first_guess,
    levels_of,
    logs_of,
    names_of,
    spans_of,
)
from faultgauge.detection.calibration.output_errors import with_errors_of_outputs
from faultgauge.detection.calibration.run_spread import as_unsure_as_few_runs_tell, constants_retold
from faultgauge.detection.calibration.scoring import scored
from faultgauge.detection.calibration.sensor_jitter import with_jitter_of_sensors
from faultgauge.detection.calibration.sensor_lags import with_lags_of_sensors
from faultgauge.detection.calibration.varying_constants import with_varying_constants
from faultgauge.errors import InputError
from faultgauge.observers import divided_difference as dd
from faultgauge.plants.disturbed import dynamic_states, following_inputs
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.oversampling import block_means

__all__ = ["estimate_doubts", "estimate_noise"]

GRID = 4  # time constants to begin from
SMALLER = (1.0, 10.0, 100.0)  # times: sizes of the discrepancy to begin from
FACTORS = (1.0, 10.0, 100.0, 1000.0)  # of process noise, until the filter is not lost
ROUNDS = (16, 12, 8)  # steps of each search; the constants are told anew between them
# where searches begin, as a filter that is at times lost sees many maxima: times the process noise,
# and the discrepancy
STARTS = tuple(product((1.0, 10.0, 100.0), (1.0, 30.0)))
FIRST = 2  # steps of each; then of the better half, and so on
# parts of the work: the start, the plant's levels, a grip, LAGS in either order, CURVES, jitter and
# BESIDE beside lags and without any, a lag again, and by all data, as much as a few of them
PARTS, ALL = 23, 3
USUAL = 12  # steps of a part
SEEN = 8192  # samples that tell what there is beside the levels, fewer where a filter is `LARGE`
Beside: TypeAlias = Callable[[Model, Likelihood, Noise, Spans], Noise]
# these come first, as they are no error; what one of them explains the other does in part
LAGS = (with_lags_of_inputs, with_lags_of_sensors)
CURVES = (with_curves_of_inputs,)  # are no errors either
# errors of inputs come first, as what outputs share is none of their own
BESIDE = (
    with_varying_constants,
    with_errors_of_inputs,
    with_errors_of_outputs,
    with_errors_of_outputs,
)
OWN = ("wander", "late", "stray")  # of these: what `BESIDE` finds
SIZES = {
    pair[0]: pair for pair in (WANDER, LATE, STRAY, LEAN, TRAIL, ZERO, BEND, GRIP, VARY, JITTER)
}  # with their times
AGREE = 1.25  # times: what the plant does lets the constants of runs lie no farther apart
HOLDS = 0.25  # of a grip's power: where the model errs by more in motion it is none
LESS = 0.95  # of the share that a change is off by: a lag that leaves more is none
TOLD = 1.05  # times the shortest time: the end of a search
ENOUGH = 1.0  # of log-likelihood: a step that gains less is the last
NONE = 1e-6  # times the usual: as good as no discrepancy


def estimate_noise(
    model: Model,
    runs: Sequence[Run],
    discrepancy: bool = True,
    progress: Callable[[float], None] = lambda share: None,
) -> Noise:
    """The most likely levels on healthy `runs`; without a `discrepancy` all error is noise.
    `progress` is told the share that is done, about.

    Raises `InputError` where no stretch is long enough or the filter never follows the data.
    """
    told = _Healthy.of(model, runs)
    stepped = _Progress(progress, PARTS)
    if discrepancy:
        large = max(len(scale_of(model, told.guess)) / LARGE, 1.0)
        some = replace(told, batch=told.batch.some(int(SEEN / large)))
        noise = _found_beside(model, some, stepped)
        if some.batch is not told.batch:
            stepped.weighs(ALL)
            noise = _alternated(model, told, noise, told.bounds(noise), stepped)
        noise = _needed(told.batch, noise)
    else:
        without = {n: NONE * getattr(told.guess, n) for n in ("size", "share")}
        held = {"size", "lasting", "share", "settling"}
        bounds = told.bounds(told.guess)
        guess = told.guess._replace(**without).with_between(constants_of(model).covariance)
        noise = _searched(model, told.batch, guess, bounds, held, sum(ROUNDS), stepped)
    if not told.batch.run([noise]).cost[0] / told.batch.count < -dd.LOST / 4:
        raise InputError(
            "the model does not follow the healthy logs at all, so its noise cannot be told; look "
            "at `faultgauge evaluate`."
        )
    return told.of_samples(as_unsure_as_few_runs_tell(model, told.batch, noise))


def estimate_doubts(
    model: Model,
    runs: Sequence[Run],
    noise: Noise,
    progress: Callable[[float], None] = lambda share: None,
) -> Noise | None:
    """The most likely levels on healthy `runs` where the model may err more in a part of the range
    of an input, from `noise` on, which `estimate_noise` found; None where that gains
    nothing. `progress` as there."""
    told = _Healthy.of(model, runs)
    stepped = _Progress(progress, 1)
    noise = told.of_means(noise)
    found = _with(with_doubted_regions, model, told, noise, stepped)
    if found is None:
        return None
    return told.of_samples(as_unsure_as_few_runs_tell(model, told.batch, found))


class _Progress:
    """Tells which share of so many parts is over, and more with every step of the present one."""

    def __init__(self, tell: Callable[[float], None], parts: int) -> None:
        self.tell, self.parts = tell, parts
        self.done, self.steps, self.weight = 0, 0, 1

    def __call__(self) -> None:
        self.steps += 1
        share = self.weight * -np.expm1(-self.steps / (self.weight * USUAL))
        self.tell(float(min((self.done + share) / self.parts, 1.0)))

    def over(self) -> None:
        """The next part begins."""
        self.done, self.steps, self.weight = self.done + self.weight, 0, 1

    def weighs(self, parts: int) -> None:
        """The next part begins, which is as much as so many."""
        self.over()
        self.weight = parts


@dataclass(frozen=True)
class _Healthy:
    """What healthy runs tell of noise: their likelihood, a first guess, how far from it levels may
    lie, and the root of how many samples each of an output's is the mean of."""

    batch: Likelihood
    guess: Noise
    step: float
    stretches: list[StretchPiece]
    averaged: Float[np.ndarray, "outputs"]
    follows: Following

    @staticmethod
    def of(model: Model, runs: Sequence[Run]) -> "_Healthy":
        outputs = model.plant.signals.output_names
        names = [n for n in outputs if n in runs[0].columns]
        total = sum(len(run.t) for run in runs)
        follows = Following(model, runs)
        runs, averaged = block_means(runs, names, total / SAMPLES)
        stretches = healthy_stretches(model, runs)
        if not stretches:
            raise InputError(
                f"{runs[0].source}: no stretch of healthy data is long enough to tell the noise; "
                "give at least 100 samples in a row."
            )
        guess = first_guess(model, runs, stretches)
        batch = Likelihood.of(model, runs, guess, stretches)
        means = np.sqrt([averaged.get(name, 1.0) for name in outputs])
        return _Healthy(batch, guess, runs[0].step, stretches, means, follows)

    def bounds(self, noise: Noise) -> Bounds:
        """Of the levels that `noise` has."""
        own = {name: getattr(noise, name) for name in OPTIONAL}
        return bounds_of(self.guess._replace(**own), self.step, self.stretches)

    def of_samples(self, noise: Noise) -> Noise:
        """`noise` of means as that of samples."""
        sigma, jitter = (each * self.averaged for each in (noise.sigma, noise.jitter))
        return noise._replace(sigma=sigma, jitter=jitter)

    def of_means(self, noise: Noise) -> Noise:
        """`noise` of samples as that of means."""
        sigma, jitter = (each / self.averaged for each in (noise.sigma, noise.jitter))
        return noise._replace(sigma=sigma, jitter=jitter)


def _found_beside(model: Model, told: "_Healthy", stepped: "_Progress") -> Noise:
    """The levels, and what there is beside them, by what `told` looks at."""
    noise = _started(model, told.batch, told.guess, told.bounds(told.guess), stepped)
    stepped.over()
    noise = _alternated(model, told, noise, told.bounds(noise), stepped, {"sigma"})
    noise = _with(with_grips, model, told, noise, stepped) or noise
    lagging = _with_lags(model, told, noise, stepped)
    found = _with_errors(model, told, lagging, stepped)
    if lagging is noise or not any(np.any(getattr(found, name)) for name in OWN):
        stepped.weighs(len((*CURVES, *BESIDE)) + 1)
    else:  # what is one output's, or comes and goes, may have been taken for a lag
        found = _likelier(told, [found, _with_errors(model, told, noise, stepped)])
    if found is lagging:
        return found
    # a lag may show only beside what was found since
    return _with(with_lags_of_inputs, model, told, found, stepped) or found


def _with_errors(model: Model, told: _Healthy, noise: Noise, stepped: "_Progress") -> Noise:
    """`noise` with `CURVES`, jitter and then `BESIDE`, where they gain enough: beside jitter that
    is not needed any more they are looked for without."""
    noise = _with_each(CURVES, model, told, noise, stepped)
    jittering = _with(with_jitter_of_sensors, model, told, noise, stepped)
    found = _with_each(BESIDE, model, told, jittering or noise, stepped)
    if jittering is None or _needed(told.batch, found).jitters:
        return found
    return _with_each(BESIDE, model, told, noise, stepped)


def _with_each(
    many: Sequence[Beside], model: Model, told: _Healthy, noise: Noise, stepped: "_Progress"
) -> Noise:
    """`noise` with each of `many`, one after another, that gains enough."""
    for beside in many:
        noise = _with(beside, model, told, noise, stepped) or noise
    return noise


def _likelier(told: _Healthy, many: Sequence[Noise]) -> Noise:
    """The likeliest of `many`, each of what there is beside the levels being asked to gain what it
    has to; of those alike the first."""
    each_asks = np.log(told.batch.count)
    costs = [
        _costs(told.batch, [each], told.bounds(each))[0] + each_asks * each.beside for each in many
    ]
    return many[int(np.argmin(costs))]


def _apart(before: Noise, found: Noise) -> float:
    """How many times as far apart the constants of runs are."""
    return (
        float(np.exp(np.mean(np.log(found.spread / before.spread)))) if len(found.spread) else 1.0
    )


def _with_lags(model: Model, told: "_Healthy", noise: Noise, stepped: "_Progress") -> Noise:
    """`noise` with `LAGS`, where they gain enough: of each beside the other one, begun with either,
    the likelier, as what one of them explains the other does in part."""
    found = [noise]
    for first, then in (LAGS, LAGS[::-1]):
        one = _with(first, model, told, noise, stepped)
        if one is None:
            stepped.over()
        else:
            found.append(_with(then, model, told, one, stepped) or one)
    return _likelier(told, found)


def _with(
    beside: Beside,
    model: Model,
    told: _Healthy,
    noise: Noise,
    stepped: "_Progress",
) -> Noise | None:
    """`noise` and what there is `beside` it, all told anew; None where that gains too little, where
    the search has come to levels that need none of it, or where what the plant does leaves
    constants that differ more."""
    stepped.over()
    spans = spans_of(told.step, told.stretches)
    more = beside(model, told.batch, noise, spans)
    while more.beside > noise.beside:
        bounds = told.bounds(more)
        found = _alternated(model, told, more, bounds, stepped)
        lean, trail = _false_lags(model, noise, found, spans)
        grip = _false_grips(model, noise, found)
        if not lean.any() and not trail.any() and not grip.any():
            break
        more = more._replace(
            lean=np.where(lean, 0.0, more.lean),
            leaning=np.where(lean, 0.0, more.leaning),
            trail=np.where(trail, 0.0, more.trail),
            **{name: np.where(grip, 0.0, getattr(more, name)) for name in GRIP},
        )
    else:
        return None
    needed = _needed(told.batch, found)
    if needed is not found:  # the search may have come to levels that need less than was there
        bounds = told.bounds(needed)
        found = _alternated(model, told, needed, bounds, stepped)
    if beside in (*LAGS, *CURVES) and _apart(noise, found) > AGREE:
        return None
    enough = np.log(told.batch.count) * max(found.beside - noise.beside, 1)
    return found if _gain(told.batch, noise, found, bounds) > enough else None


def _false_lags(
    model: Model, before: Noise, found: Noise, spans: Spans
) -> tuple[Bool[np.ndarray, "inputs"], Bool[np.ndarray, "outputs"]]:
    """The inputs whose lag, which was not there `before`, leaves as much of a change to chance as
    there was, and so explains something else, or would be shorter than can be told; and the outputs
    that would trail by less than a quarter of that."""
    less = np.zeros(len(found.lean), bool)
    less[list(following_inputs(model.plant))] = found.share < LESS * before.share
    short, new = TOLD * spans.shortest, (found.lean != 0) & (before.lean == 0)
    lean = new & (~less | (found.leaning < short))
    return lean, (found.trail > 0) & (before.trail == 0) & (found.trail < LEAST_LAG * short)


def _false_grips(model: Model, before: Noise, found: Noise) -> Bool[np.ndarray, "states"]:
    """The states whose grip, which was not there `before`, has less than four times the power by
    which the model errs slowly besides, 2 s^2 tau + sigma^2: what errs half as much in motion is no
    grip."""
    slow = found.process**2
    slow[list(dynamic_states(model.plant))] += 2 * found.size**2 * found.lasting
    new = (found.grip != 0) & (before.grip == 0)
    return new & (slow > HOLDS * 2 * found.grip**2 * found.gripping)


def _needed(batch: Likelihood, noise: Noise) -> Noise:
    """`noise` without errors of inputs and outputs that gain too little beside those which were
    found after them."""
    while there := [(name, j) for name in SIZES for j in np.flatnonzero(getattr(noise, name))]:
        many = [noise]
        for name, j in there:
            size = getattr(noise, name).copy()
            size[j] *= NONE ** (-1 if name in VARY else 1)
            many.append(noise._replace(**{name: size}))
        cost = batch.run(many).cost
        least = int(np.argmin(cost[1:]))
        if cost[1 + least] - cost[0] > np.log(batch.count):
            break
        name, j = there[least]
        without = {n: np.where(np.arange(len(getattr(noise, n))) == j, 0.0, getattr(noise, n))
                   for n in SIZES[name]}  # fmt: skip
        noise = noise._replace(**without)
    return noise


def _alternated(
    model: Model,
    told: _Healthy,
    noise: Noise,
    bounds: Bounds,
    stepped: "_Progress",
    held: Set[str] = frozenset(),
) -> Noise:
    """Searches of so many steps each, the first with some levels `held`, and the constants told
    anew after each, until these tell nothing new."""
    for k, steps in enumerate(ROUNDS):
        found = _searched(model, told.batch, noise, bounds, set() if k else held, steps, stepped)
        noise = constants_retold(model, told.batch, found, told.follows)
        if (k or not held) and _gain(told.batch, found, noise, bounds) < ENOUGH:
            break
    return noise


def _costs(batch: Likelihood, many: Sequence[Noise], bounds: Bounds) -> Float[np.ndarray, "many"]:
    """-ln of likelihood times prior."""
    logs = np.stack([logs_of(each) for each in many])
    return batch.run(many).cost + bounds.unlikely(logs)


def _gain(batch: Likelihood, noise: Noise, other: Noise, bounds: Bounds) -> float:
    """By how much ln of likelihood times prior is larger with the `other`."""
    before, after = (_costs(batch, [each], bounds)[0] for each in (noise, other))
    return float(before - after)


def _started(
    model: Model,
    batch: Likelihood,
    noise: Noise,
    bounds: Bounds,
    stepped: "_Progress",
) -> Noise:
    """`noise` with process noise from which on the filter is not lost, and the likeliest of some
    time constants and sizes, whatever the rate of the log is; after the first steps of some
    searches from there the likeliest of these; anew with more noise of an output that gains by it,
    as one that is far off all the time tells nothing of its noise: the filter is lost in it."""
    least, most = (levels_of(logs, noise) for logs in (bounds.low, bounds.high))
    begun = noise

    def best(many: list[Noise]) -> Noise:
        return many[int(np.argmin(_costs(batch, many, bounds)))]

    def between(name: str, share: float) -> Float[np.ndarray, "some"]:
        return getattr(least, name) ** (1 - share) * getattr(most, name) ** share

    def louder(noise: Noise) -> Noise | None:
        each = np.eye(len(noise.sigma))
        more = best([noise._replace(sigma=noise.sigma * f**one) for f in FACTORS for one in each])
        gains = _gain(batch, noise, more, bounds) > np.log(batch.count)
        return begun._replace(sigma=more.sigma) if gains else None

    many = [noise._replace(process=factor * noise.process) for factor in FACTORS]
    cost = batch.run(many).cost / batch.count
    noise = many[int(np.argmax(cost < cost.min() + dd.FAR**2 / 2))]
    shares = np.arange(1, GRID + 1) / (GRID + 1)
    if len(noise.settling):
        noise = best([noise, *(noise._replace(settling=between("settling", a)) for a in shares)])
    both = [(between("lasting", a), noise.size / b) for a in shares for b in SMALLER]
    noise = best([noise, *(noise._replace(lasting=a, size=b) for a, b in both)])
    many = [noise._replace(process=a * noise.process, size=b * noise.size) for a, b in STARTS]
    again = louder(best(many))  # before any search, which takes long
    if again is not None:
        return _started(model, batch, again, bounds, stepped)
    while len(many) > 1:
        many = [_searched(model, batch, m, bounds, {"sigma"}, FIRST, stepped) for m in many]
        order = np.argsort(_costs(batch, many, bounds))
        many = [many[k] for k in order[: len(many) // 2]]
    again = louder(many[0])
    return many[0] if again is None else _started(model, batch, again, bounds, stepped)


def _searched(
    model: Model,
    batch: Likelihood,
    noise: Noise,
    bounds: Bounds,
    held: Set[str],
    most: int,
    stepped: "_Progress",
) -> Noise:
    """The likeliest levels but those `held`, by at most so many steps from `noise`; each is
    `stepped`."""
    start = logs_of(noise)
    at = np.flatnonzero(np.isfinite(start) & ~np.isin(names_of(noise), list(held)))

    apart = np.array([False, *np.isin(names_of(noise), EXACT)[at]])

    def of(some: Float[np.ndarray, "many free"]) -> list[Noise]:
        logs = np.tile(start, (len(some), 1))
        logs[:, at] = some
        return [levels_of(row, noise) for row in logs]

    here, tried = dict[bytes, Followed](), dict[bytes, Followed]()

    def tell(some: Float[np.ndarray, "many free"]) -> Likelihoods:
        found, followed = batch.run_along(of(some))
        tried.clear()
        tried.update(zip((place.tobytes() for place in some), followed, strict=False))
        return found

    def near(some: Float[np.ndarray, "many free"]) -> Likelihoods:
        place = some[0].tobytes()
        if place not in here and batch.large(noise):
            if place not in tried:
                tell(some[:1])
            here.clear()
            here[place] = tried[place]
        return batch.near(of(some), apart, here.get(place))

    own = [each[at] for each in (start, bounds.low, bounds.high, bounds.center, bounds.pull)]
    found, _ = scored(tell, near, *own, most=most, enough=ENOUGH, stepped=stepped)
    logs = start.copy()
    logs[at] = found
    return levels_of(logs, noise)
