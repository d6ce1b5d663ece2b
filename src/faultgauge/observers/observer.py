"""What every observer is: a pure `init` and `step`, arrays in, arrays out."""

import abc
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float

from faultgauge.plants.plant import Plant, respond
from faultgauge.programs import program
from faultgauge.simulation.integrators import step as integrate

__all__ = [
    "CurrentObserver",
    "Design",
    "Linearisation",
    "Observer",
    "ObserverInfo",
    "ObserverState",
    "OperatingPoints",
    "linearise",
    "observe",
]


class ObserverState(NamedTuple):
    """Everything an observer carries from sample to sample (a checkpoint)."""

    x: Float[Array, "states"]
    f: Float[Array, ""]
    u: Float[Array, "inputs"]


class ObserverInfo(NamedTuple):
    """Diagnostics of one step: the estimate and the innovation y - yhat before correction."""

    f: Float[Array, ""]
    x: Float[Array, "states"]
    y: Float[Array, "outputs"]
    innovation: Float[Array, "outputs"]


class OperatingPoints(NamedTuple):
    """Points of the training envelope at which an observer is designed and checked."""

    x: Float[np.ndarray, "points states"]
    u: Float[np.ndarray, "points inputs"]


class Design(NamedTuple):
    """An observer and what is to be reported about it.

    `poles` are those of the linearised error at the nominal point, in 1/s; `real_poles` is the
    paper's condition (13) in general form; `radius` is the largest spectral radius of the
    discrete error dynamics over the operating points (below 1: stable).
    """

    observer: "Observer"
    output: str
    order: int
    poles: tuple[complex, ...]
    real_poles: bool
    radius: float


class Observer(eqx.Module):
    """A discrete observer: pure `init` and `step`.

    `target` indexes the fault in the plant's list (-1: no fault is estimated).
    """

    plant: eqx.AbstractVar[Plant]
    target: eqx.AbstractVar[int]
    substeps: eqx.AbstractVar[int]

    def init(self, x: Float[Array, "states"], u: Float[Array, "inputs"]) -> ObserverState:
        """Start at state `x` under input `u`, without a fault."""
        return ObserverState(x, jnp.zeros(()), u)

    @abc.abstractmethod
    def step(
        self,
        state: ObserverState,
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
        dt: Float[Array, ""],
    ) -> tuple[ObserverState, ObserverInfo]:
        """One sample: `u` [input units] and `y` (NaN: not sampled) now, `dt` s after the last."""

    def faults(self, size: Float[Array, ""]) -> Float[Array, "faults"]:
        """The plant's fault vector with this observer's fault in its place."""
        f = jnp.zeros(len(self.plant.signals.faults))
        return f if self.target < 0 else f.at[self.target].set(size)


class CurrentObserver(Observer):
    """An observer in its current form: predict over dt, then correct by y.

    x-  =  Phi(x, f, u, dt),   e = h(x-) - y,   x = x- - L_x e,   f = f - L_f g(e)
    """

    @abc.abstractmethod
    def correct(
        self, x: Float[Array, "states"], f: Float[Array, ""], e: Float[Array, "outputs"]
    ) -> tuple[Float[Array, "states"], Float[Array, ""]]:
        """State and fault after the innovation; `e` = yhat - y, 0 where y is not sampled."""

    def step(
        self,
        state: ObserverState,
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
        dt: Float[Array, ""],
    ) -> tuple[ObserverState, ObserverInfo]:
        f = self.faults(state.f)
        x = integrate(self.plant, state.x, state.u, u, f, dt, self.substeps)
        predicted = _outputs(self.plant, x, u, f)
        e = jnp.where(jnp.isfinite(y), predicted - y, 0.0)
        x, size = self.correct(x, state.f, e)
        return ObserverState(x, size, u), ObserverInfo(size, x, predicted, -e)


def _outputs(plant: Plant, x: Array, u: Array, f: Array) -> Float[Array, "outputs"]:
    return respond(plant, x, u, f)[1]


@program
def observe(
    observer: Observer,
    x0: Float[Array, "states"],
    u: Float[Array, "samples inputs"],
    y: Float[Array, "samples outputs"],
    dt: Float[Array, "samples"],
) -> ObserverInfo:
    """Run an observer over a record; `dt[k]` leads to sample k (dt[0] = 0)."""

    def body(state: ObserverState, sample: tuple[Array, ...]) -> tuple[ObserverState, Any]:
        return observer.step(state, *sample)

    return jax.lax.scan(body, observer.init(x0, u[0]), (u, y, dt))[1]


class Linearisation(NamedTuple):
    """Dynamics at every operating point: over one sample (A, B, C, D), and dF/dx, dF/df."""

    A: Float[np.ndarray, "points states states"]
    B: Float[np.ndarray, "points states faults"]
    C: Float[np.ndarray, "points outputs states"]
    D: Float[np.ndarray, "points outputs faults"]
    F_x: Float[np.ndarray, "points states states"]
    F_f: Float[np.ndarray, "points states faults"]


def linearise(
    plant: Plant, points: OperatingPoints, dt: float, substeps: int | None
) -> Linearisation:
    """Jacobians of the step Phi in `substeps`, and of the outputs, with respect to state and
    faults; without `substeps` those of the exact step, which is stable wherever the plant is:
    exp([F_x F_f; 0 0] dt)."""
    x, u = map(jax.device_put, points)
    C, D, F_x, F_f = map(np.asarray, _jacobians(plant, x, u))
    if substeps is None:
        n = F_x.shape[1]
        rates = np.concatenate([F_x, F_f], axis=2)
        rates = np.nan_to_num(np.pad(rates, ((0, 0), (0, F_f.shape[2]), (0, 0))))
        step = scipy.linalg.expm(rates * dt)
        A, B = step[:, :n, :n], step[:, :n, n:]
    else:
        A, B = map(np.asarray, _step_jacobians(plant, x, u, jax.device_put(dt), substeps))
    found = A, B, C, D, F_x, F_f
    finite = np.all([np.isfinite(a).reshape(len(points.x), -1).all(1) for a in found], axis=0)
    return Linearisation(*(a[finite] for a in found))


@program
def _jacobians(plant: Plant, x: Array, u: Array) -> tuple[Array, ...]:
    """Of outputs and rates."""

    def one(x: Array, u: Array) -> tuple[Array, ...]:
        def shown(x: Array, f: Array) -> Array:
            return _outputs(plant, x, u, f)

        def rate(x: Array, f: Array) -> Array:
            return respond(plant, x, u, f)[0]

        return (*_by_both(plant, shown, x), *_by_both(plant, rate, x))

    return jax.vmap(one)(x, u)


@program
def _step_jacobians(
    plant: Plant, x: Array, u: Array, dt: Array, substeps: int
) -> tuple[Array, Array]:
    def one(x: Array, u: Array) -> tuple[Array, Array]:
        return _by_both(plant, lambda x, f: integrate(plant, x, u, u, f, dt, substeps), x)

    return jax.vmap(one)(x, u)


def _by_both(
    plant: Plant, function: Callable[[Array, Array], Array], x: Array
) -> tuple[Array, Array]:
    """By the state and by the faults, where there is none."""
    return jax.jacfwd(function, (0, 1))(x, jnp.zeros(len(plant.signals.faults)))
