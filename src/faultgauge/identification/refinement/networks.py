"""Networks beside the physics: silent starts, their scalings, and the path of prior weights."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.equation_error import groups, scale_networks
from faultgauge.identification.refinement.candidate import (
    Candidate,
    sample_count,
    sigma_of,
    validated,
)
from faultgauge.identification.refinement.claims import Claims, claims_of
from faultgauge.identification.refinement.cores import side_by_side
from faultgauge.identification.refinement.data import BUDGET, FIRST_SIGMA, Data
from faultgauge.identification.refinement.evidence import by_evidence
from faultgauge.identification.refinement.linear_starts import equivalents
from faultgauge.identification.refinement.records import Piece
from faultgauge.identification.refinement.short_windows import around, over_short_windows
from faultgauge.identification.refinement.simulation_error import Fitted
from faultgauge.identification.refinement.stepping import fine_enough
from faultgauge.identification.refinement.unknowns import WEIGHTS, Unknowns, unknowns_of
from faultgauge.identification.samples import Samples
from faultgauge.identification.sizes import chosen_sizes, smallest_sufficient, with_hidden
from faultgauge.identification.starts import nguyen_widrow
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.network import Network
from faultgauge.plants.plant import respond
from faultgauge.plants.shape import FREE

__all__ = ["FINALISTS", "with_networks"]

SILENT_STARTS, MANY_STARTS = 2, 4  # where samples are many; where they are few, or bases more
PROMISING = 2.0  # times the least error of the physics: minima that networks start from
SCALE_POINTS = 500
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
WHISPER = 0.3  # of a start's output weights where squares of them count: at 0 they have no slope
TELLING = 5_000  # samples
FEATURE_SEED = 0  # of the functions that networks are taken to be able to imitate
POOR = 0.5  # of the outputs' spread: physics that tells little without its networks
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
    found: list[Candidate] = []
    if bases[0].validation > POOR:
        found += _together(data, bases[0].plant, seed, restarts, progress, notes)
    few = sample_count(data.pieces) <= SCREEN
    equivalent = _equivalent(data, bases[0], np.random.default_rng([seed, 13]))
    bases = [*(bases if few else bases[:FINALISTS]), *equivalent]
    if len(bases) > MANY_STARTS and not few:
        progress("networks: which start to take, over short windows")
        screened = _screened(data, bases, seed)
        if screened is None:
            notes.append("networks: over short windows no start had a finite simulation error")
        else:
            sigma, plant, fitted, claims = screened
            found += _path(
                data, "networks", [plant], LEARNED_RIDGES, sigma, claims, progress, [fitted],
                trials=LEARNED_TRIALS,
            )  # fmt: skip
    else:
        count = min(restarts, MANY_STARTS if few else max(SILENT_STARTS, len(bases)))
        for margin in MARGINS if few else MARGINS[:1]:
            silent: list[GrayBoxPlant] = []
            for k in range(count):
                base = bases[k % len(bases)]
                values = base.unknowns.assemble(base.plant, jnp.asarray(base.fitted.theta))
                scaled = _like(silent[0], values) if silent else _scaled(data, base, data.pieces)
                rng = np.random.default_rng([seed, 11, k])
                silent.append(_silent(scaled, rng, 1.0 if silent else margin))
            name = f"networks, margin {margin:g}"
            claims = _claims(data, replace(bases[0], plant=silent[0]), data.pieces)
            floor = bases[0].validation
            found += _path(data, name, silent, RIDGES, sigma, claims, progress, floor=floor)
    if warm:
        sigma = sigma_of(candidates[0].fitted)
        name = "warm start, refined"
        claims = _claims(data, replace(bases[0], plant=warm[0]), data.pieces)
        found += _path(data, name, list(warm[:FINALISTS]), WARM_RIDGES, sigma, claims, progress)
    progress("networks: prior weights by evidence")
    usable = [each for each in found if np.isfinite(each.validation)]
    if len(usable) < len(found):
        lost = len(found) - len(usable)
        notes.append(f"networks: {lost} of {len(found)} starts had no finite simulation error")
    best = sorted(usable, key=lambda each: each.validation)[:FINALISTS]
    return [*found, *side_by_side(lambda each: by_evidence(data, each), best)]


def _together(
    data: Data,
    plant: GrayBoxPlant,
    seed: int,
    restarts: int,
    progress: Callable[[str], None],
    notes: list[str],
) -> list[Candidate]:
    """Parameters and networks fitted at once from the file's values, over short windows first:
    where a plant does nothing sensible without its networks, the parameters that are best without
    them are no place to start."""
    progress("networks and physics together, over short windows")
    fresh, short = data.afresh(), data.short()
    unknowns, physics = unknowns_of(plant), unknowns_of(plant, networks=False)
    silent: list[GrayBoxPlant] = []
    first = physics.vector(plant)
    for k in range(restarts):
        theta = around(first, seed, k) if k else first
        fitted = fresh.fit(plant, physics, theta[None], pieces=short, sigma=FIRST_SIGMA, trials=0)
        base = Candidate(plant, physics, fitted[0], np.inf, "")
        values = physics.assemble(plant, jnp.asarray(theta))
        scaled = _like(silent[0], values) if silent else _scaled(fresh, base, short)
        rng = np.random.default_rng([seed, 11, k])
        silent.append(_silent(scaled, rng, 1.0 if silent else MARGINS[0]))
    thetas = [unknowns.vector(each) for each in silent]
    fits, failed = over_short_windows(fresh, silent[0], unknowns, thetas, short)
    if not fits:
        notes.append(f"networks: none of {failed} starts had a finite simulation error")
        return []
    fresh.remember(short, fits[0].x)
    plants = [unknowns.assemble(silent[0], jnp.asarray(f.theta)) for f in fits[:FINALISTS]]
    return _path(fresh, "networks, together", plants, LEARNED_RIDGES, FIRST_SIGMA, None, progress)


def _equivalent(data: Data, base: Candidate, rng: np.random.Generator) -> list[Candidate]:
    """Starts that only a nonlinearity can tell from `base` (see `linear_starts`)."""
    x, u = _visited(data, base, data.pieces)
    thetas = equivalents(
        base.plant, base.unknowns, base.fitted.theta, x.mean(axis=0), u.mean(axis=0), rng
    )
    return [replace(base, fitted=base.fitted._replace(theta=theta)) for theta in thetas]


def _claims(data: Data, base: Candidate, pieces: Sequence[Piece]) -> Claims | None:
    """What the physics of `base`, fitted over `pieces`, keeps to itself. Over few samples networks
    can imitate anything, and what they are kept from says nothing."""
    if not base.unknowns.parameters or sample_count(pieces) < TELLING:
        return None
    x, u = _visited(data, base, pieces)
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
        scaled = _scaled(data, replace(base, fitted=settled), short)
        plant = _silent(scaled, np.random.default_rng([seed, 11, k]), MARGINS[0])
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
        scaled = _scaled(data, replace(base, plant=sized), data.pieces)
        start = _silent(scaled, np.random.default_rng([seed, 11, 0]), MARGINS[0])
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
    name: str,
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

    `plants` share one scaling; `fits` are theirs so far. After a few weights only the best go on.
    A network that is no better than `floor`, the physics alone, has been shrunk to nothing and
    would not come to life again: its start tries anew under the next weight.
    """
    unknowns = unknowns_of(plants[0])
    thetas = first = np.stack([unknowns.vector(each) for each in plants])
    trials = int(trials * np.clip(BUDGET / sample_count(data.pieces), 1.0, MOST_EFFORT))
    going, quiet = list(range(len(plants))), 0
    best: dict[int, Candidate] = {}
    for step, ridge in enumerate(ridges):
        progress(f"{name}: prior weight {ridge:.3g}")
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
            each = Candidate(plants[0], unknowns, fitted, np.inf, name, own, claims=claims)
            found = validated(data, each)
            before = best[k].validation if k in best else np.inf
            if k not in best or found.validation < BETTER * before:  # or the stronger prior stays
                best[k], quiet = found, 0
        learned = np.array([best[k].validation < BETTER * floor for k in going])
        if quiet >= PATIENCE and learned.any():
            break
        thetas = np.stack([fitted.theta for fitted in fits])
        thetas = np.where(learned[:, None], thetas, first)
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


