"""What a policy needs of an observer: state, faults and how far they can be trusted, online."""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from faultgauge.observers.joint import JointObserver, JointState
from faultgauge.observers.observer import Observer, ObserverState
from faultgauge.plants.plant import Plant

__all__ = ["Estimate", "Estimator", "JointFaults", "SingleFault"]


class Estimate(NamedTuple):
    """State and fault sizes; `sd` of the sizes, `unexplained`: what no fault accounts for, about
    1 where the model is right."""

    x: Float[Array, "states"]
    f: Float[Array, "faults"]
    sd: Float[Array, "faults"]
    unexplained: Float[Array, ""]


class Estimator(eqx.Module):
    """An observer in a loop: first it reads y, then it is told the command that follows."""

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


class SingleFault(Estimator):
    """One observer for one fault: ESO over physics, IESONN over a learned plant.

    It gives no spread, and with one hypothesis nothing is left unexplained.
    """

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
        return state, Estimate(info.x, f, jnp.zeros_like(f), jnp.ones(()))

    def commanded(self, state: ObserverState, u: Float[Array, "inputs"]) -> ObserverState:
        return state._replace(u=u)


class JointFaults(Estimator):
    """All declared faults at once, by the joint observer."""

    observer: JointObserver

    @property
    def plant(self) -> Plant:
        return self.observer.plant

    def init(self, x: Float[Array, "states"], u: Float[Array, "inputs"]) -> JointState:
        return self.observer.init(x, u)

    def read(
        self, state: JointState, y: Float[Array, "outputs"], dt: Float[Array, ""]
    ) -> tuple[JointState, Estimate]:
        state, info = self.observer.step(state, state.u, y, dt)
        return state, Estimate(info.x, info.f, info.sd, info.unexplained)

    def commanded(self, state: JointState, u: Float[Array, "inputs"]) -> JointState:
        return state._replace(u=u)
