"""Simulation error: the plant's free run against the log, over windows whose starts are unknown.

    minimise  sum_k |w_k (y_k(theta, x_0) - y_k)|^2 + sigma^2 (theta' P theta + |z|^2),
              x_0 = center + sd z      for every window

y_k is a simulation that sees no measurement, so noise in the log biases nothing; sigma^2 weighs
the priors of unknowns and starts against the samples. Multiple shooting in its plainest form: each
window has a start of its own (H. G. Bock, 1981), and windows grow until they are whole runs.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.optimise.cores import side_by_side
from faultgauge.identification.optimise.levenberg_marquardt import (
    FAILED,
    Options,
    Solution,
    levenberg_marquardt,
)
from faultgauge.identification.unknowns import Unknowns
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import respond
from faultgauge.programs import program
from faultgauge.simulation.integrators import sensitive_step, step_through
from faultgauge.telemetry.statistics import MAD_TO_STD

__all__ = [
    "Fitted",
    "PseudoRows",
    "Ridge",
    "Rows",
    "SimulationResidual",
    "WindowBatch",
    "beside_of",
    "fit_starts",
    "fit_windows",
    "local_unknowns",
    "mean_square",
    "simulated",
]

# Damping of the first step. A long window's start weighs so much more than all else that more of it
# would hold the parameters where they are.
TAU = 1e-9
MOST_TRIALS = 300  # of Levenberg-Marquardt
# A share of a hundredth of what networks should leave alone weighs as much as all errors.
CLAIM = 100.0
FULL = 8  # windows, side by side, that keep a core busy: more starts at once would gain nothing
HUBER = 1.345  # standard deviations: 95 % as efficient as least squares under Gaussian noise


Ridge = float | Float[np.ndarray, "weights"]  # of the networks' prior, for all weights or for each
Rows = Callable[[GrayBoxPlant], Float[Array, "rows"]]  # what should be 0 of a plant


class WindowBatch(eqx.Module):
    """Windows of one length, windows first: stage inputs (see `intersample`), time steps [s],
    outputs, and weights (0 where a sample is not to be fitted); starts as centre and spread; what
    each increment of a drifting parameter adds to it at each sample (see `drift`)."""

    center: Float[Array | np.ndarray, "*windows states"]
    sd: Float[Array | np.ndarray, "*windows states"]
    stages: Float[Array | np.ndarray, "*windows samples stages inputs"]
    dt: Float[Array | np.ndarray, "*windows samples"]
    y: Float[Array | np.ndarray, "*windows samples outputs"]
    weight: Float[Array | np.ndarray, "*windows samples outputs"]
    walk: Float[Array | np.ndarray, "*windows samples increments slow"]


class SimulationResidual(eqx.Module):
    """Residuals of one window: weighted output errors, then the prior of its start."""

    plant: GrayBoxPlant
    sigma: Float[Array, ""]
    unknowns: Unknowns = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    robust: bool = eqx.field(static=True, default=False)

    def __call__(self, own: Float[Array, "own"], window: Any) -> Float[Array, "equations"]:
        _, error = self.run(own, window)
        local = own[own.size - self.local(window) :]
        return jnp.concatenate([self._bounded(error).ravel(), self.sigma * local])

    def local(self, window: Any) -> int:
        return local_unknowns(self.unknowns, window)

    def run(
        self, own: Float[Array, "own"], window: Any
    ) -> tuple[Float[Array, "samples states"], Float[Array, "samples outputs"]]:
        """(states, weighted errors) of one window."""
        x0, f = self._start(own, window), jnp.zeros(len(self.plant.signals.faults))
        values = self._values(own, window)
        constant = self.unknowns.assemble(self.plant, values)

        def body(x: Array, sample: tuple[Array, ...]) -> tuple[Array, tuple[Array, Array]]:
            stages, dt, drift = sample
            drifted = self._drifted(values, drift)
            plant = self.unknowns.assemble(self.plant, drifted) if self.unknowns.slow else constant
            y = respond(plant, x, stages[0], f)[1]
            return step_through(plant, x, stages, f, dt, self.substeps), (x, y)

        samples = window.stages, window.dt, self._drift(own, window)
        x, y = jax.lax.scan(body, x0, samples)[1]
        return x, self._errors(y, window)

    def linearised(
        self, own: Float[Array, "own"], window: Any
    ) -> tuple[Float[Array, "equations"], Float[Array, "equations own"]]:
        """The residuals and their Jacobian, by forward sensitivities.

            S = dx / d own,    dS/dt = F_x S + F_own,    dy = h_x S + h_own

        integrated with the state: Runge-Kutta on both is the derivative of Runge-Kutta on the
        state. F_x and F_own come from one reverse pass per state, whatever the unknowns.
        """
        states, unknowns = window.center.shape[-1], self.unknowns
        values = self._values(own, window)

        def body(carry: tuple[Array, Array], sample: tuple[Array, ...]) -> Any:
            stages, dt, drift, walked = sample
            natural, slopes = self._natural(values, drift)

            def flow(
                x: Float[Array, "states"], S: Float[Array, "states own"], u: Float[Array, "inputs"]
            ) -> tuple[Float[Array, "states"], Float[Array, "states own"]]:
                def rate(x: Array, natural: list[Array]) -> Array:
                    return respond(unknowns.put(self.plant, natural), x, u)[0]

                dx, pull = jax.vjp(rate, x, natural)
                in_x, in_natural = jax.vmap(pull)(jnp.eye(states))
                return dx, in_x @ S + self._in_own(in_natural, in_x.shape, slopes, walked)

            return sensitive_step(self.plant, flow, carry, stages, dt, self.substeps), carry

        x0 = self._start(own, window)
        S0 = jax.jacfwd(self._start)(own, window)
        samples = window.stages, window.dt, self._drift(own, window), window.walk
        _, (x, S) = jax.lax.scan(body, (x0, S0), samples)

        def seen(x: Array, S: Array, sample: tuple[Array, ...]) -> tuple[Array, Array]:
            stages, _, drift, walked = sample
            natural, slopes = self._natural(values, drift)

            def output(x: Array, natural: list[Array]) -> Array:
                return respond(unknowns.put(self.plant, natural), x, stages[0])[1]

            y, pull = jax.vjp(output, x, natural)
            in_x, in_natural = jax.vmap(pull)(jnp.eye(len(y)))
            return y, in_x @ S + self._in_own(in_natural, in_x.shape, slopes, walked)

        y, in_all = jax.vmap(seen)(x, S, samples)
        error = self._errors(y, window)
        bounded, slope = jax.jvp(self._bounded, (error,), (jnp.ones_like(error),))
        in_all = jnp.where(window.weight > 0, slope * window.weight, 0.0)[..., None] * in_all
        local = self.local(window)
        r = jnp.concatenate([bounded.ravel(), self.sigma * own[own.size - local :]])
        prior = self.sigma * jnp.eye(local, own.size, own.size - local)
        return r, jnp.concatenate([in_all.reshape(-1, own.size), prior])

    def _natural(
        self, values: Float[Array, "unknowns"], drift: Float[Array, "slow"]
    ) -> tuple[list[Array], Float[Array, "unknowns"]]:
        """(natural values, their slopes against `values`) where parameters have drifted."""
        now = self._drifted(values, drift) if self.unknowns.slow else values
        return self.unknowns.natural(self.plant, now), self.unknowns.slopes(self.plant, now)

    def _in_own(
        self,
        pulled: list[Array],
        shape: tuple[int, int],
        slopes: Float[Array, "unknowns"],
        walked: Float[Array, "increments slow"],
    ) -> Float[Array, "rows own"]:
        """Slopes against natural values, `pulled` back, as slopes against the window's own
        unknowns: `shape` says how many rows, and how many starts of states are among those."""
        rows, states = shape
        each_row = [each.reshape(rows, -1) for each in pulled]
        shared = slopes * jnp.concatenate([jnp.zeros((rows, 0)), *each_row], axis=1)
        first = self.unknowns.weights(self.plant)
        varying = shared[:, [first + k for k in self.unknowns.varying]]
        drifting = shared[:, None, [first + k for k in self.unknowns.slow]] * walked
        blocks = shared, jnp.zeros((rows, states)), varying, drifting.reshape(rows, -1)
        return jnp.concatenate(blocks, axis=1)

    def _values(self, own: Float[Array, "own"], window: Any) -> Float[Array, "unknowns"]:
        """theta with the window's own values of the varying parameters, where it begins."""
        shared, states = own.size - self.local(window), window.center.shape[-1]
        first, values = self.unknowns.weights(self.plant), own[:shared]
        for k, index in enumerate(self.unknowns.varying):
            values = values.at[first + index].add(own[shared + states + k])
        return values

    def _drift(self, own: Float[Array, "own"], window: Any) -> Float[Array, "samples slow"]:
        """How far drifting parameters have gone from where the window began."""
        shape = window.walk.shape[-2:]
        increments = own[own.size - math.prod(shape) :].reshape(shape)
        return jnp.einsum("nks,ks->ns", window.walk, increments)

    def _drifted(
        self, values: Float[Array, "unknowns"], drift: Float[Array, "slow"]
    ) -> Float[Array, "unknowns"]:
        first = self.unknowns.weights(self.plant)
        for k, index in enumerate(self.unknowns.slow):
            values = values.at[first + index].add(drift[k])
        return values

    def _start(self, own: Float[Array, "own"], window: Any) -> Float[Array, "states"]:
        first, states = own.size - self.local(window), window.center.shape[-1]
        return window.center + window.sd * own[first : first + states]

    def _errors(
        self, y: Float[Array, "samples outputs"], window: Any
    ) -> Float[Array, "samples outputs"]:
        return jnp.where(window.weight > 0, window.weight * (y - window.y), 0.0)

    def _bounded(self, error: Float[Array, "*grid"]) -> Float[Array, "*grid"]:
        """r^2 becomes 2 b^2 (sqrt(1 + (r/b)^2) - 1) where errors are bounded: linear beyond b."""
        if not self.robust:
            return error
        ratio = error / (HUBER * self.sigma)
        return error * jnp.sqrt(2.0 / (jnp.sqrt(1.0 + ratio**2) + 1.0))


