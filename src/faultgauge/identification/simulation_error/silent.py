"""Where networks beside the physics start: their scalings, and weights that say nothing yet."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.equation.groups import crowds, groups, scale_networks
from faultgauge.identification.optimise.starts import Box, spread_over
from faultgauge.identification.samples import Samples
from faultgauge.identification.simulation_error.candidate import Candidate
from faultgauge.identification.simulation_error.data import Data
from faultgauge.identification.simulation_error.records import Piece
from faultgauge.identification.unknowns import WEIGHTS
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import respond

__all__ = ["scaled", "silent", "visited"]

SCALE_POINTS = 500  # of training, spread, that set scalings
WHISPER = 0.3  # of a start's output weights where squares of them count: at 0 they have no slope


def scaled(
    data: Data, base: Candidate, pieces: Sequence[Piece]
) -> tuple[GrayBoxPlant, dict[str, Box]]:
    """The plant of `base`, its networks scaled by measured states, and where it takes hidden ones
    along the `pieces` that it was fitted to; and where their arguments crowd."""
    plant = base.assembled
    x, u = visited(data, base, pieces)
    y = np.concatenate([data.records[p.record].y[p.start : p.stop] for p in pieces])
    dx = np.asarray(jax.vmap(plant.derivative)(jnp.asarray(x), jnp.asarray(u)))
    samples = Samples(x, u, dx, np.nan_to_num(y))
    crowded: dict[str, Box] = {}
    for group in groups(plant.spec, plant.signals.output_names):
        plant = scale_networks(plant, group, samples)
        crowded |= crowds(plant, group, samples)
    return _outputs_scaled(plant, x, u), crowded


def visited(
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


def silent(
    plant: GrayBoxPlant,
    rng: np.random.Generator,
    margin: float,
    crowded: Mapping[str, Box] = MappingProxyType({}),
) -> GrayBoxPlant:
    """Networks that start at (about) zero, so that the physics is where the fit begins.

    `margin` widens their arguments' ranges; `crowded` says where units are to stand.
    """
    networks = {}
    for spec in plant.spec.networks:
        old = plant.networks[spec.name]
        wider = eqx.tree_at(lambda net: net.input_scale, old, margin * old.input_scale)
        start = spread_over(wider, rng, crowded.get(spec.name))
        start["weights_out"] = (WHISPER if spec.monotone else 0.0) * start["weights_out"]
        networks[spec.name] = eqx.tree_at(
            lambda net: [getattr(net, field) for field in WEIGHTS],
            wider,
            [jnp.asarray(start[field]) for field in WEIGHTS],
        )
    return eqx.tree_at(lambda p: p.networks, plant, networks)
