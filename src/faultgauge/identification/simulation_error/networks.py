"""Networks beside the physics: which starts they have, and the path of prior weights."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.identification.optimise.cores import side_by_side
from faultgauge.identification.simulation_error.candidate import (
    Candidate,
    few_starts,
    sample_count,
    sigma_of,
    validated,
)
from faultgauge.identification.simulation_error.claims import Claims, claims_of
from faultgauge.identification.simulation_error.data import BUDGET, FIRST_SIGMA, Data
from faultgauge.identification.simulation_error.evidence import by_evidence
from faultgauge.identification.simulation_error.linear_starts import equivalents
from faultgauge.identification.simulation_error.records import Piece
from faultgauge.identification.simulation_error.short_windows import around, over_short_windows
from faultgauge.identification.simulation_error.silent import scaled, silent, visited
from faultgauge.identification.simulation_error.stepping import fine_enough
from faultgauge.identification.simulation_error.window_fit import Fitted
from faultgauge.identification.sizes import chosen_sizes, smallest_sufficient, with_hidden
from faultgauge.identification.unknowns import Unknowns, unknown_constants, unknowns_of
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.shape import FREE

__all__ = ["CROWDED", "FINALISTS", "with_networks"]

SILENT_STARTS, MANY_STARTS = 2, 4  # where samples are many; where they are few, or bases more
PROMISING = 2.0  # times the least error of the physics: minima that networks start from
FIRST_ROUND, FINALISTS = 2, 2  # after this prior weight, so many starts go on down the path
# Weights of the networks' prior. Stronger ones first lead the search into worse minima.
RIDGES = tuple(10.0 ** (k / 2) for k in range(4, -5, -1))
LEARNED_RIDGES = tuple(10.0**k for k in (1, 0, -1))  # after a screening
SCREEN = 10_000  # samples to fit: fewer can be gone through whole, from every start
SETTLE_TRIALS, FINAL_TRIALS = 5, 12  # of a screening, before its networks and after
WARM_RIDGES = tuple(10.0**k for k in range(-1, 4))  # upwards: networks that are already learned
TRIALS, MOST_EFFORT = 50, 3.0  # per prior weight; more of them where a log is short
LEARNED_TRIALS = 25  # in and after a screening
PATIENCE, BETTER = 2, 0.99  # of the validation error: less gain does not pay another prior weight
TELLING = 5_000  # samples
FEATURE_SEED = 0  # of the functions that networks are taken to be able to imitate
CROWDED = "units where arguments crowd"  # every other start, where a few samples lie far off
POOR_ALONE = 0.5  # of the outputs' spread: physics that tells little without its networks
MARGINS = (1.2, 2.0)  # of the arguments' range under the physics alone: networks will move it


def with_networks(
    data: Data,
    candidates: Sequence[Candidate],
    warm: Sequence[GrayBoxPlant],
    seed: int,
    restarts: int,
    progress: Callable[[str], None],
    notes: list[str],
) -> list[Candidate]:
    """Networks beside the parameters: silent ones from several starts, and the warm starts."""
    bases = [c for c in candidates if c.origin == "physics"] or list(candidates[:1])
    bases = [c for c in bases if c.validation <= PROMISING * bases[0].validation]
    sigma = sigma_of(bases[0].fitted)
    if bases[0].plant.spec.open_sizes:
        progress("networks: how many hidden units")
        sizes = _sizes(data, bases[0], sigma, seed)
        bases = [replace(base, plant=with_hidden(base.plant, sizes)) for base in bases]
    found, lost = list[Candidate](), 0
    if bases[0].validation > POOR_ALONE:
        found, lost = _together(data, bases[0].plant, seed, restarts, progress)
    few = sample_count(data.pieces) <= SCREEN
    equivalent = _equivalent(data, bases[0], np.random.default_rng([seed, 13]))
    bases = [*(bases if few else bases[:FINALISTS]), *equivalent]
    if len(bases) > MANY_STARTS and not few:
        progress("networks: which start to take, over short windows")
        screened = _screened(data, bases, seed)
        if screened is None:
            notes += few_starts("networks", len(bases), len(bases))
        else:
            sigma, plant, fitted, claims = screened
            found += _path(
                data, ["networks"], [plant], LEARNED_RIDGES, sigma, claims, progress, [fitted],
                trials=LEARNED_TRIALS,
            )  # fmt: skip
    else:
        count = min(restarts, MANY_STARTS if few else max(SILENT_STARTS, len(bases)))
        margins = MARGINS if few else MARGINS[:1]
        found += _from_silence(data, bases, count, margins, sigma, seed, progress)
    if warm:
        sigma = sigma_of(candidates[0].fitted)
        claims = _claims(data, replace(bases[0], plant=warm[0]), data.pieces)
        starts = list(warm[:FINALISTS])
        names = ["warm start, refined"] * len(starts)
        found += _path(data, names, starts, WARM_RIDGES, sigma, claims, progress)
    progress("networks: prior weights by evidence")
    usable = [each for each in found if np.isfinite(each.validation)]
    notes += few_starts("networks", lost + len(found) - len(usable), lost + len(found))
    best = sorted(usable, key=lambda each: each.validation)[:FINALISTS]
    return [*found, *side_by_side(lambda each: by_evidence(data, each), best)]


def _from_silence(
    data: Data,
    bases: Sequence[Candidate],
    count: int,
    margins: Sequence[float],
    sigma: float,
    seed: int,
    progress: Callable[[str], None],
) -> list[Candidate]:
    """From `count` starts about `bases`, whose networks do nothing yet; every other one has its
    units where the arguments crowd."""
    found: list[Candidate] = []
    first, crowded = scaled(data, bases[0], data.pieces)
    for margin in margins:
        name, starts, names = f"networks, margin {margin:g}", list[GrayBoxPlant](), list[str]()
        for k in range(count):
            base, rng = bases[k % len(bases)], np.random.default_rng([seed, 11, k])
            values = base.assembled
            plant = _like(starts[0], values) if starts else first
            where = crowded if k % 2 else {}
            starts.append(silent(plant, rng, 1.0 if starts else margin, where))
            names.append(f"{name}, {CROWDED}" if where else name)
        claims = _claims(data, replace(bases[0], plant=starts[0]), data.pieces)
        floor = bases[0].validation
        found += _path(data, names, starts, RIDGES, sigma, claims, progress, floor=floor)
    return found


def _together(
    data: Data,
    plant: GrayBoxPlant,
    seed: int,
    restarts: int,
    progress: Callable[[str], None],
) -> tuple[list[Candidate], int]:
    """Parameters and networks fitted at once from the file's values, over short windows first:
    where a plant does nothing sensible without its networks, the parameters that are best without
    them are no place to start. And how many starts there were, if all are lost."""
    progress("networks and physics together, over short windows")
    fresh, short = data.afresh(), data.short()
    unknowns, physics = unknowns_of(plant), unknown_constants(plant)
    first = physics.vector(plant)
    at_file = fresh.fit(plant, physics, first[None], pieces=short, sigma=FIRST_SIGMA, trials=0)[0]
    try:
        scales, _ = scaled(fresh, Candidate(plant, physics, at_file, np.inf, ""), short)
    except InputError:  # these values leave an argument where it is: its range is not known
        return [], 0
    starts = [silent(scales, np.random.default_rng([seed, 11, 0]), MARGINS[0])]
    for k in range(1, restarts):
        values = physics.assemble(plant, jnp.asarray(around(first, seed, k)))
        rng = np.random.default_rng([seed, 11, k])
        starts.append(silent(_like(starts[0], values), rng, 1.0))
    thetas = [unknowns.vector(each) for each in starts]
    fits, failed = over_short_windows(fresh, starts[0], unknowns, thetas, short)
    if not fits:
        return [], failed
    fresh.remember(short, fits[0].x)
    plants = [unknowns.assemble(starts[0], jnp.asarray(f.theta)) for f in fits[:FINALISTS]]
    names = ["networks, together"] * len(plants)
    found = _path(fresh, names, plants, LEARNED_RIDGES, FIRST_SIGMA, None, progress)
    data.substeps = fresh.substeps  # what they were fitted with
    windows = data.windows(data.pieces)  # hidden states' first guesses are others here
    z = [data.starts(windows, each.fitted) for each in found]
    both = zip(found, z, strict=True)
    return [replace(c, fitted=c.fitted._replace(z=own)) for c, own in both], 0


def _equivalent(data: Data, base: Candidate, rng: np.random.Generator) -> list[Candidate]:
    """Starts that only a nonlinearity can tell from `base` (see `linear_starts`)."""
    x, u = visited(data, base, data.pieces)
    thetas = equivalents(
        base.plant, base.unknowns, base.fitted.theta, x.mean(axis=0), u.mean(axis=0), rng
    )
    return [replace(base, fitted=base.fitted._replace(theta=theta)) for theta in thetas]


def _claims(data: Data, base: Candidate, pieces: Sequence[Piece]) -> Claims | None:
    """What the physics of `base`, fitted over `pieces`, keeps to itself. Over few samples networks
    can imitate anything, and what they are kept from says nothing."""
    if not base.unknowns.parameters or sample_count(pieces) < TELLING:
        return None
    x, u = visited(data, base, pieces)
    fitted, sigma = base.fitted, sigma_of(base.fitted)
    windows, rng = data.windows(pieces), np.random.default_rng(FEATURE_SEED)
    return claims_of(base.plant, fitted.theta, fitted.z, windows, data.substeps, sigma, (x, u), rng)


def _screened(
    data: Data, bases: Sequence[Candidate], seed: int
) -> tuple[float, GrayBoxPlant, Fitted, Claims | None] | None:
    """(sigma, plant, fit, claims) of the best of `bases` with networks: all over short windows,
    then the best of them over all. None where none has a finite error over short windows."""
    short = data.short()

    def tried(k: int) -> tuple[float, GrayBoxPlant, Fitted, Claims | None] | None:
        base = bases[k]
        sigma, theta = sigma_of(base.fitted), base.fitted.theta[None]
        settled = data.fit(
            base.plant, base.unknowns, theta, pieces=short, sigma=sigma, trials=SETTLE_TRIALS
        )[0]
        if not settled.usable:
            return None
        first, _ = scaled(data, replace(base, fitted=settled), short)
        plant = silent(first, np.random.default_rng([seed, 11, k]), MARGINS[0])
        claims = _claims(data, replace(base, plant=plant, fitted=settled), short)
        return _learned(data, plant, short, sigma, LEARNED_TRIALS, claims)

    found = [each for each in side_by_side(tried, range(len(bases))) if each is not None]
    found.sort(key=lambda each: each[0])
    sigma = sigma_of(bases[0].fitted)
    finals = side_by_side(
        lambda each: _learned(data, each[1], data.pieces, sigma, FINAL_TRIALS, each[3]),
        found[:FINALISTS],
    )
    return min(finals, key=lambda each: each[0], default=None)


def _sizes(data: Data, base: Candidate, sigma: float, seed: int) -> dict[str, int]:
    """Hidden units where the file leaves them open: the fewest that suffice, on samples that the
    fit has not seen."""

    def fit(sized: GrayBoxPlant) -> tuple[float, GrayBoxPlant]:
        first, crowded = scaled(data, replace(base, plant=sized), data.pieces)
        start = silent(first, np.random.default_rng([seed, 11, 0]), MARGINS[0], crowded)
        unknowns = unknowns_of(start)
        theta = unknowns.vector(start)[None]
        fitted = data.fit(start, unknowns, theta, sigma=sigma, trials=LEARNED_TRIALS)[0]
        return validated(data, Candidate(start, unknowns, fitted, np.inf, "")).validation, start

    return chosen_sizes(base.plant.spec, smallest_sufficient(base.plant, fit))


def _learned(
    data: Data,
    plant: GrayBoxPlant,
    pieces: Sequence[Piece],
    sigma: float,
    trials: int,
    claims: Claims | None,
) -> tuple[float, GrayBoxPlant, Fitted, Claims | None]:
    """(sigma, plant, fit, claims) after some trials."""
    unknowns = unknowns_of(plant)
    theta = unknowns.vector(plant)[None]
    fitted = data.fit(
        plant, unknowns, theta, pieces=pieces, sigma=sigma, trials=trials, claims=claims
    )[0]
    sigma = sigma_of(fitted) if fitted.usable else np.inf
    return sigma, unknowns.assemble(plant, jnp.asarray(fitted.theta)), fitted, claims


def _like(plant: GrayBoxPlant, values: GrayBoxPlant) -> GrayBoxPlant:
    """`values` with the scalings of `plant`: starts that are fitted side by side share them."""
    return eqx.tree_at(lambda p: p.networks, values, plant.networks)


def _path(
    data: Data,
    names: Sequence[str],
    plants: list[GrayBoxPlant],
    ridges: tuple[float, ...],
    sigma: float,
    claims: Claims | None,
    progress: Callable[[str], None],
    fits: Sequence[Fitted] = (),
    floor: float = np.inf,
    trials: int = TRIALS,
) -> list[Candidate]:
    """Every start's best along the prior weights, until none has got better twice running.

    `plants`, one to each of `names`, share one scaling; `fits` are theirs so far. After a few
    weights only the best go on. A network that is no better than `floor`, the physics alone, has
    been shrunk to nothing and would not come to life again: its start then tries anew.
    """
    unknowns = unknowns_of(plants[0])
    thetas = first = np.stack([unknowns.vector(each) for each in plants])
    trials = int(trials * np.clip(BUDGET / sample_count(data.pieces), 1.0, MOST_EFFORT))
    going, quiet = list(range(len(plants))), 0
    best: dict[int, Candidate] = {}
    for step, ridge in enumerate(ridges):
        progress(f"{names[0]}: prior weight {ridge:.3g}")
        fits = data.fit(
            plants[0],
            unknowns,
            thetas,
            after=fits,
            sigma=sigma,
            ridge=ridge,
            trials=trials,
            claims=claims,
        )
        quiet += 1
        for k, fitted in zip(going, fits, strict=True):
            own = ridge * (sigma / sigma_of(fitted)) ** 2
            each = Candidate(plants[0], unknowns, fitted, np.inf, names[k], own, claims=claims)
            found = validated(data, each)
            before = best[k].validation if k in best else np.inf
            if k not in best or found.validation < BETTER * before:  # or the stronger prior stays
                best[k], quiet = found, 0
        learned = np.array([best[k].validation < BETTER * floor for k in going])
        if quiet >= PATIENCE and learned.any():
            break
        thetas = np.where(learned[:, None], np.stack([each.theta for each in fits]), first)
        if step == FIRST_ROUND and len(going) > FINALISTS:
            order = np.argsort([best[k].validation for k in going], kind="stable")[:FINALISTS]
            going, thetas, first = [going[k] for k in order], thetas[order], first[order]
            fits = [fits[k] for k in order]
        now = min(best.values(), key=lambda c: c.validation)
        if not np.isfinite(now.validation):  # no path to follow: all begin anew
            fits = ()
            continue
        while not fine_enough(data, now):  # what was small beside the physics' error may not be now
            data.substeps *= 2
        plants, moved = _followed(data, plants, unknowns, np.concatenate([thetas, first]), now)
        thetas, first = np.split(moved, 2)
    return list(best.values())


def _followed(
    data: Data,
    plants: list[GrayBoxPlant],
    unknowns: Unknowns,
    thetas: Float[np.ndarray, "starts unknowns"],
    now: Candidate,
) -> tuple[list[GrayBoxPlant], Float[np.ndarray, "starts unknowns"]]:
    """Networks whose arguments have moved out of their range get a wider one.

    Inside the old range every start stays the function that it is:

        W2 p_s + theta,  p_s = (p - c) / s:   W2' = W2 s' / s,   theta' = theta + W2 (c' - c) / s
    """
    ranges = scaled(data, now, data.pieces)[0].networks
    wider = {}
    for name, network in plants[0].networks.items():
        new = ranges[name]
        low = np.minimum(
            network.input_center - network.input_scale, new.input_center - new.input_scale
        )
        high = np.maximum(
            network.input_center + network.input_scale, new.input_center + new.input_scale
        )
        grown = (high - low) / 2 > network.input_scale * (1 + 1e-6)
        if network.shape == FREE and bool(np.any(grown)):
            wider[name] = jnp.asarray((low + high) / 2), jnp.asarray((high - low) / 2)
    if not wider:
        return plants, thetas

    def widened(plant: GrayBoxPlant) -> GrayBoxPlant:
        networks = dict(plant.networks)
        for name, (center, scale) in wider.items():
            old = networks[name]
            shift = (center - old.input_center) / old.input_scale
            networks[name] = eqx.tree_at(
                lambda net: (net.weights_in, net.bias, net.input_center, net.input_scale),
                old,
                (
                    old.weights_in * scale / old.input_scale,
                    old.bias + old.weights_in @ shift,
                    center,
                    scale,
                ),
            )
        return eqx.tree_at(lambda p: p.networks, plant, networks)

    moved = [
        unknowns.vector(widened(unknowns.assemble(plants[0], jnp.asarray(theta))))
        for theta in thetas
    ]
    return [widened(plants[0])], np.stack(moved)
