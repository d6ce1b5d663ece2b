"""What the data say about the unknowns: standard errors, what stands for what, what is not seen.

With J the sensitivities of the weighted outputs over all windows, starts included, and P the prior,

    cov(theta) = s^2 tau (J J' + sigma^2 P + C C')^-1,

C what networks leave to the physics (see `claims`), s^2 the mean square residual. Residuals of a
simulation are not white: tau, their integrated autocorrelation time, is the number of samples that
count as one.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.normal_equations import bordered_equations
from faultgauge.identification.refinement.claims import Claims
from faultgauge.identification.refinement.simulation_error import (
    Fitted,
    Ridge,
    SimulationResidual,
    Window,
    beside_of,
    simulated,
)
from faultgauge.identification.refinement.unknowns import WEIGHTS, Unknowns
from faultgauge.identification.validation.correlation import correlation, integrated_time
from faultgauge.plants.gray_box import GrayBoxPlant

__all__ = ["Constant", "Curvature", "Information", "curvature", "information"]

IMITATED = 0.99  # of what a parameter does to the outputs, a network's weights can do too
ALIKE = 0.99  # correlation at which two parameters cannot be told apart
VAGUE = 0.1
UNSEEN = 1e-10  # of the information on a state that stands alone
NEAR = 1e-3  # of the range: a parameter this near to a bound is at it


@dataclass(frozen=True)
class Constant:
    """A fitted parameter: value, standard error and unit; `bound` names the bound it is at,
    `imitated_by` the network that can do what it does."""

    name: str
    unit: str
    value: float
    standard_error: float | None
    bound: str | None
    imitated_by: str | None

    @property
    def vague(self) -> bool:
        """Whether its standard error is more than a tenth of it."""
        return self.standard_error is not None and self.standard_error > VAGUE * abs(self.value)


@dataclass(frozen=True)
class Information:
    """Constants, their correlations, and combinations of states that no output shows; whether
    networks were kept from what they could imitate."""

    constants: tuple[Constant, ...]
    correlation: Float[np.ndarray, "constants constants"]
    unseen: tuple[str, ...]
    residual_time: float
    kept_apart: bool = False

    def warnings(self) -> list[str]:
        """What somebody who reads the numbers should know, a sentence each."""
        found = []
        for each in self.constants:
            if each.bound:
                found.append(
                    f"parameter {each.name!r} is at its {each.bound}; its value is the file's "
                    "bound, not the data's"
                )
            if each.imitated_by:
                kept = ", though it is kept from doing so" if self.kept_apart else ""
                found.append(
                    f"parameter {each.name!r} is not identifiable: network {each.imitated_by!r} "
                    f"can imitate it{kept}; fix it, or leave its part to the network"
                )
        for i, a in enumerate(self.constants):
            for j, b in enumerate(self.constants[:i]):
                if abs(self.correlation[i, j]) > ALIKE and a.vague and b.vague:
                    found.append(
                        f"parameters {b.name!r} and {a.name!r} cannot be told apart by these "
                        f"logs (correlation {self.correlation[i, j]:+.3f}); fix one of them"
                    )
        for direction in self.unseen:
            found.append(
                f"the outputs do not show {direction}: no log can tell where it starts; measure "
                "one of these states, or leave it out"
            )
        return found

    def to_dict(self) -> dict[str, Any]:
        rows = [vars(each) for each in self.constants]
        return {
            "parameters": rows,
            "correlation": np.round(self.correlation, 6).tolist(),
            "unseen": list(self.unseen),
            "residual_time_samples": self.residual_time,
        }


class Curvature(NamedTuple):
    """H = J J' over all windows, starts included; that with the priors and what networks leave to
    the physics; tau, samples."""

    hessian: Float[np.ndarray, "n n"]
    precision: Float[np.ndarray, "n n"]
    residual_time: float


def curvature(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    fitted: Fitted,
    windows: Window,
    substeps: int,
    ridge: Ridge,
    claims: Claims | None = None,
) -> Curvature:
    """The curvature of the cost at a fit over `windows`, its networks' prior being `ridge`."""
    silent = SimulationResidual(plant, jnp.asarray(0.0), unknowns, substeps)
    local = silent.local(windows)
    theta = jnp.concatenate([jnp.asarray(fitted.theta), jnp.asarray(fitted.z).ravel()])
    found = _normal_equations(silent, theta, jax.tree.map(jnp.asarray, windows), local)
    hessian = np.asarray(found[1])
    prior = np.ones(len(hessian))
    prior[: unknowns.weights(plant)] = ridge
    s2 = max(fitted.mse, 1e-300)
    precision = hessian + np.diag(s2 * prior)
    if claims is not None:
        beside = beside_of(plant, claims, unknowns, windows, float(np.sqrt(s2)))
        rows = np.asarray(jax.jacrev(beside)(theta))
        precision += rows.T @ rows
    return Curvature(hessian, precision, _residual_time(plant, unknowns, fitted, windows, substeps))


