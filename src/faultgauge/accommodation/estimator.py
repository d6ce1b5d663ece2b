"""What a policy acts on, sample by sample: the state, and the faults that are to be cancelled."""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from faultgauge.detection.watch import Watch, WatchState
from faultgauge.observers.observer import Observer, ObserverState
from faultgauge.plants.plant import Plant

__all__ = ["ByPosterior", "Estimate", "Estimator", "TotalDisturbance"]


class Estimate(NamedTuple):
    """State, fault sizes, and which faults are to be acted upon."""

    x: Float[Array, "states"]
    f: Float[Array, "faults"]
    engaged: Bool[Array, "faults"]


class Estimator(eqx.Module):
    """In a loop it first reads y, then it is told the command that follows."""

    @property
    @abc.abstractmethod
    def plant(self) -> Plant:
        """The plant that it believes in."""

    @abc.abstractmethod
    def init(self, x: Float[Array, "states"], u: Float[Array, "inputs"]) -> Any: ...

    @abc.abstractmethod
    def read(
        self, state: Any, y: Float[Array, "outputs"], dt: Float[Array, ""]
    ) -> tuple[Any, Estimate]:
        """`y` is measured under the command that has stood for `dt` [s]."""

    @abc.abstractmethod
    def commanded(self, state: Any, u: Float[Array, "inputs"]) -> Any:
        """`u` stands from now on."""


class WatchingState(NamedTuple):
    """The watch, the time [s] and command of its next row, and the last state that was known."""

    watch: WatchState
    t: Float[Array, ""]
    u: Float[Array, "inputs"]
    x: Float[Array, "states"]


class ByPosterior(Estimator):
    """The watch along a log, row by row as they come: a fault is acted upon while it is named, and
    its size is the posterior's mean. A passive fault is not acted upon."""

    watch: Watch

    @property
    def plant(self) -> Plant:
        return self.watch.plant

    def init(self, x: Float[Array, "states"], u: Float[Array, "inputs"]) -> WatchingState:
        return WatchingState(self.watch.init(), jnp.zeros(()), u, x)

    def read(
        self, state: WatchingState, y: Float[Array, "outputs"], dt: Float[Array, ""]
    ) -> tuple[WatchingState, Estimate]:
        # outputs that nobody logs are not in the row of a file either
        y = jnp.where(self.watch.used, y, jnp.nan)
        watch, row = self.watch.step(state.watch, state.t + dt, state.u, y)
        x = row.posterior.x[: len(state.x)]
        x = jnp.where(jnp.isfinite(x), x, state.x)
        active = np.array([f.monitor == "active" for f in self.watch.signals.faults], bool)
        engaged = row.verdict.named[:-1] & active
        f = jnp.nan_to_num(row.posterior.f)
        return WatchingState(watch, state.t + dt, state.u, x), Estimate(x, f, engaged)

    def commanded(self, state: WatchingState, u: Float[Array, "inputs"]) -> WatchingState:
        return state._replace(watch=self.watch.commanded(state.watch, u), u=u)


class TotalDisturbance(Estimator):
    """An observer of one fault, which stands for whatever differs from its plant and is always
    acted upon: no decision is made."""

    observer: Observer

    @property
    def plant(self) -> Plant:
        return self.observer.plant

    def init(self, x: Float[Array, "states"], u: Float[Array, "inputs"]) -> ObserverState:
        return self.observer.init(x, u)

    def read(
        self, state: ObserverState, y: Float[Array, "outputs"], dt: Float[Array, ""]
    ) -> tuple[ObserverState, Estimate]:
        state, info = self.observer.step(state, state.u, y, dt)
        f = self.observer.faults(info.f)
        return state, Estimate(info.x, f, jnp.ones_like(f, bool))

    def commanded(self, state: ObserverState, u: Float[Array, "inputs"]) -> ObserverState:
        return state._replace(u=u)
