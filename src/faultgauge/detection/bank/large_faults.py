"""Sizes at which a fault does something else than a small one: a limit of torque that comes into
reach acts on more and more of the log.

What a fault of size p does to rates and outputs over the training envelope, h(p), each in units of
its own standard deviation there, points another way than h(q) by the angle

    cos(p, q) = <h(p), h(q)> / (|h(p)| |h(q)|),

and no multiple of the one explains 1 - cos^2 of the other. As few sizes as leave none of a grid
that is not like one of them are signatures of their own (greedily, the smallest first).
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from faultgauge.detection.rows.judged import operating_points
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.plant import Plant, respond
from faultgauge.programs import program

__all__ = ["LargeFaults", "large_faults"]

ALIKE = 0.9  # cosine from which on a multiple of what the one does passes for the other
GRID = 24  # sizes from the probe to the largest
MOST = 8  # sizes on each side of a fault


class LargeFaults(NamedTuple):
    """`faults` (numbers), each with a `size` at which it is linearised, too, which stands for all
    from `low` to `high`."""

    faults: tuple[int, ...]
    size: Float[np.ndarray, "large"]
    low: Float[np.ndarray, "large"]
    high: Float[np.ndarray, "large"]


def large_faults(
    model: Model,
    plant: GrayBoxPlant,
    size: Float[np.ndarray, "faults"],
    probe: Float[np.ndarray, "faults"],
    evaluated: Sequence[int],
) -> LargeFaults:
    """Of the `evaluated` faults of `plant`, whose widest standard deviations are `size`, and of
    which a small one is one of `probe`."""
    found: list[tuple[int, float, float, float]] = []
    x, u = map(jax.device_put, operating_points(model))
    for k in evaluated:
        fault = plant.signals.faults[k]
        for side, limit in ((-1.0, fault.min), (1.0, fault.max)):
            far = min(abs(limit), 2 * size[k]) if side * limit > 0 else 0.0
            if far <= probe[k]:
                continue
            grid = np.geomspace(probe[k], far, GRID)
            f = np.zeros((GRID, len(size)))
            f[:, k] = side * grid
            chosen = _chosen(_alike(np.asarray(_effects(plant, x, u, jnp.asarray(f)))))
            ends = [*(np.sqrt(grid[a] * grid[b]) for a, b in pairwise(chosen)), far]
            for at, between in zip(chosen[1:], pairwise(ends), strict=True):
                low, high = sorted(side * end for end in between)
                found.append((k, side * grid[at], low, high))
    faults = tuple(each[0] for each in found)
    return LargeFaults(faults, *np.array([each[1:] for each in found]).reshape(-1, 3).T)


@program
def _effects(
    plant: Plant, x: Array, u: Array, faults: Float[Array, "sizes faults"]
) -> Float[Array, "sizes effects"]:
    """h(p) of the docstring above, for every size."""

    def channels(f: Array, x: Array, u: Array) -> Array:
        return jnp.concatenate(respond(plant, x, u, f))

    over = jax.vmap(jax.vmap(channels, (None, 0, 0)), (0, None, None))
    healthy = over(jnp.zeros_like(faults[:1]), x, u)
    scale = jnp.maximum(jnp.nanstd(healthy, axis=1, keepdims=True), 1e-300)
    moved = (over(faults, x, u) - healthy) / scale
    return jnp.where(jnp.isfinite(moved), moved, 0.0).reshape(len(faults), -1)


def _alike(effects: Float[np.ndarray, "sizes effects"]) -> Bool[np.ndarray, "sizes sizes"]:
    """Which sizes do the same but for its size; one that does nothing is like every other."""
    largest = np.abs(effects).max(axis=1, keepdims=True)
    effects = effects / np.where(largest > 0, largest, 1.0)  # squares must not underflow
    length = np.linalg.norm(effects, axis=1)
    return effects @ effects.T >= ALIKE * np.outer(length, length)


def _chosen(alike: Bool[np.ndarray, "sizes sizes"]) -> list[int]:
    """The smallest size, and as few others as leave none that is not like one of them."""
    chosen = [0]
    while len(chosen) <= MOST:
        left = np.flatnonzero(~alike[chosen].any(axis=0))
        left = left[left > chosen[-1]]
        if not len(left):
            break
        chosen.append(int(np.flatnonzero(alike[left[0]]).max()))
    return chosen
