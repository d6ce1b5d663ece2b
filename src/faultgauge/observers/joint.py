"""All faults of a plant at once: an extended Kalman filter for state and faults together.

    z = (x, f),   f a random walk,   x- = Phi(x, f, u, dt),   y = h(x, f, u) + noise

(B. Friedland, "Treatment of bias in recursive filtering", IEEE TAC 14, 1969; here undivided.)
The walk of each fault is set by one bandwidth omega_o: over an integrator with the fault's effect
b the filter has the poles of a Butterworth pair, as an ESO with zeta = 1/sqrt(2), if the walk has
the density q = (omega_o^2 sigma / b)^2 dt. A gain loss is estimated where its input moves, and
its spread grows where it does not.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from faultgauge.errors import InputError
from faultgauge.observers.observer import Linearisation, OperatingPoints, linearise
from faultgauge.plants.plant import Plant, clip_state, respond
from faultgauge.simulation.free_run import substeps_for
from faultgauge.simulation.integrators import step as integrate

__all__ = ["JointInfo", "JointObserver", "JointState", "design_joint"]

UNDER_WAY = 0.05
ALIKE = 1e-6  # smallest singular value of the faults' directions: below it is rounding


class JointState(NamedTuple):
    """Everything carried from sample to sample: `z` = (x, f), its covariance, the command, and
    the mean normalised innovation."""

    z: Float[Array, "n"]
    P: Float[Array, "n n"]
    u: Float[Array, "inputs"]
    unexplained: Float[Array, ""]


class JointInfo(NamedTuple):
    """Estimates of one step, the innovation y - yhat before correction, and `unexplained`: its
    mean square over about 1/omega_o in units of what is expected of noise and of estimates that
    have a twentieth of their way to go. A fault that is not declared makes it large."""

    x: Float[Array, "states"]
    f: Float[Array, "faults"]
    sd: Float[Array, "faults"]
    innovation: Float[Array, "outputs"]
    unexplained: Float[Array, ""]


class JointObserver(eqx.Module):
    """Designed by `design_joint`; `walk` is each fault's variance per second, `sigma` each
    output's noise (inf: not used), `reach` how far a unit fault moves each output in 1/omega_o."""

    plant: Plant
    substeps: int = eqx.field(static=True)
    sigma: Float[Array, "outputs"]
    walk: Float[Array, "faults"]
    reach: Float[Array, "outputs faults"]
    bandwidth: float

    def init(self, x: Float[Array, "states"], u: Float[Array, "inputs"]) -> JointState:
        """Start at state `x` under input `u`, without a fault."""
        n, k = len(x), len(self.walk)
        used = jnp.isfinite(self.sigma)
        first = jnp.max(jnp.where(used, self.sigma, 0.0)) ** 2
        P = jnp.diag(jnp.concatenate([jnp.full(n, first), jnp.zeros(k)]))
        return JointState(jnp.concatenate([x, jnp.zeros(k)]), P, u, jnp.ones(()))

    def step(
        self,
        state: JointState,
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
        dt: Float[Array, ""],
    ) -> tuple[JointState, JointInfo]:
        """One sample: `u` and `y` (NaN: not sampled) now, `dt` s after the last."""
        n = len(state.z) - len(self.walk)

        def move(z: Array) -> Array:
            x = integrate(self.plant, z[:n], state.u, u, z[n:], dt, self.substeps)
            return jnp.concatenate([x, z[n:]])

        def look(z: Array) -> Array:
            return respond(self.plant, z[:n], u, z[n:])[1]

        A, z = jax.jacfwd(move)(state.z), move(state.z)
        P = A @ state.P @ A.T
        P = P.at[jnp.arange(n, len(z)), jnp.arange(n, len(z))].add(self.walk * dt)
        seen = jnp.isfinite(self.sigma) & jnp.isfinite(y)
        C = jnp.where(seen[:, None], jax.jacfwd(look)(z), 0.0)
        e = jnp.where(seen, y - look(z), 0.0)
        R = jnp.diag(jnp.where(seen, self.sigma, 1.0) ** 2)
        S = C @ P @ C.T + R
        K = jnp.linalg.solve(S, C @ P).T
        keep = jnp.eye(len(z)) - K @ C
        P = keep @ P @ keep.T + K @ R @ K.T  # Joseph's form
        z = self._inside(z + K @ e)
        # while an estimate is still on its way, the innovation is not noise alone
        under_way = UNDER_WAY * self.reach @ jnp.abs(z[n:])
        surprise = jnp.sum(e**2 / (jnp.diag(S) + under_way**2)) / jnp.maximum(jnp.sum(seen), 1)
        blend = jnp.where(jnp.any(seen), 1.0 - jnp.exp(-self.bandwidth * dt), 0.0)
        unexplained = state.unexplained + blend * (surprise - state.unexplained)
        sd = jnp.sqrt(jnp.diag(P)[n:])
        return JointState(z, P, u, unexplained), JointInfo(z[:n], z[n:], sd, e, unexplained)

    def _inside(self, z: Float[Array, "n"]) -> Float[Array, "n"]:
        """State and faults within the limits that the plant declares."""
        signals = self.plant.signals
        n = len(signals.states)
        lower = jnp.array([fault.min for fault in signals.faults])
        upper = jnp.array([fault.max for fault in signals.faults])
        return jnp.concatenate([clip_state(self.plant, z[:n]), jnp.clip(z[n:], lower, upper)])


