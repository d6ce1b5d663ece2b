"""The constants of a plant that are uncertain: which a bank tracks, and how far a run has them from
the fit. What its networks may be larger or smaller in another run counts among them, as a network
is as much of one day as a friction coefficient is."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.detection.remember import once
from faultgauge.detection.rows.judged import operating_points
from faultgauge.plants.disturbed import Disturbed, Error
from faultgauge.plants.model import Model
from faultgauge.plants.plant import respond
from faultgauge.plants.spec import Parameter
from faultgauge.programs import program

__all__ = [
    "USUAL_SPREAD",
    "Constants",
    "constants_of",
    "drifting_of",
    "parameters_of",
    "usual_spread",
]

LOW = 5.0  # standard errors below what a constant is: filters may try it there
# What differs from run to run and is not tracked looks like a fault that is as old as the log; what
# does next to nothing is known so badly that it would hide faults.
MATTERS = 0.995  # of what all constants do (squares): as many are tracked as make that up,
FEWEST_CONSTANTS = 6  # with those that move one rate or output most, but no fewer,
MOST_CONSTANTS = 10  # nor more
USUAL_SPREAD = 0.01  # of a constant, from run to run


def drifting_of(model: Model) -> tuple[str, ...]:
    """Parameters with `vary = "slow"`."""
    return tuple(p.name for p in model.plant.spec.parameters if p.vary == "slow")


def parameters_of(model: Model) -> dict[str, Parameter]:
    """All that may be uncertain, by name: parameters, and the gains of networks."""
    return {p.name: p for p in (*model.plant.spec.parameters, *model.plant.gains)}


class Constants(NamedTuple):
    """The constants that are uncertain, with the covariance that the fit gives them; which of them
    are `positive` and so uncertain that a filter may try them near 0 or below."""

    names: tuple[str, ...]
    covariance: Float[np.ndarray, "constants constants"]
    positive: tuple[int, ...]


def constants_of(model: Model) -> Constants:
    """Those that a calibration tells of; before one, those that move the states' rates and outputs
    most, by their standard errors and the usual spread, and those that a fault changes: how much of
    that there is in healthy plants, nothing else can tell."""
    known, free = model.record.constants, _free(model)
    if not free:
        return Constants((), np.zeros((0, 0)), ())
    se = _errors(model)
    told = model.calibration and model.calibration.noise
    if told:
        kept = [k for k, name in enumerate(free) if name in told.spread]
    else:
        kept = _most_moving(model)
    place = {name: k for k, name in enumerate(known.names)}
    correlation = np.eye(len(kept))
    for a, i in enumerate(kept):
        for b, j in enumerate(kept):
            if a != b and free[i] in place and free[j] in place:
                found = known.correlation[place[free[i]]][place[free[j]]]
                correlation[a, b] = found or 0.0
    covariance = correlation * np.outer(se[kept], se[kept])
    w, v = np.linalg.eigh(covariance)
    spec, values = parameters_of(model), model.plant.values()
    names = tuple(free[k] for k in kept)
    covariance = _within((v * np.maximum(w, 0.0)) @ v.T, _evenly(model, names))
    positive = tuple(
        k
        for k, (name, error) in enumerate(zip(names, np.sqrt(np.diag(covariance)), strict=True))
        if spec[name].positive and LOW * error >= float(values[name]) > 0
    )
    return Constants(names, covariance, positive)


def _evenly(model: Model, names: Sequence[str]) -> Float[np.ndarray, "constants"]:
    """The variance of each constant, anywhere between its bounds: width^2 / 12."""
    spec = parameters_of(model)
    return np.array([(spec[name].max - spec[name].min) ** 2 / 12 for name in names])


def _within(
    covariance: Float[np.ndarray, "constants constants"], evenly: Float[np.ndarray, "constants"]
) -> Float[np.ndarray, "constants constants"]:
    """`covariance` with what bounds tell besides, by which the variance D of each constant is at
    most what it is where all values are as likely: P - P (P + D)^-1 P. What no log tells is as sure
    as the file says."""
    bounded = np.flatnonzero(np.isfinite(evenly))
    some = covariance[np.ix_(bounded, bounded)] + np.diag(evenly[bounded])
    less = covariance[:, bounded] @ np.linalg.solve(some, covariance[bounded])
    left = covariance - less
    return (left + left.T) / 2


def usual_spread(value: float, se: float) -> float:
    """By how much a constant of `value` and standard error `se` may differ from run to run where
    no log tells."""
    return max(USUAL_SPREAD * abs(value), se, 1e-9)


def _free(model: Model) -> list[str]:
    slow = drifting_of(model)
    return [name for name, p in parameters_of(model).items() if not p.fixed and name not in slow]


def _errors(model: Model) -> Float[np.ndarray, "free"]:
    known = model.record.constants
    error = dict(zip(known.names, known.errors, strict=True))
    return np.array([_spread_in_a_run(model, n, error.get(n) or 0.0) for n in _free(model)])


def _spread_in_a_run(model: Model, name: str, error: float) -> float:
    """How far a run's own value lies from the model's: the standard `error`, or, of a parameter
    that each run has its own of, how far runs lie apart."""
    parameter = parameters_of(model)[name]
    if parameter.vary is None or model.record.between is None:
        return float(error)
    apart = model.record.between.apart[name]
    return apart * float(model.plant.parameters[name]) if parameter.positive else apart


@once
def _most_moving(model: Model) -> list[int]:
    """The places of these among the free ones, whatever a calibration says."""
    values, free = model.plant.values(), _free(model)
    se = np.minimum(_errors(model), np.sqrt(_evenly(model, free)))
    usual = np.array([usual_spread(float(values[n]), s) for n, s in zip(free, se, strict=True)])
    each = _effects(model, tuple(free)) * np.hypot(se, usual)[:, None]
    effects = np.sqrt(np.sum(each**2, axis=1))
    first = np.isin(np.arange(len(free)), np.argmax(each, axis=0)[each.any(axis=0)])
    order = np.lexsort((-effects, ~first))
    done = np.cumsum(effects[order] ** 2)
    enough = int(np.searchsorted(done, MATTERS * done[-1])) + 1
    count = min(max(enough, FEWEST_CONSTANTS), MOST_CONSTANTS)
    entered = ("parameter", "network")
    changed = {fault.target for fault in model.plant.signals.faults if fault.enters in entered}
    changing = np.flatnonzero(np.isin(free, [*changed])).tolist()
    return sorted({*order[:count].tolist(), *changing})


def _effects(model: Model, names: tuple[str, ...]) -> Float[np.ndarray, "constants both"]:
    """How far a unit of each constant moves each rate and output, in units of their spread."""
    points = operating_points(model)
    nothing = Error(*[jax.device_put(np.zeros(0))] * 3)
    none, unit = map(jax.device_put, (np.zeros(len(names)), np.eye(len(names))))
    plant = Disturbed.of(model.plant, (), (), nothing, names, none, unit)
    slopes, usual = map(np.asarray, _moved(plant, *map(jax.device_put, points)))
    usual = np.nanstd(np.where(np.isfinite(usual), usual, np.nan), axis=0) + 1e-12
    slopes = np.where(np.isfinite(slopes), slopes, 0.0) / usual[:, None]
    return np.sqrt(np.mean(slopes**2, axis=0)).T


@program
def _moved(plant: Disturbed, x: Array, u: Array) -> tuple[Array, Array]:
    """Of rates and outputs at some points: their slopes over constants, and themselves."""

    def both(xi: Array, x: Array, u: Array) -> Array:
        dx, y = respond(plant, jnp.concatenate([x, xi]), u)
        return jnp.concatenate([dx[: plant.count], y])

    none, over = jnp.zeros(plant.directions.shape[1]), (None, 0, 0)
    return jax.vmap(jax.jacfwd(both), over)(none, x, u), jax.vmap(both, over)(none, x, u)