def _range(
    network: Network,
) -> tuple[Float[np.ndarray, "arguments"], Float[np.ndarray, "arguments"]]:
    center, scale = np.asarray(network.input_center), np.asarray(network.input_scale)
    return center - scale, center + scale


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
    ranges = _scaled(data, now, data.pieces).networks
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


def _scaled(data: Data, base: Candidate, pieces: Sequence[Piece]) -> GrayBoxPlant:
    """The plant of `base`, its networks scaled by measured states, and where it takes hidden ones
    along the `pieces` that it was fitted to."""
    plant = base.unknowns.assemble(base.plant, jnp.asarray(base.fitted.theta))
    x, u = _visited(data, base, pieces)
    y = np.concatenate([data.records[p.record].y[p.start : p.stop] for p in pieces])
    dx = np.asarray(jax.vmap(plant.derivative)(jnp.asarray(x), jnp.asarray(u)))
    samples = Samples(x, u, dx, np.nan_to_num(y))
    for group in groups(plant.spec, plant.signals.output_names):
        plant = scale_networks(plant, group, samples)
    return _outputs_scaled(plant, x, u)


def _visited(
    data: Data, base: Candidate, pieces: Sequence[Piece]
) -> tuple[Float[np.ndarray, "samples states"], Float[np.ndarray, "samples inputs"]]:
    """(states, inputs) along the `pieces` that `base` was fitted to: measured, or as fitted."""
    paths = zip(base.fitted.x, pieces, strict=True)
    x = np.concatenate([path[: p.stop - p.start] for path, p in paths])
    measured = np.concatenate([data.records[p.record].x[p.start : p.stop] for p in pieces])
    x = np.where(np.isfinite(measured), measured, x)
    return x, np.concatenate([data.records[p.record].u[p.start : p.stop] for p in pieces])


