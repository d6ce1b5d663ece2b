"""The equation-error stage: every group of equations fitted from several starts, each selected
by free run on what was held out."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from faultgauge.errors import InputError
from faultgauge.identification.equation.groups import (
    Group,
    crowds,
    fit_group,
    groups,
    scale_networks,
)
from faultgauge.identification.equation.instruments import project
from faultgauge.identification.equation.selection import Windows, free_run_errors, windows_from
from faultgauge.identification.equation.simulated_instruments import Freed, freed_by_simulation
from faultgauge.identification.equation.weak_form import (
    WeakSamples,
    fit_weak,
    gap,
    weak_samples,
    weak_states,
)
from faultgauge.identification.holdout import split
from faultgauge.identification.optimise.algorithms import AlgorithmName
from faultgauge.identification.optimise.levenberg_marquardt import (
    FAILED,
    NOT_CONVERGED,
    Solution,
    not_converged,
)
from faultgauge.identification.optimise.starts import Box
from faultgauge.identification.samples import Channels, Samples, Stretch, collect, spread
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.spec import PlantSpec
from faultgauge.progress import Step
from faultgauge.simulation.free_run import RATE_STEP, fastest_rate
from faultgauge.telemetry import Run
from faultgauge.telemetry.resampling import cover

__all__ = ["EquationFit", "GroupReport", "Material", "fit_equations", "material", "max_step"]

POINTS = 10_000  # training points kept; the paper advises 1,000 to 10,000
VALIDATION_POINTS = 2000  # kept to stop and select on
# Of a derivative's spread, where mean F - F(mean) counts: the kernel is as wide as it is to leave
# noise below the same share, and from there on its width costs more than it saves.
MATERIAL = 0.01
WORSE = 1.5  # times the free-run error without instruments: they determine too little here


CLEARLY = 0.9  # of a free run's error: less of a difference may be what was held out
FOLLOWS = 0.5  # of the outputs' spread: a run that is further off speaks for no values
NOT_SEEN = (
    "{}: with the file's own values the free run on held-out data errs by {:.1f} % in short runs, "
    "with those that equation error finds by {:.1f} %, so the fit goes on from the file's; give "
    "logs that move the plant more"
)


class WeakMaterial(NamedTuple):
    """Samples of the weak form, to fit and to validate on, and windows to choose the form on: a
    start at a mean of bent states would suit the form that takes them for states. `places` as in
    `Material`."""

    training: WeakSamples
    validation: WeakSamples
    windows: Windows
    places: Int[np.ndarray, "training"]


class GroupReport(NamedTuple):
    """A group's account: `solution`, and the free runs of its starts, are those of the `form` that
    was kept; `freed`: with the instruments, where those are simulated at samples of their own;
    `stated`: its parameters are the file's, which run better than any fit; `crowded`: whether the
    `chosen` start's units stood where the networks' arguments crowd, None where none do."""

    group: Group
    solution: Solution
    free_run: np.ndarray
    chosen: int
    form: Literal["filtered", "weak", "instrumental"] = "filtered"
    freed: Freed | Literal["references"] | None = None
    crowded: bool | None = None
    stated: bool = False


class Material(NamedTuple):
    """What the stage fits, selects on, and found out about the columns' noise; `places` are those
    of the training samples among all samples of the stretches.

    With instruments, `exogenous` holds what of the training samples comes from them, `explained`
    how much of each input that is. `weak` is None with instruments, and where nothing is smoothed.
    """

    training: Samples
    validation: Samples
    windows: Windows
    stretches: list[Stretch]
    noise: dict[str, dict[str, float]]
    exogenous: Samples | None
    explained: dict[str, float]
    places: Int[np.ndarray, "training"]
    weak: WeakMaterial | None


class EquationFit(NamedTuple):
    """The selected plant, others by rank, the groups' accounts, and the plant's free-run error on
    held-out data (a share of the outputs' spread), and what the user should know."""

    plant: GrayBoxPlant
    others: list[GrayBoxPlant]
    reports: list[GroupReport]
    error: float
    warnings: list[str]


def material(
    spec: PlantSpec, logs: Sequence[Run], validate: Sequence[Run], how: Channels, seed: int
) -> Material:
    """Samples to fit and to validate on. Without `validate`, parts of `logs` are held out."""
    stretches, noise = collect(spec, logs, how)
    if validate:
        held, _ = collect(spec, validate, replace(how, references=()))
        masks = [np.ones(len(s.t), bool) for s in stretches]
        cuts = [[slice(0, len(s.t))] for s in held]
    else:
        masks, cuts = split(stretches)
        held = stretches
    training = _join(
        [s.samples.take(np.flatnonzero(m)) for s, m in zip(stretches, masks, strict=True)]
    )
    validation = _join(
        [s.samples.take(np.r_[cut]) for s, each in zip(held, cuts, strict=True) for cut in each]
    )
    _check_enough(training, validation)
    exogenous, explained = None, {}
    if how.references:
        exogenous, explained = project(spec.signals, stretches, masks)
    kept = _thinned(training, POINTS, seed)
    training, exogenous = training.take(kept), exogenous and exogenous.take(kept)
    unseen = _thinned(validation, VALIDATION_POINTS, seed)
    validation = validation.take(unseen)
    spreads = spread(np.concatenate([s.measured for s in stretches]))
    windows = windows_from(held, cuts, spreads)
    places = np.flatnonzero(np.concatenate(masks))[kept]
    weak = None
    if exogenous is None and stretches[0].unsmoothed is not None:
        fitted, at = _weak(spec, stretches, places, training, POINTS, seed)
        rest = _places(held, cuts)[unseen]
        judged, _ = _weak(spec, held, rest, validation, VALIDATION_POINTS, seed)
        weak = WeakMaterial(fitted, judged, windows_from(held, cuts, spreads, parabola=True), at)
    return Material(
        training, validation, windows, stretches, noise, exogenous, explained, places, weak
    )


def fit_equations(
    plant: GrayBoxPlant,
    how: Channels,
    given: Material,
    seed: int,
    restarts: int,
    algorithm: AlgorithmName,
    progress: Callable[[str], None],
) -> EquationFit:
    """Fit every group, take the best by equation error, then select each by free run.

    Where it makes a difference the starts are also fitted in the weak form, and compete.
    """
    found: list[_Fitted] = []
    others: list[GrayBoxPlant] = []
    reports: list[GroupReport] = []
    crowded: dict[str, Box] = {}
    warnings: list[str] = []
    everyone = groups(plant.spec, how.outputs)
    for number, group in enumerate(everyone):
        progress(Step(f"fitting {group.name}", number / (2 * len(everyone))))
        plant = scale_networks(plant, group, given.training)
        crowded |= crowds(plant, group, given.training)
        seeds = [[seed, number, k] for k in range(restarts)]
        plants, solution = fit_group(
            plant,
            group,
            given.training,
            given.validation,
            [np.random.default_rng(each) for each in seeds],
            algorithm=algorithm,
            exogenous=given.exogenous,
            crowded=crowded,
        )
        _judge(group, solution, warnings)
        plant = plants[int(np.nanargmin(_ranked(solution)))]
        fitted = _Fitted(group, plants, solution, None, given.windows)
        found.append(_with_weak(fitted, plant, how, given, seeds, algorithm, progress))
    longest = max_step(plant, given.training)
    for number, fitted in enumerate(found, len(found)):
        progress(Step(f"selecting {fitted.group.name} by free run", number / (2 * len(found))))
        plant, others, report = _selected(fitted, plant, how, given, longest, crowded, warnings)
        reports.append(report)
    if not reports:
        error = float(free_run_errors([plant], given.windows, longest)[0])
        return EquationFit(plant, others, reports, error, warnings)
    error = float(reports[-1].free_run[reports[-1].chosen])  # its choice is the whole plant's
    plant, reports, error = _no_worse_than_stated(
        plant, reports, error, found[-1].runs, len(found[-1].plants), given.training, warnings
    )
    return EquationFit(plant, others, reports, error, warnings)


class _Fitted(NamedTuple):
    """A group fitted from every start, a plant each: with instruments those of two-stage least
    squares and then the `solution`'s; then those of the `weak` form. Free runs over `runs`
    select."""

    group: Group
    plants: list[GrayBoxPlant]
    solution: Solution
    weak: Solution | None
    runs: Windows


def _with_weak(
    fitted: _Fitted,
    plant: GrayBoxPlant,
    how: Channels,
    given: Material,
    seeds: Sequence[list[int]],
    algorithm: AlgorithmName,
    progress: Callable[[str], None],
) -> _Fitted:
    """The starts fitted in the weak form, too, where that differs for `plant`, the best of them."""
    group = fitted.group
    states = weak_states(plant.spec, how, group)
    if not (given.weak and states and gap(plant, group, states, given.weak.training) > MATERIAL):
        return fitted
    progress(f"fitting {group.name} in the weak form")
    rngs = [np.random.default_rng(each) for each in seeds]
    points, unseen, runs, _ = given.weak
    more, weak = fit_weak(plant, group, states, points, unseen, rngs, algorithm)
    return fitted._replace(plants=[*fitted.plants, *more], weak=weak, runs=runs)


def _selected(
    fitted: _Fitted,
    plant: GrayBoxPlant,
    how: Channels,
    given: Material,
    longest: float,
    crowded: dict[str, Box],
    warnings: list[str],
) -> tuple[GrayBoxPlant, list[GrayBoxPlant], GroupReport]:
    """`plant` with the group's unknowns of the start whose free run errs least; with those of the
    others, by rank; and the group's account."""
    group, plants, solution, weak, runs = fitted
    candidates = [_exchange(plant, other, group) for other in plants]
    errors = free_run_errors(candidates, runs, longest)
    starts = len(solution.status)
    status = np.concatenate([solution.status, (weak or solution).status])[: len(plants)]
    errors = np.where(status == FAILED, np.inf, errors)
    chosen = _chosen(fitted, errors, warnings)
    instrumented = given.exogenous is not None and chosen < starts
    freed = "references" if instrumented else None
    plant = candidates[chosen]
    others = [candidates[k] for k in np.argsort(errors, kind="stable") if k != chosen]
    form = "filtered"
    if weak and chosen >= starts:
        form, solution = "weak", weak
    errors = errors[:starts] if chosen < starts else errors[starts:]
    chosen %= starts
    if solution.status[chosen] == NOT_CONVERGED:
        warnings.append(not_converged(group.name, int(solution.trials[chosen])))
    where = chosen % 2 == 1 if crowded.keys() & set(group.networks) else None
    if given.exogenous is None:
        plant, freed, errors[chosen] = _freed(plant, group, how, given, runs, errors[chosen])
        form = "instrumental" if freed else form
    return plant, others, GroupReport(group, solution, errors, chosen, form, freed, where)


def _chosen(fitted: _Fitted, errors: Float[np.ndarray, "plants"], warnings: list[str]) -> int:
    """The plant that errs least. The file's own start wins ties, then the earliest, of the weak
    form last: the same bytes on every run."""
    starts = len(fitted.solution.status)
    equals = len(errors) if fitted.weak else starts
    chosen = int(np.argmin(np.round(errors[:equals], 12)))
    with_it, plain = errors[chosen], np.min(errors[equals:], initial=np.inf)
    if plain * WORSE < with_it:  # only with instruments
        chosen = starts + int(np.argmin(np.round(errors[starts:], 12)))
        warnings.append(
            f"{fitted.group.name}: with the instrument the free run on held-out data errs by "
            f"{100 * with_it:.2f} %, without it by {100 * plain:.2f} %; the fit without is "
            "kept, and may have the loop's bias; give logs in which the reference moves more"
        )
    return chosen


def _freed(
    plant: GrayBoxPlant,
    group: Group,
    how: Channels,
    given: Material,
    runs: Windows,
    error: float,
) -> tuple[GrayBoxPlant, Freed | None, float]:
    """The plant fitted with simulated instruments unless its free run, that errs by `error`, gets
    clearly worse: least squares is biased there, which a short free run may not show. With its
    error."""
    tried = []
    stated = _as_stated(plant, group)
    at = given.stretches, given.places, given.training
    for each in freed_by_simulation(plant, stated, how, group, *at):
        longest = max_step(each.plant, given.training)
        tried.append((float(free_run_errors([each.plant], runs, longest)[0]), each))
    if not tried:
        return plant, None, error
    its, best = min(tried, key=lambda each: each[0])
    return (best.plant, best, its) if CLEARLY * its < error else (plant, None, error)


def _no_worse_than_stated(
    plant: GrayBoxPlant,
    reports: list[GroupReport],
    error: float,
    runs: Windows,
    count: int,
    training: Samples,
    warnings: list[str],
) -> tuple[GrayBoxPlant, list[GroupReport], float]:
    """The plant, whose free run errs by `error`, with the file's values of a group's parameters
    where it errs clearly less with them; `count` plants at a time run without a new compilation."""
    left = [k for k, each in enumerate(reports) if not each.group.networks]
    while left and error > MATERIAL:
        stated = [_as_stated(plant, reports[k].group) for k in left]
        longest = min(max_step(each, training) for each in stated)
        padded = [*stated, *[plant] * max(count - len(stated), 0)]
        errors = free_run_errors(padded, runs, longest)[: len(left)]
        least = int(np.argmin(errors))
        if not errors[least] < min(CLEARLY * error, FOLLOWS):
            break
        k, plant = left.pop(least), stated[least]
        warnings.append(NOT_SEEN.format(reports[k].group.name, 100 * errors[least], 100 * error))
        reports = [*reports[:k], reports[k]._replace(stated=True), *reports[k + 1 :]]
        error = float(errors[least])
    return plant, reports, error


def _as_stated(plant: GrayBoxPlant, group: Group) -> GrayBoxPlant:
    """`plant` with the group's parameters as the file states them."""
    stated = {p.name: jnp.asarray(float(p.value)) for p in plant.spec.parameters}
    parameters = {n: (stated if n in group.parameters else plant.parameters)[n] for n in stated}
    return replace(plant, parameters=parameters)


def _ranked(solution: Solution) -> np.ndarray:
    return np.where(solution.status == FAILED, np.inf, solution.validation_cost)


def _judge(group: Group, solution: Solution, warnings: list[str]) -> None:
    failed = int(np.sum(solution.status == FAILED))
    if failed == len(solution.status):
        raise InputError(
            f"{group.name}: no start has a finite cost; likely causes: (a) sqrt, log or a division "
            "by zero inside the range of the logs, (b) a parameter value or bound that makes the "
            "expression infinite; protect the expression with max() or set min and max."
        )
    if failed:
        warnings.append(
            f"{group.name}: {failed} of {len(solution.status)} starts had no finite cost"
        )


def _exchange(plant: GrayBoxPlant, other: GrayBoxPlant, group: Group) -> GrayBoxPlant:
    """`plant` with the unknowns of `group` taken from `other`."""
    networks = {n: (other if n in group.networks else plant).networks[n] for n in plant.networks}
    parameters = {
        p: (other if p in group.parameters else plant).parameters[p] for p in plant.parameters
    }
    return replace(plant, networks=networks, parameters=parameters)


def _join(parts: list[Samples]) -> Samples:
    return Samples(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _places(stretches: Sequence[Stretch], cuts: Sequence[Sequence[slice]]) -> np.ndarray:
    """Where the samples of `cuts` stand among those of all stretches."""
    starts = np.cumsum([0, *(len(s.t) for s in stretches)])
    pairs = zip(starts, cuts, strict=False)
    return np.concatenate([start + np.r_[cut] for start, each in pairs for cut in each])


def _weak(
    spec: PlantSpec,
    stretches: Sequence[Stretch],
    places: np.ndarray,
    samples: Samples,
    points: int,
    seed: int,
) -> tuple[WeakSamples, np.ndarray]:
    """Weak samples at as many of `samples` as stand a quarter of a kernel apart among `points`, and
    their places: neighbours share most of their kernels, and more tell nothing more."""
    kept = _thinned(samples, 2 * points // stretches[0].reach, seed)
    at = places[kept]
    return weak_samples(spec.signals, stretches, at, samples.take(kept)), at


def _check_enough(training: Samples, validation: Samples) -> None:
    if len(training.x) < 10 or len(validation.x) < 2:
        raise InputError(
            f"only {len(training.x)} training and {len(validation.x)} validation samples are left "
            "after smoothing; give a longer log."
        )


def _thinned(samples: Samples, count: int, seed: int) -> np.ndarray:
    """Indices of at most `count` points that cover the envelope."""
    points = np.concatenate([samples.x, samples.u], axis=1)
    return cover(points, count, np.random.default_rng(seed))


def max_step(plant: GrayBoxPlant, training: Samples) -> float:
    """Longest RK4 step [s] for the rates that `plant` has over the training points."""
    points = training.take(np.linspace(0, len(training.x) - 1, 500).astype(int))
    rate = fastest_rate(plant, points.x, points.u)
    return RATE_STEP / rate if rate > 0 else 1e9