def local_unknowns(unknowns: Unknowns, window: Any) -> int:
    """How many unknowns are of one window alone: its start, its values of the varying parameters,
    and the increments of those that drift."""
    increments = math.prod(window.walk.shape[-2:])
    return window.center.shape[-1] + len(unknowns.varying) + increments


class PseudoRows(eqx.Module):
    """Rows of the plant that theta stands for, as the weighted errors count."""

    plant: GrayBoxPlant
    rows: Rows
    weight: Float[Array, ""]
    unknowns: Unknowns = eqx.field(static=True)

    def __call__(self, theta: Float[Array, "parameters"]) -> Float[Array, "rows"]:
        return self.weight * self.rows(self.unknowns.assemble(self.plant, theta))


def beside_of(
    plant: GrayBoxPlant,
    claims: Rows,
    unknowns: Unknowns,
    windows: WindowBatch,
    sigma: float,
) -> PseudoRows:
    """`claims` beside a fit over `windows` whose errors are about `sigma`."""
    weight = CLAIM * sigma * np.sqrt(windows.dt.size)
    return PseudoRows(plant, claims, jnp.asarray(weight), unknowns)


class Fitted(NamedTuple):
    """A fit over windows: unknowns, starts of the windows, states along them, mean square of the
    weighted errors, and how it ended (see `Solution`)."""

    theta: Float[np.ndarray, "unknowns"]
    z: Float[np.ndarray, "windows local"]
    x: Float[np.ndarray, "windows samples states"]
    mse: float
    status: int
    trials: int

    @property
    def usable(self) -> bool:
        return self.status != FAILED and bool(np.isfinite(self.mse))