def _outputs_scaled(
    plant: GrayBoxPlant, x: Float[np.ndarray, "samples states"], u: Float[np.ndarray, "samples _"]
) -> GrayBoxPlant:
    """Networks' output scales such that 1 moves an equation by half its range.

    Inside an equation a network may be multiplied by anything: its share there, dF / dNN, counts.
    """
    kept = np.linspace(0, len(x) - 1, min(SCALE_POINTS, len(x))).astype(int)
    x, u = x[kept], u[kept]

    def equations(centers: dict[str, Array], x: Array, u: Array) -> Array:
        moved = {
            name: eqx.tree_at(lambda net: net.output_center, network, centers[name])
            for name, network in plant.networks.items()
        }
        dx, y = respond(eqx.tree_at(lambda p: p.networks, plant, moved), x, u)
        return jnp.concatenate([dx, y])

    centers = {name: network.output_center for name, network in plant.networks.items()}
    points = jnp.asarray(x), jnp.asarray(u)
    values = np.asarray(jax.vmap(equations, (None, 0, 0))(centers, *points))
    shares = jax.vmap(jax.jacfwd(equations), (None, 0, 0))(centers, *points)
    half = np.ptp(values, axis=0) / 2
    networks = dict(plant.networks)
    for name, share in shares.items():
        typical = np.median(np.abs(np.asarray(share)), axis=0)
        reach = [h / t for h, t in zip(half, typical, strict=True) if t > 0 and h > 0]
        if reach:
            networks[name] = eqx.tree_at(
                lambda net: net.output_scale, networks[name], jnp.asarray(min(reach))
            )
    return eqx.tree_at(lambda p: p.networks, plant, networks)


def _silent(plant: GrayBoxPlant, rng: np.random.Generator, margin: float) -> GrayBoxPlant:
    """Networks that start at (about) zero, so that the physics is where the fit begins.

    `margin` widens their arguments' ranges.
    """
    networks = {}
    for spec in plant.spec.networks:
        start = nguyen_widrow(spec.hidden, spec.arity, rng, spec.shape)
        start["weights_out"] = (WHISPER if spec.monotone else 0.0) * start["weights_out"]
        old = plant.networks[spec.name]
        networks[spec.name] = eqx.tree_at(
            lambda net: [*(getattr(net, field) for field in WEIGHTS), net.input_scale],
            old,
            [*(jnp.asarray(start[field]) for field in WEIGHTS), margin * old.input_scale],
        )
    return eqx.tree_at(lambda p: p.networks, plant, networks)
