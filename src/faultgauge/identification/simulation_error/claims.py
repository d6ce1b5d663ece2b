"""What belongs to the physics: networks leave alone what its parameters can do.

A network that can imitate a parameter shares the parameter's part with it in any way, and beyond
the training range, where it keeps its edge value, its share is missing. With H the information of
the outputs on the parameters p and on the output weights w of many fixed features, starts
eliminated, the canonical directions of both (H. Hotelling, "Relations between two sets of
variates", Biometrika 28, 1936),

    M a = cos^2 a,   M = L^-1 H_pw H_ww^-1 H_wp L^-T,   H_pp = L L',

say which combinations of parameters (cos^2 near 1) a function of the networks' arguments imitates:
the one with weights b = H_ww^-1 H_wp L^-T a. Q is an orthonormal basis of what these functions add
to the plant's equations (F, h), at points along the fitted runs, and n what the networks add:

    rows = Q' n / sqrt(points)

are kept at 0, which costs the fit nothing: the parameters carry all that they can. After B. M.
Gyorok et al., "Orthogonal projection-based regularization for efficient model augmentation", L4DC
2025, where networks leave alone all that parameters do, be it something that they can imitate or
not; an unknown that goes along with the physics is then lost.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.optimise.normal_equations import bordered_equations
from faultgauge.identification.optimise.starts import nguyen_widrow
from faultgauge.identification.simulation_error.window_fit import SimulationResidual, WindowBatch
from faultgauge.identification.unknowns import Unknowns, unknowns_of
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.network import Network
from faultgauge.plants.plant import respond
from faultgauge.plants.shape import Shape
from faultgauge.programs import program

__all__ = ["Claims", "claims_of", "imitating"]

FEATURES = 25  # of every network, at random
POINTS = 500  # of training, spread, at which networks are compared
IMITATED = 0.99  # cos^2
AT_BOUND = 1e-3  # prior standard deviations
DISTINCT = 1e-9  # of the largest eigenvalue: parameters that the data do not tell apart


class Claims(eqx.Module):
    """Points, the equations' half ranges, and Q, as many columns as there are parameters."""

    x: Float[np.ndarray | Array, "points states"]
    u: Float[np.ndarray | Array, "points inputs"]
    scale: Float[np.ndarray | Array, "equations"]
    basis: Float[np.ndarray | Array, "values parameters"]

    def __call__(self, plant: GrayBoxPlant) -> Float[Array, "parameters"]:
        """Q' n / sqrt(points): shares of the equations' half ranges, RMS."""
        x, u = jnp.asarray(self.x), jnp.asarray(self.u)
        added = (_equations(plant, x, u) - _equations(_silent(plant), x, u)) / self.scale
        return jnp.asarray(self.basis).T @ added.ravel() / np.sqrt(len(x))


def claims_of(
    plant: GrayBoxPlant,
    theta: Float[np.ndarray, "parameters"],
    z: Float[np.ndarray, "windows local"],
    windows: WindowBatch,
    substeps: int,
    sigma: float,
    points: tuple[Float[np.ndarray, "samples states"], Float[np.ndarray, "samples inputs"]],
    rng: np.random.Generator,
) -> Claims:
    """Claims of `plant`'s free parameters `theta`, fitted over `windows` with silent networks that
    have their scalings; `sigma` is that fit's error."""
    wide = _with_features(plant, rng)
    unknowns = unknowns_of(wide)
    weights = unknowns.weights(wide)
    values = np.concatenate([unknowns.vector(wide)[:weights], theta])
    hessian = _information(wide, unknowns, values, z, windows, substeps, sigma)
    lower, upper = (ends[weights:] for ends in unknowns.bounds(wide))
    free = (theta - lower > AT_BOUND) & (upper - theta > AT_BOUND)  # others can carry no more
    told = [k for k in range(len(theta)) if free[k] and k not in unknowns.varying]
    directions = imitating(hessian, weights, [weights + k for k in told])
    kept = np.linspace(0, len(points[0]) - 1, min(POINTS, len(points[0]))).astype(int)
    x, u = points[0][kept], points[1][kept]
    half = np.ptp(np.asarray(_equations(wide, jnp.asarray(x), jnp.asarray(u))), axis=0) / 2
    scale = np.where(half > 0, half, 1.0)

    def equations(values: Array) -> Array:
        return _equations(unknowns.assemble(wide, values), jnp.asarray(x), jnp.asarray(u)) / scale

    def added(direction: Array) -> Array:
        return jax.jvp(equations, (jnp.asarray(values),), (direction,))[1].ravel()

    basis = np.zeros((scale.size * len(x), len(theta)))
    if directions.shape[1]:
        q, _ = np.linalg.qr(np.asarray(jax.vmap(added)(jnp.asarray(directions.T))).T)
        basis[:, : q.shape[1]] = q
    return Claims(x, u, scale, basis)


