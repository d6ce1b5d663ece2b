"""What a fleet tells of its units: mean and spread of every constant, and who is unlike the rest.

    z_i = m + s e_i + sqrt(v_i) n_i,    e_i ~ N(0, 1) of a unit like the others, else N(0, W^2)

z_i is what unit i's own logs say of a constant (its logarithm, where it differs by factors), v_i
how uncertain that is; e_i and n_i are independent. One unit in ten is expected to be unlike the
others in all of its constants, so that a log that is not healthy is outvoted and named (the
contaminated normal of J. W. Tukey, "A survey of sampling from contaminated distributions", 1960).
m and s by EM (A. P. Dempster, N. M. Laird and D. B. Rubin, J. R. Statist. Soc. B 39, 1977) from the
median on; s^2 with the prior that two more units, 10 % off, would be, as few units tell it badly.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from faultgauge.identification.unknowns import prior_width
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.network import Network
from faultgauge.plants.spec import Parameter
from faultgauge.telemetry.statistics import MAD_TO_STD

__all__ = ["FEWEST", "Law", "Population", "own_parameters", "population", "with_population"]

FEWEST = 4  # units that tell a spread, one of which may be unlike the others
UNLIKE = 0.1  # of the units, as expected before
WIDE = 10.0  # times as far from the mean as the others
ROUNDS, SETTLED = 1000, 1e-9  # at most; of the spread: a move that ends them
USUAL, USUAL_UNITS = 0.1, 2.0  # spread of machines of one make, and how many units that is worth


@dataclass(frozen=True)
class Law:
    """Of one constant over the fleet: its `center`, in its unit, the standard error of that, and
    the `spread` of units about it; both of the logarithm where `log`, else in its unit."""

    center: float
    spread: float
    error: float
    log: bool

    def off(self, value: float) -> float:
        """How many spreads a unit's `value` lies above the center."""
        far = np.log(value / self.center) if self.log else value - self.center
        return float(far / self.spread)

    def to_dict(self) -> dict[str, Any]:
        return vars(self)


@dataclass(frozen=True)
class Population:
    """`laws` of the constants by their names, and the probability that a unit is unlike the others,
    by its place."""

    laws: dict[str, Law]
    unlike: Float[np.ndarray, "units"]


def own_parameters(parameters: Sequence[Parameter]) -> list[Parameter]:
    """What every unit of a fleet has a value of its own of."""
    return [p for p in parameters if not p.fixed and p.vary is None]


def population(
    parameters: Sequence[Parameter],
    values: Float[np.ndarray, "units parameters"],
    errors: Float[np.ndarray, "units parameters"],
) -> Population:
    """The laws behind the `values` that units have of `parameters`, with their standard errors
    (NaN: not known, and the value tells nothing). A constant that fewer than four units know has no
    law."""
    log = np.array([p.min >= 0 for p in parameters], bool)
    known = np.isfinite(values) & np.isfinite(errors) & (~log | (values > 0))
    told = np.flatnonzero(known.sum(axis=0) >= FEWEST)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(log, np.log(np.maximum(values, 1e-300)), values)[:, told]
        v = np.where(log, errors / values, errors)[:, told] ** 2
    known = known[:, told]
    z, v = np.where(known, z, 0.0), np.where(known, v, 1.0)
    mean, spread, unlike = _mixture(z, v, known, log[told])
    like = known * (1 - unlike)[:, None]
    count = np.maximum(like.sum(axis=0), 2.0)
    error = 1 / np.sqrt(np.sum(known * _pull(v, spread, unlike), axis=0))
    # of a unit to come: the mean is one of the sample, and not known better than `error`
    spread = np.sqrt(spread**2 * count / (count - 1) + error**2)
    laws = {
        parameters[k].name: Law(
            float(np.exp(mean[j]) if log[k] else mean[j]),
            float(spread[j]),
            float(error[j]),
            bool(log[k]),
        )
        for j, k in enumerate(told.tolist())
    }
    return Population(laws, unlike)


def _mixture(
    z: Float[np.ndarray, "units laws"],
    v: Float[np.ndarray, "units laws"],
    known: np.ndarray,
    log: np.ndarray,
) -> tuple[Float[np.ndarray, "laws"], Float[np.ndarray, "laws"], Float[np.ndarray, "units"]]:
    """(m, s, the probability that a unit is unlike the others)."""
    cells = np.where(known, z, np.nan)
    mean = np.nanmedian(cells, axis=0) if z.size else np.zeros(z.shape[1])
    spread = MAD_TO_STD * np.nanmedian(np.abs(cells - mean), axis=0) if z.size else mean
    usual = np.where(log, USUAL, np.maximum(USUAL * np.abs(mean), 1e-12))
    spread, unlike = np.sqrt((spread**2 + usual**2) / 2), np.zeros(len(z))
    for _ in range(ROUNDS):
        near, far = spread**2 + v, (WIDE * spread) ** 2 + v
        r2 = (z - mean) ** 2
        odds = known * (r2 * (1 / near - 1 / far) - np.log(far / near)) / 2
        unlike = 1 / (1 + np.exp(-np.clip(np.log(UNLIKE / (1 - UNLIKE)) + odds.sum(1), -500, 500)))
        pull = known * _pull(v, spread, unlike)
        before, mean = (mean, spread), np.sum(pull * z, axis=0) / pull.sum(axis=0)
        r2, s2 = (z - mean) ** 2, spread**2
        # of e_i: what it is on the mean, and how uncertain, had it been drawn near or far
        of_near = s2 * r2 / near**2 + v / near
        of_far = WIDE**2 * s2 * r2 / far**2 + v / far
        drawn = (1 - unlike)[:, None] * of_near + unlike[:, None] * of_far
        squares = s2 * np.sum(known * drawn, axis=0) + USUAL_UNITS * usual**2
        spread = np.sqrt(squares / (known.sum(axis=0) + USUAL_UNITS))
        moved = np.abs(mean - before[0]) + np.abs(spread - before[1])
        if np.all(moved <= SETTLED * spread):
            break
    return mean, spread, unlike


def _pull(
    v: Float[np.ndarray, "units laws"],
    spread: Float[np.ndarray, "laws"],
    unlike: Float[np.ndarray, "units"],
) -> Float[np.ndarray, "units laws"]:
    """The weight of every unit in the mean."""
    near, far = 1 / (spread**2 + v), 1 / ((WIDE * spread) ** 2 + v)
    return (1 - unlike)[:, None] * near + unlike[:, None] * far


def with_population(
    plant: GrayBoxPlant,
    networks: dict[str, Network],
    centers: dict[str, float],
    laws: dict[str, Law],
) -> GrayBoxPlant:
    """A unit of the fleet before its own logs are seen: `plant` with the fleet's `networks`, which
    are known, and constants at the fleet's `centers`, as uncertain as its `laws` say, or as they
    are without one."""
    spec = plant.spec

    def told(p: Parameter) -> Parameter:
        if p.name not in centers:
            return p
        there = replace(p, value=centers[p.name])
        spread = laws[p.name].spread if p.name in laws else prior_width(there)
        return replace(there, spread=spread)

    spec = replace(
        spec,
        parameters=tuple(told(p) for p in spec.parameters),
        networks=tuple(replace(n, known=True) for n in spec.networks),
    )
    unit = GrayBoxPlant.untrained(spec)
    return eqx.tree_at(lambda p: p.networks, unit, networks)
