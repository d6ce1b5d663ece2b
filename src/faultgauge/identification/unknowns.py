"""The unknowns of a plant as one vector, scaled so that each is of order one.

    weights      theta                            prior N(0, 1)
    positive     p = p_0 exp(s theta)             where the file bounds p below by 0 or more
    others       p = p_0 + s theta

Priors are weak: a factor of 10 for positive constants, ten times the stated value for others; but
those of a fleet's unit are what the fleet says (`population`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant
from faultgauge.plants.spec import Parameter

__all__ = ["WEIGHTS", "Unknowns", "prior_width", "unknown_constants", "unknowns_of"]


WEIGHTS = ("weights_out", "weights_in", "bias", "bias_out")
FACTOR = math.log(10.0)  # one prior standard deviation of a positive constant
WIDE = 10.0  # and of any other, in stated values


@dataclass(frozen=True)
class Unknowns:
    """Which networks and parameters are unknown; `centers` and `scales` are p_0 and s above."""

    networks: tuple[str, ...]
    parameters: tuple[str, ...]
    positive: tuple[bool, ...]
    centers: tuple[float, ...]
    scales: tuple[float, ...]
    varying: tuple[int, ...] = ()  # of the parameters: those with a value per run
    slow: tuple[int, ...] = ()  # of these: those that also drift within it

    def vector(self, plant: GrayBoxPlant) -> Float[np.ndarray, "unknowns"]:
        """theta of `plant`."""
        parts = [
            np.asarray(getattr(plant.networks[name], field)).ravel()
            for name in self.networks
            for field in WEIGHTS
        ]
        values = np.array([float(plant.parameters[name]) for name in self.parameters])
        return np.concatenate([*parts, self.to_theta(values)])

    def to_theta(self, values: Float[np.ndarray, "parameters"]) -> Float[np.ndarray, "parameters"]:
        positive = np.array(self.positive, bool)
        centers, scales = np.array(self.centers), np.array(self.scales)
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithm = np.log(np.maximum(values, 1e-300) / centers)
        return np.where(positive, logarithm, values - centers) / scales

    def assemble(self, plant: Any, theta: Float[Array, "unknowns"]) -> Any:
        """`plant` with the unknowns from `theta`."""
        return self.put(plant, self.natural(plant, theta))

    def natural(self, plant: Any, theta: Float[Array, "unknowns"]) -> list[Array]:
        """The arrays and constants of the plant that `theta` stands for, in its order."""
        arrays, start = [], 0
        for name in self.networks:
            for field in WEIGHTS:
                old = getattr(plant.networks[name], field)
                arrays.append(theta[start : start + old.size].reshape(old.shape))
                start += old.size
        return arrays + [self.parameter(k, theta[start + k]) for k in range(len(self.parameters))]

    def parameter(
        self, k: int, theta: Float[Array | np.ndarray, "*points"]
    ) -> Float[Array, "*points"]:
        """The k-th parameter, in its unit, where its element of the vector is `theta`."""
        change, center = self.scales[k] * jnp.asarray(theta), self.centers[k]
        return center * jnp.exp(change) if self.positive[k] else center + change

    def put(self, plant: Any, natural: Sequence[Array]) -> Any:
        """`plant` with those arrays and constants."""
        left = list(natural)
        for name in self.networks:
            fields, left = left[: len(WEIGHTS)], left[len(WEIGHTS) :]
            plant = eqx.tree_at(
                lambda p, n=name: [getattr(p.networks[n], field) for field in WEIGHTS],
                plant,
                fields,
            )
        return plant.with_constants(dict(zip(self.parameters, left, strict=True)))

    def slopes(
        self, plant: GrayBoxPlant, theta: Float[Array, "unknowns"]
    ) -> Float[Array, "unknowns"]:
        """d natural / d theta, element by element."""
        first = self.weights(plant)
        scales, centers = jnp.array(self.scales, float), jnp.array(self.centers, float)
        grown = scales * centers * jnp.exp(scales * theta[first:])
        return jnp.concatenate(
            [jnp.ones(first), jnp.where(jnp.array(self.positive, bool), grown, scales)]
        )

    def weights(self, plant: Any) -> int:
        """How many of the unknowns are weights of networks; they come first."""
        return sum(getattr(plant.networks[n], f).size for n in self.networks for f in WEIGHTS)

    def bounds(
        self, plant: Plant
    ) -> tuple[Float[np.ndarray, "unknowns"], Float[np.ndarray, "unknowns"]]:
        """(lower, upper) of theta by the parameters' min and max."""
        free = np.full(self.weights(plant), np.inf)
        specs = {p.name: p for p in plant.constants}
        ends = []
        for key in ("min", "max"):
            values = np.array([getattr(specs[name], key) for name in self.parameters], float)
            theta = self.to_theta(values)
            outside = np.array(self.positive, bool) & (values <= 0)
            ends.append(np.where(outside, -np.inf, theta))
        return np.concatenate([-free, ends[0]]), np.concatenate([free, ends[1]])


def unknowns_of(plant: GrayBoxPlant) -> Unknowns:
    """All that is unknown in `plant`."""
    networks = tuple(n.name for n in plant.spec.networks if not n.known)
    return replace(unknown_constants(plant), networks=networks)


def unknown_constants(plant: Plant) -> Unknowns:
    """Of what is unknown in `plant`, the constants alone."""
    free = [p for p in plant.constants if not p.fixed]
    centers = [float(p.value) for p in free]
    return Unknowns(
        networks=(),
        parameters=tuple(p.name for p in free),
        positive=tuple(p.positive for p in free),
        centers=tuple(centers),
        scales=tuple(prior_width(p) for p in free),
        varying=tuple(k for k, p in enumerate(free) if p.vary),
        slow=tuple(k for k, p in enumerate(free) if p.vary == "slow"),
    )


def prior_width(parameter: Parameter) -> float:
    """One standard deviation of the prior, of the logarithm where the parameter is positive."""
    if parameter.spread is not None:
        return parameter.spread
    if parameter.positive:
        return FACTOR
    if math.isfinite(parameter.min) and math.isfinite(parameter.max):
        return (parameter.max - parameter.min) / 2
    return WIDE * abs(parameter.value) or 1.0
