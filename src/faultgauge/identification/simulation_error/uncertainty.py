"""What the data say about the unknowns: standard errors, what stands for what, what is not seen.

With J the sensitivities of the weighted outputs over all windows, starts included, and P the prior,

    cov(theta) = s^2 tau (J J' + sigma^2 P + C C')^-1,

C what networks leave to the physics (see `claims`), s^2 the mean square residual. Residuals of a
simulation are not white: tau, their integrated autocorrelation time, is the number of samples that
count as one. Beside that stands how far the parameters are off where the plant is not its model
(`model_error`).
"""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.constants import ConstantsInformation, constants, imitated
from faultgauge.identification.model_error import (
    MOST_ALONG,
    BandScatter,
    InOrder,
    agreed,
    band_scatter,
)
from faultgauge.identification.optimise.normal_equations import bordered_equations
from faultgauge.identification.simulation_error.claims import Claims
from faultgauge.identification.simulation_error.constancy import drops, steps
from faultgauge.identification.simulation_error.window_fit import (
    Fitted,
    Ridge,
    SimulationResidual,
    WindowBatch,
    beside_of,
    simulated,
)
from faultgauge.identification.unknowns import Unknowns
from faultgauge.identification.validation.correlation import correlation, integrated_time
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.programs import program

__all__ = ["ConstantsInformation", "Curvature", "curvature", "information", "residual_time"]

WATCHED = (
    2000  # values of all parameters in all parts: the information on them is as large, squared
)
ALONE = 1e-6  # of what a parameter does: less beside a window's own unknowns is rounding
UNSEEN = 1e-10  # of the information on a state that stands alone


class Curvature(NamedTuple):
    """H = J J' over all windows, starts included; that with the priors and what networks leave to
    the physics; half the slope of the cost, with both; r' r; tau, samples."""

    hessian: Float[np.ndarray, "n n"]
    precision: Float[np.ndarray, "n n"]
    gradient: Float[np.ndarray, "n"]
    squares: float
    residual_time: float


def curvature(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    fitted: Fitted,
    windows: WindowBatch,
    substeps: int,
    ridge: Ridge,
    claims: Claims | None = None,
    weight: float = 1.0,
) -> Curvature:
    """The curvature of the cost at a fit over `windows`, its networks' prior being `ridge` and the
    `weight` that of the parameters'."""
    silent = SimulationResidual(plant, jnp.asarray(0.0), unknowns, substeps)
    local = silent.local(windows)
    theta = jnp.concatenate([jnp.asarray(fitted.theta), jnp.asarray(fitted.z).ravel()])
    found = _normal_equations(silent, theta, jax.tree.map(jnp.asarray, windows), local)
    hessian = np.asarray(found[1])
    prior = np.ones(len(hessian))
    prior[: fitted.theta.size] = weight
    prior[: unknowns.weights(plant)] = ridge
    s2 = max(fitted.mse, 1e-300)
    precision = hessian + np.diag(s2 * prior)
    gradient = np.asarray(found[2]) + s2 * prior * np.asarray(theta)
    if claims is not None:
        beside = beside_of(plant, claims, unknowns, windows, float(np.sqrt(s2)))
        rows = np.asarray(jax.jacrev(beside)(theta))
        precision += rows.T @ rows
        gradient += rows.T @ np.asarray(beside(theta))
    tau = residual_time(plant, unknowns, fitted, windows, substeps)
    return Curvature(hessian, precision, gradient, float(found[0]), tau)


def information(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    fitted: Fitted,
    windows: WindowBatch,
    substeps: int,
    ridge: Ridge,
    claims: Claims | None = None,
    parts: int = 1,
    weight: float = 1.0,
) -> ConstantsInformation:
    """Standard errors and warnings at a fit over `windows`, its networks' prior being `ridge` and
    what they leave to the physics `claims`. Unless some drift, parameters are looked at for being
    constant from part to part of the windows, of which each has so many `parts`; but not where that
    is too much to look at (`WATCHED`). `weight` is that of the parameters' prior."""
    size, weights, count = fitted.theta.size, unknowns.weights(plant), len(unknowns.parameters)
    watched = count * parts
    off = _model_error(plant, unknowns, fitted, windows, substeps)
    if unknowns.slow or watched * len(fitted.z) > WATCHED:
        watched = 0
    if watched:
        unknowns, fitted, windows = _with_steps(unknowns, fitted, windows, parts)
    found = curvature(plant, unknowns, fitted, windows, substeps, ridge, claims, weight)
    local = fitted.z.shape[1]
    own = size + np.arange(len(fitted.z))[:, None] * local + np.arange(local - watched, local)
    inner = np.setdiff1d(np.arange(len(found.hessian)), own)
    hessian, s2 = found.hessian[np.ix_(inner, inner)], max(fitted.mse, 1e-300)
    inverse = np.linalg.pinv(found.precision[np.ix_(inner, inner)], hermitian=True)
    covariance = s2 * found.residual_time * inverse[weights:size, weights:size]
    told = constants(
        plant, unknowns, fitted.theta, covariance, imitated(plant, unknowns, hessian), off
    )
    unseen = _unseen(plant, hessian, size, windows)
    changing: dict[str, float] = {}
    if watched:
        columns = [own[:, k::count].ravel() for k in range(count)]
        dropped = drops(found.hessian, inverse, found.gradient, inner, columns)
        shares = dropped / max(found.squares, 1e-300)
        changing = dict(zip(unknowns.parameters, shares.tolist(), strict=True))
    known = *told, unseen, found.residual_time
    return ConstantsInformation(*known, claims is not None, refined=True, changing=changing)