def fit_windows(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    thetas: Float[np.ndarray, "starts unknowns"],
    windows: WindowBatch,
    substeps: int,
    *,
    z: Float[np.ndarray, "starts windows local"] | None = None,
    sigma: float,
    ridge: Ridge = 1.0,
    prior: float = 1.0,
    trials: int = 60,
    tolerance: float = 1e-5,
    robust: bool = False,
    claims: Rows | None = None,
) -> list[Fitted]:
    """Levenberg-Marquardt from every start, all side by side; the windows start at `z`.

    `sigma` is the error expected, as a share of the outputs' spread; `ridge` multiplies the
    networks' share of the prior, `prior` the parameters'. `robust` bounds the pull of errors beyond
    `HUBER` sigma; `claims` are rows of a plant that are to be 0 (see `claims`).
    """
    lower, upper = unknowns.bounds(plant)
    return _fit(
        plant, unknowns, thetas, z, windows, substeps, sigma, ridge, prior, trials, tolerance,
        robust, lower, upper, claims,
    )  # fmt: skip


def fit_starts(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    theta: Float[np.ndarray, "unknowns"],
    windows: WindowBatch,
    substeps: int,
    *,
    sigma: float,
    robust: bool = False,
) -> Fitted:
    """Only what is local to the windows is fitted; `theta` stays."""
    return _fit(
        plant, unknowns, theta[None], None, windows, substeps, sigma, 1.0, 1.0, 30, 1e-5, robust,
        theta, theta,
    )[0]  # fmt: skip


