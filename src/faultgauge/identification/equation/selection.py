"""Selection by free run: a good derivative fit whose simulation drifts is not a good model."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.samples import Stretch
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.programs import program
from faultgauge.simulation.free_run import bucket, pad, simulate, substeps_for

__all__ = ["Windows", "free_run_errors", "windows_from"]

LONGEST = 4000  # samples of one validation window that are simulated


class Windows(eqx.Module):
    """Validation windows, padded to one length: start states, inputs, outputs, weights."""

    x0: Float[np.ndarray, "windows states"]
    u: Float[np.ndarray, "windows samples inputs"]
    dt: Float[np.ndarray, "windows samples"]
    y: Float[np.ndarray, "windows samples outputs"]
    weight: Float[np.ndarray, "windows samples outputs"]


def windows_from(
    stretches: Sequence[Stretch],
    cuts: Sequence[Sequence[slice]],
    spread: Float[np.ndarray, "outputs"],
    *,
    parabola: bool = False,
) -> Windows:
    """Windows for `free_run_errors`; `spread` is each output's standard deviation in the log.

    A window starts at the smoothed state of its first sample, with `parabola` where one through
    the measurements under the kernel passes; outputs without telemetry and padding have weight 0.
    """
    pieces = []
    for stretch, slices in zip(stretches, cuts, strict=True):
        for cut in slices:
            cut = slice(cut.start, min(cut.stop, cut.start + LONGEST))
            if cut.stop - cut.start >= 2:
                pieces.append((stretch, cut))
    length = bucket(max(cut.stop - cut.start for _, cut in pieces))
    fields: list[list[np.ndarray]] = [[], [], [], [], []]
    for stretch, cut in pieces:
        count = cut.stop - cut.start
        y = stretch.measured[cut]
        weight = np.isfinite(y) / spread**2
        dt = np.full(length, stretch.step)
        dt[count - 1 :] = 0.0
        padded = np.zeros((length - count, y.shape[1]))
        row = (
            _on_parabola(stretch, cut.start) if parabola else stretch.samples.x[cut.start],
            pad(stretch.applied[cut], length),
            dt,
            pad(np.nan_to_num(y), length),
            np.concatenate([weight, padded]),
        )
        for field, value in zip(fields, row, strict=True):
            field.append(value)
    return Windows(*(np.stack(field) for field in fields))


def _on_parabola(stretch: Stretch, k: int) -> Float[np.ndarray, "states"]:
    """The states of sample k, by least squares on the measurements under its kernel (A. Savitzky
    and M. J. E. Golay, Analytical Chemistry 36, 1964): no bend of x biases it, as it does a mean.
    States that no column holds stay smoothed."""
    smoothed = stretch.samples.x[k]
    if stretch.unsmoothed is None:
        return smoothed
    around = np.linspace(-1.0, 1.0, 2 * stretch.reach + 1)
    weights = np.linalg.pinv(np.vander(around, 3, increasing=True))[0]
    found = weights @ stretch.unsmoothed.x[k : k + len(around)]
    return np.where(np.isnan(found), smoothed, found)


@program
def _errors(
    leaves: tuple, plant: GrayBoxPlant, windows: Windows, substeps: int
) -> Float[Array, "candidates"]:
    def one(leaves: tuple) -> Array:
        candidate = eqx.tree_at(lambda p: (p.networks, p.parameters), plant, leaves)

        def window(x0: Array, u: Array, dt: Array, y: Array, weight: Array) -> Array:
            f = jnp.zeros((len(dt), len(plant.signals.faults)))
            error = simulate(candidate, x0, u, dt, f, substeps).y - y
            return jnp.sum(jnp.where(weight > 0, weight * error**2, 0.0))

        total = jnp.sum(jax.vmap(window)(*jax.tree.leaves(windows)))
        return jnp.sqrt(total / jnp.sum(jnp.asarray(windows.weight) > 0))

    return jax.vmap(one)(leaves)


def free_run_errors(
    candidates: Sequence[GrayBoxPlant], windows: Windows, max_step: float
) -> Float[np.ndarray, "candidates"]:
    """Normalised RMSE of each candidate's free run over the windows (inf where it diverges)."""
    leaves = jax.tree.map(
        lambda *arrays: jnp.asarray(np.stack([np.asarray(a) for a in arrays])),
        *[(c.networks, c.parameters) for c in candidates],
    )
    substeps = substeps_for(float(np.max(windows.dt)), max_step)
    errors = np.asarray(
        _errors(leaves, candidates[0], jax.tree.map(jnp.asarray, windows), substeps)
    )
    return np.where(np.isfinite(errors), errors, np.inf)
