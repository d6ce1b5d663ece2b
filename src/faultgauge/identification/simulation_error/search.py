"""Refinement: from a warm start to the least simulation error, growing and selected step by step.

    1. physics    parameters alone, networks silent, over short windows from several starts
    2. runs       the best of them over whole runs
    3. hold       what the file leaves open of the inputs, by validation error
    4. networks   from several starts over whole runs, down a grid of prior weights

Everything is chosen on samples that no fit has seen, by free run. Where nothing wins over the warm
start, the warm start is what is returned.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.errors import InputError
from faultgauge.identification.optimise.cores import side_by_side
from faultgauge.identification.simulation_error.candidate import (
    WARM,
    Candidate,
    few_starts,
    fitted_again,
    sample_count,
    sigma_of,
    validated,
)
from faultgauge.identification.simulation_error.data import (
    FIRST_SIGMA,
    Data,
    prepare,
    validation_error,
)
from faultgauge.identification.simulation_error.evidence import drift_by_evidence
from faultgauge.identification.simulation_error.networks import FINALISTS, with_networks
from faultgauge.identification.simulation_error.records import Record
from faultgauge.identification.simulation_error.short_windows import around, over_short_windows
from faultgauge.identification.simulation_error.stepping import fine_enough, stable
from faultgauge.identification.simulation_error.uncertainty import residual_time
from faultgauge.identification.simulation_error.window_fit import (
    Fitted,
    local_unknowns,
    simulated,
)
from faultgauge.identification.unknowns import unknown_constants, unknowns_of
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.signals import Hold, Signals
from faultgauge.simulation.free_run import RATE_STEP, blow_up, fastest_rate, substeps_for

__all__ = ["Search", "refine"]

KEPT, ALIKE = 3, 1.5  # members of an ensemble at most, and times the best's error before the end
GAIN = 0.99  # of the ensemble's error: more does not pay another member
NEAR = 0.05  # prior standard deviations: two starts that found one minimum
SAME = 0.01  # of both their errors, fitted and unseen: the same of two fits
PLACES, GOOD = 4, 4.0  # minima of the physics that go on, and their squared error at most
FIRST_TRIALS, LAST_TRIALS = 16, 60  # of the physics, where networks follow and where none do
COARSE = 2.0  # times a simulation's step: a search is done before the last digits matter
HOLD_STARTS = 3  # candidates that try every hold
DRIFT_ROUNDS = 4  # of walk and evidence in turn
SHORT = 5_000  # samples: below, what is held out would be missed
MORE_TRIALS, ALL_TRIALS = 40, 16  # of what stands already, and of the best over all samples
WIDER = 1000.0  # times the spread of hidden starts: 0 +- 1 says nothing of a temperature in K
CLEARLY = 0.9  # of the error with a simpler hold: half a sample of delay hides in many constants
HOLDS: tuple[Hold, ...] = ("zero", "linear", "band-limited")


@dataclass(frozen=True)
class Search:
    """The members, best first; the holds that were chosen where the file leaves them open; what was
    tried.

    `won` is False where no refinement beat the warm start, which then is the first member.
    `refitted` are the members fitted to what was held out, too, where a log is short.
    """

    members: list[Candidate]
    data: Data
    holds: dict[str, str]
    tried: list[tuple[str, float]]
    won: bool
    notes: list[str]
    refitted: list[Candidate]


def refine(
    plant: GrayBoxPlant,
    warm: Sequence[GrayBoxPlant],
    records: list[Record],
    masks: list[Bool[np.ndarray, "_"]],
    held: list[Record],
    *,
    seed: int = 0,
    restarts: int = 10,
    robust: bool = False,
    warm_counts: bool = True,
    progress: Callable[[str], None] = lambda text: None,
) -> Search:
    """Least simulation error of `plant`'s unknowns over `records`, where `masks` are True.

    `warm` are fitted plants to start from, best first (none: the file's values, silent networks);
    `held` are records of runs given for validation. Where not `warm_counts`, the warm starts are
    that only: none is returned as it is while anything else is finite.
    """
    substeps = _substeps(warm[0] if warm else plant, records, COARSE * RATE_STEP)
    data = prepare(plant.signals, records, masks, held, substeps, robust, unknowns_of(plant))
    notes: list[str] = []
    candidates: list[Candidate] = []
    if warm:
        progress("simulating the warm start")
        candidates.append(_as_it_is(data, warm[0]))
    candidates += _physics(data, plant, warm, seed, restarts, progress, notes)
    holds: dict[str, str] = {}
    if plant.spec.open_holds and candidates:
        progress("choosing the inputs' hold")
        holds, data.signals = _choose_hold(data, candidates, plant.spec.open_holds)
        candidates = _distinct([_again(data, c) for c in candidates])
    if data.drift.scale.size and candidates:
        progress("drifting parameters: how far they walk, by evidence")
        candidates = _choose_drift(data, candidates)
    if unknowns_of(plant).networks and candidates:
        candidates = _fine_enough(data, candidates, progress)
        candidates += with_networks(data, candidates, warm, seed, restarts, progress, notes)
    tried = [(c.origin, c.validation) for c in candidates]
    if not any(np.isfinite(c.validation) for c in candidates):
        raise InputError(no_finite_start(data, plant))
    if not warm_counts:
        refined = [c for c in candidates if c.origin != WARM and np.isfinite(c.validation)]
        candidates = refined or candidates
    members = _distinct(candidates)[:KEPT]
    members = [c for c in members if c.validation <= ALIKE * members[0].validation]
    members = _coarser(data, _finer(data, members, progress))
    if len(data.pieces) < len(data.whole):
        progress("fitting the best to all samples")
        members = _on_all_samples(data, members[:FINALISTS])
    members = _ensemble(data, members)
    if any(p.spread is not None for p in plant.spec.parameters):
        progress("weighing the fleet against the log")
        members = _leaning(data, members)
    won = members[0].origin != WARM
    refitted: list[Candidate] = []
    if won and not held and sample_count(data.whole) < SHORT:
        progress("fitting the best to what was held out, too")
        refitted = _with_held_out(data, members)
    return Search(members, data, holds, tried, won, notes, refitted)


def _distinct(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Finite ones, best first, the same minimum only once: by its errors, since what a silent
    network's weights are, say, does not matter."""
    found: list[Candidate] = []
    for each in sorted(candidates, key=lambda c: c.validation):
        if np.isfinite(each.validation) and not any(_same(each, other) for other in found):
            found.append(each)
    return found


def _same(one: Candidate, other: Candidate) -> bool:
    pairs = (one.validation, other.validation), (one.fitted.mse, other.fitted.mse)
    close = all(abs(a - b) <= SAME * max(a, b) for a, b in pairs)
    return one.origin == other.origin and close


def _ensemble(data: Data, candidates: Sequence[Candidate]) -> list[Candidate]:
    """The best, and those that make the mean of the free runs better on unseen samples.

    Forward selection (R. Caruana et al., "Ensemble selection from libraries of models", ICML 2004).
    """
    best, *others = candidates
    members, error = [best], best.validation
    while others and len(members) < KEPT:
        means = [np.mean([c.unseen for c in (*members, each)], axis=0) for each in others]
        errors = [validation_error(data, best.fitted, mean) for mean in means]
        k = int(np.argmin(errors))
        if not errors[k] < GAIN * error:
            break
        members.append(others.pop(k))
        error = errors[k]
    return members


def _on_all_samples(data: Data, members: Sequence[Candidate]) -> list[Candidate]:
    """The members, refitted to all samples where that wins on validation."""
    share = sample_count(data.whole) / sample_count(data.pieces)
    data.reach(members[0].plant, members[0].unknowns, members[0].fitted)
    data.pieces = data.whole

    def to_all(c: Candidate) -> Candidate:
        refitted = c
        if c.origin != WARM:
            fitted = data.fit(
                c.plant,
                c.unknowns,
                c.fitted.theta[None],
                sigma=sigma_of(c.fitted),
                ridge=c.ridge * share,
                trials=ALL_TRIALS,
                claims=c.claims,
            )[0]
            refitted = validated(data, replace(c, fitted=fitted, ridge=c.ridge * share))
        if not refitted.validation < c.validation:
            kept = data.fit_starts(c.plant, c.unknowns, c.fitted.theta)
            refitted = validated(data, replace(c, fitted=kept))
        return refitted

    return sorted(side_by_side(to_all, members), key=lambda c: c.validation)


def _leaning(data: Data, members: Sequence[Candidate]) -> list[Candidate]:
    """The members with what a fleet says of their parameters weighed against as many samples as
    their residuals are worth: an error that lasts says the same over and over."""
    best = members[0]
    windows = data.windows(data.pieces)
    data.prior = residual_time(best.plant, best.unknowns, best.fitted, windows, data.substeps)
    again = [(_again(data, c), c) for c in members]
    found = [new if np.isfinite(new.validation) else old for new, old in again]
    return sorted(found, key=lambda c: c.validation)


def _with_held_out(data: Data, members: Sequence[Candidate]) -> list[Candidate]:
    """The members fitted to what chose them, too: 3 samples to every 7. Their errors on
    unseen samples stay those from before. None where a fit fails."""
    whole = data.with_held_out()
    share = sample_count(data.pieces) / sum(data.fitted_samples(piece) for piece in data.pieces)

    fits = side_by_side(lambda c: fitted_again(whole, c, c.ridge * share, LAST_TRIALS), members)
    return fits if all(each.fitted.usable for each in fits) else []


def _finer(
    data: Data, members: list[Candidate], progress: Callable[[str], None]
) -> list[Candidate]:
    """The members with more substeps, while their steps are not stable, or matter to the best one
    and help on validation."""
    while not fine_enough(data, members[0]):
        progress(f"fitting the best with {2 * data.substeps} substeps")
        sound = stable(data, members[0])
        data.substeps *= 2
        finer = sorted((_again(data, c) for c in members), key=lambda c: c.validation)
        if sound and not finer[0].validation < members[0].validation:
            data.substeps //= 2
            break
        members = finer
    return members


def _coarser(data: Data, members: list[Candidate]) -> list[Candidate]:
    """The members, with as few substeps as do not matter to the best one and as its rates ask for:
    those that there are are for what the search began with, as a network that has learned nothing.
    """
    best = members[0]
    least = _substeps(best.assembled, data.records, RATE_STEP)
    while data.substeps > least:
        fewer = max(data.substeps // 2, least)
        if not fine_enough(replace(data, substeps=fewer), best):
            break
        data.substeps = fewer
    return members


def _fine_enough(
    data: Data, candidates: list[Candidate], progress: Callable[[str], None]
) -> list[Candidate]:
    """The same with so many substeps that they do not matter: networks would learn what they do."""
    while not fine_enough(data, candidates[0]):
        progress(f"fitting the physics with {2 * data.substeps} substeps")
        data.substeps *= 2
        candidates = _distinct([_again(data, c) for c in candidates]) or candidates
    return candidates


def _substeps(plant: GrayBoxPlant, records: Sequence[Record], step: float) -> int:
    """For steps so long, times the fastest rate."""
    record = max(records, key=lambda r: len(r.t))
    initial = np.array([state.initial for state in plant.signals.states])
    x = np.where(np.isfinite(record.x), record.x, initial)
    kept = np.linspace(0, len(x) - 1, min(500, len(x))).astype(int)
    rate = fastest_rate(plant, x[kept], record.u[kept])
    return substeps_for(record.step, step / rate if rate > 0 else 1e9)


def _as_it_is(data: Data, plant: GrayBoxPlant, origin: str = WARM) -> Candidate:
    """A plant, its windows' starts fitted."""
    unknowns = unknowns_of(plant) if origin == WARM else unknown_constants(plant)
    fitted = data.fit_starts(plant, unknowns, unknowns.vector(plant))
    data.remember(data.pieces, fitted.x)
    return validated(data, Candidate(plant, unknowns, fitted, np.inf, origin))


def _physics(
    data: Data,
    plant: GrayBoxPlant,
    warm: Sequence[GrayBoxPlant],
    seed: int,
    restarts: int,
    progress: Callable[[str], None],
    notes: list[str],
) -> list[Candidate]:
    """The parameters alone: short windows from several starts, then whole runs."""
    unknowns, networks = unknown_constants(plant), unknowns_of(plant).networks
    if not unknowns.parameters:  # what is known already is where the networks start from
        return [] if warm else [_as_it_is(data, plant, "physics")]
    first = unknowns.vector(plant)
    thetas = [unknowns.vector(warm[0])] if warm else []
    thetas.append(first)
    # where every state is measured the equation error has been through the starts already
    count = 4 if warm else restarts
    thetas += [around(first, seed, k) for k in range(len(thetas), count)]
    progress("fitting the physics over short windows")
    short = data.short()
    fits, failed = over_short_windows(data, plant, unknowns, thetas, short)
    if not networks and fits and fits[0].mse > FIRST_SIGMA**2:
        wider = replace(data, sd=_wider(data))
        again, failed_again = over_short_windows(wider, plant, unknowns, thetas, short)
        if again and again[0].mse < CLEARLY * fits[0].mse:
            data.sd, fits, failed = wider.sd, again, failed_again
    notes += few_starts("physics", failed, len(thetas))
    if not fits:
        return []
    data.remember(short, fits[0].x)
    progress("fitting the physics over long windows")
    trials = FIRST_TRIALS if networks else LAST_TRIALS
    # a state that hardly moves within a short window has no slope there that leads back
    starts = np.stack([*_apart(fits), first])
    longs = data.fit(plant, unknowns, starts, sigma=sigma_of(fits[0]), trials=trials)
    return _distinct(
        [validated(data, Candidate(plant, unknowns, each, np.inf, "physics")) for each in longs]
    )


def _wider(data: Data) -> Float[np.ndarray, "states"]:
    """Spreads of hidden states' starts that leave them free, but between `min` and `max`."""
    limited = [np.isfinite(state.max - state.min) for state in data.signals.states]
    return np.where(limited, data.sd, WIDER * data.sd)


def _apart(fits: Sequence[Fitted]) -> list[np.ndarray]:
    """Unknowns of fits that found different places, best first: their errors may be the same."""
    found: list[np.ndarray] = []
    for each in fits:
        near = any(np.max(np.abs(each.theta - other)) < NEAR for other in found)
        if not near and each.mse < GOOD * fits[0].mse:
            found.append(each.theta)
    return found[:PLACES]


def _choose_hold(
    data: Data, candidates: Sequence[Candidate], names: Sequence[str]
) -> tuple[dict[str, str], Signals]:
    """The hold of the inputs that the file leaves open, by the error of a refit.

    From several minima: which is the best under a wrong hold says little.
    """
    best = sorted(candidates, key=lambda c: c.validation)[:HOLD_STARTS]
    chosen, least, given = HOLDS[0], np.inf, data.signals
    for hold in HOLDS:
        data.signals = _held(given, names, hold)
        error = min(_again(data, each).validation for each in best)
        if error < CLEARLY * least:
            chosen, least = hold, error
    return dict.fromkeys(names, chosen), _held(given, names, chosen)


def _choose_drift(data: Data, candidates: list[Candidate]) -> list[Candidate]:
    """The candidates with such a prior of the drift as the best has by evidence, updated while that
    wins on unseen samples."""
    for _ in range(DRIFT_ROUNDS):
        before, factor = data.drift, drift_by_evidence(data, candidates[0])
        data.drift = before.rescaled(factor)
        again = _distinct([_again(data, _in_units(data, c, factor)) for c in candidates])
        if not again or not again[0].validation < candidates[0].validation:
            data.drift = before
            break
        candidates = again
    return candidates


def _in_units(data: Data, candidate: Candidate, factor: Float[np.ndarray, "slow"]) -> Candidate:
    """The candidate with the increments of its drift in units `factor` times as large."""
    fitted, z = candidate.fitted, candidate.fitted.z.copy()
    increments = data.drift.increments(fitted.x.shape[1]) * len(factor)
    walked = z[:, z.shape[1] - increments :].reshape(len(z), -1, len(factor))
    z[:, z.shape[1] - increments :] = (walked / factor).reshape(len(z), -1)
    return replace(candidate, fitted=fitted._replace(z=z))


def _held(signals: Signals, names: Sequence[str], hold: Hold) -> Signals:
    inputs = tuple(
        replace(each, hold=hold) if each.name in names else each for each in signals.inputs
    )
    return replace(signals, inputs=inputs)


def _again(data: Data, candidate: Candidate) -> Candidate:
    """The candidate fitted once more from where it stands; the warm start only simulated."""
    if candidate.origin == WARM:
        fitted = data.fit_starts(candidate.plant, candidate.unknowns, candidate.fitted.theta)
        return validated(data, replace(candidate, fitted=fitted))
    return validated(data, fitted_again(data, candidate, candidate.ridge, MORE_TRIALS))


def no_finite_start(data: Data, plant: GrayBoxPlant) -> str:
    """A sentence: where the simulation of the plant as its file states it leaves all bounds."""
    unknowns = unknowns_of(plant)
    windows = data.windows(data.pieces)
    z = np.zeros((len(data.pieces), local_unknowns(unknowns, windows)))
    x, _ = simulated(plant, unknowns, unknowns.vector(plant), z, windows, data.substeps)
    for path, piece in zip(x, data.pieces, strict=True):
        record = data.records[piece.record]
        cut = slice(piece.start, piece.stop)
        path = path[: piece.stop - piece.start]
        where = blow_up(record.run, record.t[cut], path, plant.signals.state_names)
        if where:
            return (
                f"the simulation of plant {plant.spec.name!r} blows up: {where}; likely causes: "
                "(a) a wrong sign or unit in its derivative, (b) parameter values far from the "
                "truth, so give better ones or min and max, (c) an unstable plant logged in "
                "closed loop, (d) sqrt, log or a power of what falls below 0, or a division by "
                "0, so protect it with max()"
            )
    return (
        f"no start of plant {plant.spec.name!r} simulates to a finite error on the held-out data; "
        "protect roots of what may fall below 0, logarithms and divisions in its expressions, as "
        "in sqrt(max(x, 0)) and log(max(x, 1e-6)), or give the parameters min and max"
    )
