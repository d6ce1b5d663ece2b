"""Several observers beside each other, as one step: one call of a compiled program for all."""

from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.observers.observer import Design, Observer, ObserverInfo, ObserverState
from faultgauge.plants.plant import Plant

__all__ = ["Beside", "States"]

States = tuple[ObserverState, ...]


class Beside(eqx.Module):
    """Observers that read the same samples; states and answers are tuples in their order."""

    observers: tuple[Observer, ...]

    @staticmethod
    def of(designs: Mapping[str, Design]) -> "Beside":
        return Beside(tuple(design.observer for design in designs.values()))

    def on(self, plant: Plant) -> "Beside":
        """The same observers over another `plant`, as a run's own parameters make it."""
        return Beside(
            tuple(eqx.tree_at(lambda each: each.plant, one, plant) for one in self.observers)
        )

    def init(
        self, x: Float[Array | np.ndarray, "states"], u: Float[Array | np.ndarray, "inputs"]
    ) -> States:
        """Start all at state `x` under input `u`."""
        return tuple(one.init(jnp.asarray(x), jnp.asarray(u)) for one in self.observers)

    def step(
        self,
        state: States,
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
        dt: Float[Array, ""],
    ) -> tuple[States, tuple[ObserverInfo, ...]]:
        """One sample for all."""
        pairs = [one.step(s, u, y, dt) for one, s in zip(self.observers, state, strict=True)]
        return tuple(s for s, _ in pairs), tuple(info for _, info in pairs)
