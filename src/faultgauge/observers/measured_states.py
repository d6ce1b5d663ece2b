"""A reference that is fed with the measured states at every sample."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from faultgauge.observers.observer import ObserverInfo, ObserverState
from faultgauge.plants.plant import Plant, respond
from faultgauge.simulation.integrators import step as integrate

__all__ = ["MeasuredStates"]


class MeasuredStates(eqx.Module):
    """yhat = h(x, u) at the measured x; an output that is itself a state is predicted from the
    sample before, because it cannot be compared with itself."""

    plant: Plant
    substeps: int = eqx.field(static=True)

    def init(self, x: Float[Array, "states"], u: Float[Array, "inputs"]) -> ObserverState:
        """Start at the measured state `x` under input `u`."""
        return ObserverState(x, jnp.zeros(()), u)

    def step(
        self,
        state: ObserverState,
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
        dt: Float[Array, ""],
        x: Float[Array, "states"],
    ) -> tuple[ObserverState, ObserverInfo]:
        """One sample: `u`, `y` and the measured `x` (NaN: not sampled, and predicted), `dt` s after
        the last."""
        signals = self.plant.signals
        healthy = jnp.zeros(len(signals.faults))
        ahead = integrate(self.plant, state.x, state.u, u, healthy, dt, self.substeps)
        x = jnp.where(jnp.isfinite(x), x, ahead)
        predicted = respond(self.plant, x, u)[1]
        for j, output in enumerate(signals.outputs):
            if output.measures is not None:
                place = signals.state_names.index(output.measures)
                predicted = predicted.at[j].set(ahead[place])
        info = ObserverInfo(state.f, ahead, predicted, y - predicted)
        return ObserverState(x, state.f, u), info