def _fit(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    thetas: Float[np.ndarray, "starts unknowns"],
    z: Float[np.ndarray, "starts windows local"] | None,
    windows: WindowBatch,
    substeps: int,
    sigma: float,
    ridge: Ridge,
    prior: float,
    trials: int,
    tolerance: float,
    robust: bool,
    lower: Float[np.ndarray, "unknowns"],
    upper: Float[np.ndarray, "unknowns"],
    claims: Rows | None = None,
) -> list[Fitted]:
    residual = SimulationResidual(plant, jnp.asarray(sigma), unknowns, substeps, robust)
    count, local = len(windows.center), residual.local(windows)
    starts, size = thetas.shape
    penalty = np.full(size + count * local, prior)
    penalty[: unknowns.weights(plant)] = ridge
    penalty[size:] = 0.0  # the starts' prior is in the residual
    least, most = _range_of_starts(plant, windows, local)
    first = np.zeros((starts, count * local)) if z is None else z.reshape(starts, -1)
    first = np.concatenate([thetas, first], axis=1)
    batch = starts if count < FULL else 1
    together = batch if batch > 1 else None
    samples = jax.tree.map(jnp.asarray, windows)
    beside = None if claims is None else beside_of(plant, claims, unknowns, windows, sigma)

    def fit(some: Float[np.ndarray, "starts unknowns"]) -> Solution:
        found = levenberg_marquardt(
            residual,
            jnp.asarray(some),
            samples,
            None,
            jnp.asarray(np.concatenate([lower, least])),
            jnp.asarray(np.concatenate([upper, most])),
            Options(max_trials=MOST_TRIALS, tau=TAU, tolerance=tolerance, batch=together),
            jnp.asarray(sigma**2 * penalty),
            local,
            residual.linearised,
            jnp.asarray(trials),
            beside,
        )
        return jax.tree.map(np.asarray, found)

    parts = side_by_side(fit, [first[k : k + batch] for k in range(0, starts, batch)])
    solution = jax.tree.map(lambda *each: np.concatenate(each), *parts)
    found = []
    for k in range(starts):
        theta, z = np.split(solution.theta[k], [size])
        z = z.reshape(count, local)
        x, errors = simulated(plant, unknowns, theta, z, windows, substeps)
        mse = mean_square(errors, windows, robust)
        found.append(Fitted(theta, z, x, mse, int(solution.status[k]), int(solution.trials[k])))
    return found


def _range_of_starts(
    plant: GrayBoxPlant, windows: WindowBatch, local: int
) -> tuple[Float[np.ndarray, "starts"], Float[np.ndarray, "starts"]]:
    """Bounds of the windows' own unknowns: a state starts within its min and max."""
    found = []
    for limit, free in (("min", -np.inf), ("max", np.inf)):
        ends = np.full((len(windows.center), local), free)
        limits = np.array([getattr(state, limit) for state in plant.signals.states])
        ends[:, : len(limits)] = (limits - windows.center) / windows.sd
        found.append(ends.ravel())
    return found[0], found[1]


def simulated(
    plant: GrayBoxPlant,
    unknowns: Unknowns,
    theta: Float[np.ndarray, "unknowns"],
    z: Float[np.ndarray, "windows local"],
    windows: WindowBatch,
    substeps: int,
) -> tuple[
    Float[np.ndarray, "windows samples states"], Float[np.ndarray, "windows samples outputs"]
]:
    """(states along the windows, weighted errors, 0 where nothing is weighed)."""
    x, errors = _simulated(
        SimulationResidual(plant, jnp.asarray(0.0), unknowns, substeps),
        jnp.asarray(theta),
        jnp.asarray(z),
        jax.tree.map(jnp.asarray, windows),
    )
    return np.asarray(x), np.asarray(errors)


def mean_square(
    errors: Float[np.ndarray, "*grid outputs"], windows: WindowBatch, robust: bool = False
) -> float:
    """Mean square of the weighted errors; `robust`: as their median has it under Gaussian noise."""
    weighed = np.abs(errors[windows.weight > 0])
    if robust:
        return float((MAD_TO_STD * np.median(weighed)) ** 2)
    with np.errstate(over="ignore"):
        return float(np.sum(weighed**2)) / max(len(weighed), 1)


@program
def _simulated(
    residual: SimulationResidual, theta: Array, z: Array, windows: WindowBatch
) -> tuple[Array, Array]:
    def one(z: Array, window: WindowBatch) -> tuple[Array, Array]:
        return residual.run(jnp.concatenate([theta, z]), window)

    return jax.vmap(one)(z, windows)