def _model_error(
    plant: GrayBoxPlant, unknowns: Unknowns, fitted: Fitted, windows: WindowBatch, substeps: int
) -> BandScatter:
    """How far slow and fast motion of the windows ask for other parameters, beyond what their
    starts explain. Networks make up for what is missing: there is nothing to find beside them."""
    samples, outputs = windows.y.shape[1:]
    if unknowns.networks or len(fitted.z) * samples > MOST_ALONG:
        return agreed(len(unknowns.parameters))
    residual = SimulationResidual(plant, jnp.asarray(0.0), unknowns, substeps)
    parts = []
    for k, z in enumerate(fitted.z):
        window = jax.tree.map(lambda each, k=k: jnp.asarray(each[k]), windows)
        r, J = _one(residual, jnp.asarray(np.concatenate([fitted.theta, z])), window)
        r, J = np.asarray(r)[: samples * outputs], np.asarray(J)[: samples * outputs]
        shared, own = np.split(J, [fitted.theta.size], axis=1)
        rest = shared - own @ np.linalg.lstsq(own, shared, rcond=None)[0]
        told = np.linalg.norm(rest, axis=0) > ALONE * np.linalg.norm(shared, axis=0)
        r, J = r.reshape(samples, outputs), (rest * told).reshape(samples, outputs, -1)
        steps = np.asarray(windows.dt[k])
        if np.any(steps > 0):  # behind the end of a short log there are none
            parts.append(InOrder(r, J, J[..., :0], float(np.median(steps[steps > 0]))))
    return band_scatter(parts)


@program
def _one(residual: SimulationResidual, own: Array, window: WindowBatch) -> tuple[Array, Array]:
    return residual.linearised(own, window)


def _with_steps(
    unknowns: Unknowns, fitted: Fitted, windows: WindowBatch, parts: int
) -> tuple[Unknowns, Fitted, WindowBatch]:
    """The same with values of their own for all parameters in every part of a window, all 0 yet."""
    count = len(unknowns.parameters)
    walk = steps(windows.dt.shape[1], parts, count)
    walk = np.broadcast_to(walk, (len(fitted.z), *walk.shape))
    z = np.pad(fitted.z, ((0, 0), (0, parts * count)))
    return (
        replace(unknowns, slow=tuple(range(count))),
        fitted._replace(z=z),
        eqx.tree_at(lambda each: each.walk, windows, walk),
    )


@program
def _normal_equations(
    residual: SimulationResidual, theta: Array, windows: WindowBatch, local: int
) -> tuple[Array, Array, Array]:
    return bordered_equations(residual.linearised, theta, windows, local)[:3]


def residual_time(
    plant: GrayBoxPlant, unknowns: Unknowns, fitted: Fitted, windows: WindowBatch, substeps: int
) -> float:
    """The longest integrated autocorrelation time over the outputs, samples."""
    errors = simulated(plant, unknowns, fitted.theta, fitted.z, windows, substeps)[1]
    times = [1.0]
    for j in range(errors.shape[-1]):
        parts = [e[w > 0] for e, w in zip(errors[..., j], windows.weight[..., j], strict=True)]
        parts = [part for part in parts if len(part) > 20]
        if parts:
            rho = correlation(parts, parts)
            if rho is not None:
                times.append(integrated_time(rho[len(rho) // 2 :]))
    return float(max(times))


def _factor(share: float) -> str:
    return f"{share:+.2g} ".removesuffix("1 ") if abs(share) == 1 else f"{share:+.2g} "


def _unseen(
    plant: GrayBoxPlant, hessian: Float[np.ndarray, "n n"], shared: int, windows: WindowBatch
) -> tuple[str, ...]:
    """Combinations of states that change no output, whatever the window."""
    count, states = windows.center.shape
    local = (len(hessian) - shared) // count
    total = np.zeros((states, states))
    for k in range(count):
        start = shared + k * local
        total += hessian[start : start + states, start : start + states]
    if not np.all(np.isfinite(total)) or np.trace(total) <= 0:
        return ()
    size = np.sqrt(np.diag(total))
    size = np.where(size > 0, size, np.inf)  # a state that changes nothing: a zero row stays zero
    values, vectors = np.linalg.eigh(total / np.outer(size, size))
    reach = np.mean(np.asarray(windows.sd), axis=0) / np.where(np.isfinite(size), size, 1.0)
    names = plant.signals.state_names
    directions = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value > UNSEEN:
            continue
        parts = vector * reach
        parts = parts / parts[np.argmax(np.abs(parts))]
        terms = [f"{_factor(p)}{n}" for p, n in zip(parts, names, strict=True) if abs(p) > 0.01]
        directions.append(" ".join(terms).removeprefix("+"))
    return tuple(directions)