def imitating(
    hessian: Float[np.ndarray, "n n"], weights: int, told: list[int]
) -> Float[np.ndarray, "n directions"]:
    """Changes of the first `weights` unknowns that do what combinations of those `told` do, by the
    `hessian` of the outputs."""
    seen = [k for k in range(weights) if hessian[k, k] > 0]
    told = [k for k in told if hessian[k, k] > 0]
    found = np.zeros((len(hessian), 0))
    if not seen or not told or not np.all(np.isfinite(hessian)):
        return found
    size = np.sqrt(np.where(np.diag(hessian) > 0, np.diag(hessian), 1.0))
    scaled = hessian / np.outer(size, size)
    values, vectors = np.linalg.eigh(scaled[np.ix_(told, told)])
    clear = values > DISTINCT * values[-1]
    whitened = vectors[:, clear] / np.sqrt(values[clear])
    own = scaled[np.ix_(seen, seen)] + DISTINCT * len(seen) * np.eye(len(seen))
    cross = scaled[np.ix_(seen, told)] @ whitened
    imitation = np.linalg.lstsq(own, cross)[0]
    cosines, along = np.linalg.eigh(cross.T @ imitation)
    alike = along[:, cosines > IMITATED]
    found = np.zeros((len(hessian), alike.shape[1]))
    found[seen] = imitation @ alike / size[seen, None]
    return found


def _information(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    values: Float[np.ndarray, "unknowns"],
    z: Float[np.ndarray, "windows local"],
    windows: WindowBatch,
    substeps: int,
    sigma: float,
) -> Float[np.ndarray, "unknowns unknowns"]:
    """H over the shared unknowns, what is local to the windows eliminated."""
    residual = SimulationResidual(plant, jnp.asarray(sigma), unknowns, substeps)
    theta = jnp.concatenate([jnp.asarray(values), jnp.asarray(z).ravel()])
    local = residual.local(windows)
    whole = np.asarray(_hessian(residual, theta, jax.tree.map(jnp.asarray, windows), local))
    n = len(values)
    if not np.all(np.isfinite(whole)):  # a simulation that does not hold tells nothing
        return np.zeros((n, n))
    border = whole[:n, n:]
    return whole[:n, :n] - border @ np.linalg.pinv(whole[n:, n:], hermitian=True) @ border.T


@program
def _hessian(residual: SimulationResidual, theta: Array, windows: WindowBatch, local: int) -> Array:
    return bordered_equations(residual.linearised, theta, windows, local)[1]


def _with_features(plant: GrayBoxPlant, rng: np.random.Generator) -> GrayBoxPlant:
    """Silent networks of many units, of what shape matters to what they can imitate."""
    networks = {}
    for name, old in plant.networks.items():
        shape = Shape(odd=old.shape.odd, zero_at_zero=old.shape.zero_at_zero)
        start = nguyen_widrow(FEATURES, old.input_center.size, rng, shape)
        silent = _silent_network(old)
        networks[name] = Network(
            weights_out=jnp.zeros(FEATURES),
            weights_in=jnp.asarray(start["weights_in"]),
            bias=jnp.asarray(start["bias"]),
            bias_out=jnp.zeros(()),
            input_center=old.input_center,
            input_scale=old.input_scale,
            output_center=silent(*old.input_center),
            output_scale=old.output_scale,
            shape=shape,
        )
    return eqx.tree_at(lambda p: p.networks, plant, networks)


def _silent(plant: GrayBoxPlant) -> GrayBoxPlant:
    networks = {name: _silent_network(network) for name, network in plant.networks.items()}
    return eqx.tree_at(lambda p: p.networks, plant, networks)


def _silent_network(network: Network) -> Network:
    nothing = jnp.zeros_like(network.weights_out), jnp.zeros_like(network.bias_out)
    return eqx.tree_at(lambda net: (net.weights_out, net.bias_out), network, nothing)


def _equations(
    plant: GrayBoxPlant, x: Float[Array, "points states"], u: Float[Array, "points inputs"]
) -> Float[Array, "points equations"]:
    dx, y = jax.vmap(lambda x, u: respond(plant, x, u))(x, u)
    return jnp.concatenate([dx, y], axis=1)
