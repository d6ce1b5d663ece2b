"""Whether the arguments of a network came together in training, and not only each in its range.

Known physics extrapolates, a network does not: of two or more arguments it knows the combinations
that it was trained on. A call's arguments, each in units of its range over the training points, are
covered where one training point lies within `reach` in all of them at once,

    min_k max_i |a_i - a_ki| / range_i <= reach

`reach` is the margin of a single range, or, where training itself is sparser, the distance that it
leaves: the 99 % quantile of that from its points to those of the rest, a tenth of the log left out
at a time, since samples that follow each other say nothing of one another.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from faultgauge.detection.rows.judged import operating_points
from faultgauge.observers.follow import follow
from faultgauge.plants.expression import Node, evaluate, networks_used
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.units import text

__all__ = ["MARGIN", "Region", "regions_of"]

MARGIN = 0.1  # of the training envelope's range, beyond which a model is not trusted
STRETCHES = 10  # of the log, each left out in turn
USUAL = 0.99  # of the training points lie within `reach` of the other stretches


class Arguments(eqx.Module):
    """The arguments of a network's `calls`, a sample at a time."""

    plant: GrayBoxPlant
    calls: tuple[tuple[Node, ...], ...] = eqx.field(static=True)

    def step(
        self,
        state: None,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        driven: Float[Array, "states"],
    ) -> tuple[None, Float[Array, "calls arguments"]]:
        """`driven` is what a fault adds to the states' derivatives."""
        plant = self.plant
        rates = plant.moved(x, u, driven)
        d = dict(zip(plant.signals.state_names, rates, strict=True))
        values: Any = plant.point(x, u)
        rows = [
            [evaluate(n, values, jnp, derivatives=d, networks=plant.networks) for n in call]
            for call in self.calls
        ]
        return None, jnp.stack([jnp.stack([jnp.asarray(a, float) for a in row]) for row in rows])


class Region(eqx.Module):
    """What training covered of the arguments of the network `name`, as the plant file calls it:
    its `points`, in units of `scale`, and what lies within `reach` of one of them."""

    name: str = eqx.field(static=True)
    arguments: Arguments
    scale: Float[np.ndarray, "arguments"]
    points: Float[np.ndarray, "points arguments"]
    reach: Float[np.ndarray, ""]

    @property
    def covered(self) -> str:
        """What training covered, in words: the network with the range of every argument."""
        points = self.points * self.scale
        ends = list(zip(points.min(axis=0), points.max(axis=0), strict=True))
        ranges = dict.fromkeys(
            f"{text(argument)} from {low:.3g} to {high:.3g}"
            for call in self.arguments.calls
            for argument, (low, high) in zip(call, ends, strict=True)
        )
        return f"{self.name}: {' with '.join(ranges)}"

    def holds(
        self,
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
        driven: Float[Array, "states"],
    ) -> Bool[Array, ""]:
        """Whether the arguments of every call are covered."""
        found = self.arguments.step(None, x, u, driven)[1] / self.scale
        apart = jnp.max(jnp.abs(found[:, None] - self.points), axis=2)
        return jnp.all(jnp.min(apart, axis=1) <= self.reach)  # NaN is not


def regions_of(model: Model, outputs: Sequence[str]) -> tuple[Region, ...]:
    """A region for every network that a derivative or one of `outputs` calls."""
    spec, points = model.plant.spec, operating_points(model)
    values = zip(model.plant.signals.output_names, spec.values, strict=True)
    calls: dict[str, dict[tuple[Node, ...], None]] = {}
    for each in (*spec.derivatives, *(value for name, value in values if name in outputs)):
        for network, found in networks_used(each).items():
            calls.setdefault(network, {}).update(dict.fromkeys(found))
    return tuple(
        _region(network, Arguments(model.plant, tuple(each)), points.x, points.u)
        for network, each in calls.items()
    )


def _region(
    network: str,
    arguments: Arguments,
    x: Float[np.ndarray, "points states"],
    u: Float[np.ndarray, "points inputs"],
) -> Region:
    found = follow(arguments, None, (x, u, np.zeros_like(x)))[1]
    found = found[np.isfinite(found).all(axis=(1, 2))]
    width = np.ptp(found, axis=(0, 1))
    scale = np.where(width > 0, width, 1.0)
    scaled = found / scale
    reach = max(MARGIN, _left_open(scaled))
    name = " and ".join(f"{network}({', '.join(map(text, call))})" for call in arguments.calls)
    return Region(name, arguments, scale, np.concatenate(scaled), np.asarray(reach))


def _left_open(points: Float[np.ndarray, "points calls arguments"]) -> float:
    """The distance within which the rest of the log has a point, for nearly all of every
    stretch."""
    from scipy.spatial import KDTree  # a third of a second to load, and only networks need it

    parts = np.array_split(points, STRETCHES)
    nearest = []
    for k, part in enumerate(parts):
        rest = np.concatenate([each for j, each in enumerate(parts) if j != k])
        if len(part) and len(rest):
            nearest.append(KDTree(np.concatenate(rest)).query(np.concatenate(part), p=np.inf)[0])
    return float(np.quantile(np.concatenate(nearest), USUAL)) if nearest else 0.0