def information(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    fitted: Fitted,
    windows: Window,
    substeps: int,
    ridge: Ridge,
    claims: Claims | None = None,
) -> Information:
    """Standard errors and warnings at a fit over `windows`, its networks' prior being `ridge` and
    what they leave to the physics `claims`."""
    hessian, precision, tau = curvature(plant, unknowns, fitted, windows, substeps, ridge, claims)
    size, weights = fitted.theta.size, unknowns.weights(plant)
    s2 = max(fitted.mse, 1e-300)
    covariance = s2 * tau * np.linalg.pinv(precision, hermitian=True)
    covariance = covariance[weights:size, weights:size]
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlations = np.where(np.outer(sd, sd) > 0, covariance / np.outer(sd, sd), 0.0)
    np.fill_diagonal(correlations, 1.0)
    imitated = _imitated(plant, unknowns, hessian, s2)
    constants = tuple(
        _constant(plant, unknowns, fitted.theta[weights:], k, float(sd[k]), imitated[k])
        for k in range(len(unknowns.parameters))
    )
    unseen = _unseen(plant, hessian, size, windows)
    return Information(constants, correlations, unseen, tau, claims is not None)


@eqx.filter_jit
def _normal_equations(
    residual: SimulationResidual, theta: Array, windows: Window, local: int
) -> tuple[Array, Array, Array]:
    return bordered_equations(residual.linearised, theta, windows, local)[:3]


def _residual_time(
    plant: GrayBoxPlant, unknowns: Unknowns, fitted: Fitted, windows: Window, substeps: int
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


def _constant(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    theta: Float[np.ndarray, "parameters"],
    k: int,
    sd: float,
    imitated: str | None,
) -> Constant:
    name = unknowns.parameters[k]
    spec = next(p for p in plant.spec.parameters if p.name == name)
    center, scale = unknowns.centers[k], unknowns.scales[k]
    value = center * np.exp(scale * theta[k]) if unknowns.positive[k] else center + scale * theta[k]
    slope = abs(value) * scale if unknowns.positive[k] else scale
    width = spec.max - spec.min if np.isfinite(spec.max - spec.min) else abs(value)
    bound = None
    if value - spec.min <= NEAR * width:
        bound = f"min = {spec.min:g}"
    elif spec.max - value <= NEAR * width:
        bound = f"max = {spec.max:g}"
    error = float(slope * sd)
    return Constant(name, spec.unit, float(value), None if bound else error, bound, imitated)


def _imitated(
    plant: GrayBoxPlant, unknowns: Unknowns, hessian: Float[np.ndarray, "n n"], s2: float
) -> list[str | None]:
    """For every parameter the network whose weights span what it does to the outputs."""
    found: list[str | None] = []
    first = unknowns.weights(plant)
    spans, start = {}, 0
    for name in unknowns.networks:
        size = sum(getattr(plant.networks[name], f).size for f in WEIGHTS)
        spans[name] = slice(start, start + size)
        start += size
    for k in range(first, first + len(unknowns.parameters)):
        own = hessian[k, k]
        shares = {}
        for name, span in spans.items():
            block = hessian[span, span] + 1e-9 * np.trace(hessian[span, span]) * np.eye(
                span.stop - span.start
            )
            cross = hessian[span, k]
            if own > 0 and np.trace(block) > 0:
                shares[name] = float(cross @ np.linalg.solve(block, cross) / own)
        name = max(shares, key=lambda n: shares[n]) if shares else None
        found.append(name if name is not None and shares[name] > IMITATED else None)
    return found


def _factor(share: float) -> str:
    return f"{share:+.2g} ".removesuffix("1 ") if abs(share) == 1 else f"{share:+.2g} "


def _unseen(
    plant: GrayBoxPlant, hessian: Float[np.ndarray, "n n"], shared: int, windows: Window
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