def design_joint(
    plant: Plant,
    points: OperatingPoints,
    dt: float,
    bandwidth: float,
    sigma: Float[np.ndarray, "outputs"],
    max_step: float,
) -> JointObserver:
    """A joint observer at sample time `dt` [s] with `bandwidth` omega_o [rad/s].

    `sigma` is the noise of each output; inf leaves one out. Raises `InputError` where the outputs
    cannot tell the declared faults apart at the operating points.
    """
    substeps = substeps_for(dt, max_step)
    effects = _effects(linearise(plant, points, dt, substeps), sigma, bandwidth)
    _check(plant.signals.fault_names, effects)
    scale = np.where(np.isfinite(sigma), sigma / bandwidth, 0.0)
    effect = np.sqrt(np.mean(np.max(np.abs(effects), axis=1) ** 2, axis=0))
    return JointObserver(
        plant=plant,
        substeps=substeps,
        sigma=jnp.asarray(sigma),
        walk=jnp.asarray((bandwidth**2 / effect) ** 2 * dt),
        reach=jnp.asarray(np.sqrt(np.mean(np.abs(effects) ** 2, axis=0)) * scale[:, None]),
        bandwidth=bandwidth,
    )


def _effects(
    linear: Linearisation, sigma: Float[np.ndarray, "outputs"], bandwidth: float
) -> Complex[np.ndarray, "points outputs faults"]:
    """omega_o |C (j omega_o - F_x)^-1 F_f + D| / sigma [1/s]: how fast a unit fault moves each
    output, counted in its noise; the rate b itself over an integrator."""
    states = linear.F_x.shape[1]
    resolvent = 1j * bandwidth * np.eye(states) - linear.F_x
    reached = linear.C @ np.linalg.solve(resolvent, linear.F_f.astype(complex)) + linear.D
    scale = np.where(np.isfinite(sigma), bandwidth / sigma, 0.0)
    return reached * scale[:, None]


def _check(names: tuple[str, ...], effects: Complex[np.ndarray, "points outputs faults"]) -> None:
    """Every fault must move the outputs, and no other faults together move them alike."""
    sizes = np.linalg.norm(effects.reshape(-1, len(names)), axis=0)
    for name, size in zip(names, sizes, strict=True):
        if not size > 0:
            raise InputError(
                f"fault {name!r} moves none of the measured outputs at the operating points; "
                "measure one that it moves, or remove the fault from the plant file."
            )
    directions = effects.reshape(-1, len(names)) / sizes
    _, singular, rows = np.linalg.svd(directions)
    if len(directions) < len(names) or singular[-1] < ALIKE:
        alike = [name for name, part in zip(names, rows[-1], strict=True) if abs(part) > 0.1]
        raise InputError(
            f"faults {', '.join(alike)} move the measured outputs alike, so they cannot be told "
            "apart when several act at once; declare fewer of them or measure one output more."
        )
