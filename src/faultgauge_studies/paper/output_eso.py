"""The paper's observer as eq (11) writes it: closed on an output that reads dx, torque on a wheel.

    e       = h(d(xhat), xhat) - y
    d(xhat) = F(xhat, u) + f - beta_1 e
    d(f)    = -beta_2 g(e, kappa, delta)

e stands on both sides, because h reads d(xhat): an algebraic loop, solved here at every sample.
With y = c dx its linear part is e = c (f - f_true) / (1 + c beta_1), so that

    d(xhat - x) = (f - f_true) / (1 + c beta_1),   d(f) = -c beta_2 (f - f_true) / (1 + c beta_1).

The matrix of these errors has determinant 0: the state error is seen by nothing and stays where
it is, and f is a first-order lag with time constant (1 + c beta_1) / (c beta_2). For c < 0 it
diverges where beta_1 < 1/|c|, and at beta_1 = 1/|c| the loop has no solution. Prefer
`eso.design_eso`, closed on a measured state; this form is here to show the difference.
"""

import equinox as eqx
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from faultgauge.errors import InputError
from faultgauge.observers.eso import fal
from faultgauge.observers.observer import Observer, ObserverInfo, ObserverState
from faultgauge.plants.plant import Plant, respond
from faultgauge.simulation.integrators import step as integrate

__all__ = ["OutputClosedObserver", "design_output_eso", "time_constant"]

NEWTON_STEPS = 20


class OutputClosedObserver(Observer):
    """Eq (11), literally; designed by `design_output_eso`.

    `output` indexes the output that it is closed on; the fault must enter a state.
    """

    plant: Plant
    target: int = eqx.field(static=True)
    output: int = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    beta_1: Float[Array, ""]
    beta_2: Float[Array, ""]
    kappa: float = eqx.field(static=True)
    delta: Float[Array, ""]

    def step(
        self,
        state: ObserverState,
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
        dt: Float[Array, ""],
    ) -> tuple[ObserverState, ObserverInfo]:
        """Advance by the injection that the last sample left, then solve for this sample's e."""
        x = integrate(self.plant, state.x, state.u, u, self.faults(state.f), dt, self.substeps)
        predicted = respond(self.plant, x, u, self.faults(state.f))[1]
        y = jnp.where(jnp.isfinite(y), y, predicted)
        e = self.error(x, state.f, u, y[self.output])
        fault = self.plant.signals.faults[self.target]
        index = self.plant.signals.state_names.index(fault.target)
        x = x.at[index].add(-self.beta_1 * e * dt)
        f = state.f - self.beta_2 * fal(e, self.kappa, self.delta) * dt
        return ObserverState(x, f, u), ObserverInfo(f, x, predicted, y - predicted)

    def error(
        self,
        x: Float[Array, "states"],
        f: Float[Array, ""],
        u: Float[Array, "inputs"],
        y: Float[Array, ""],
    ) -> Float[Array, ""]:
        """The e with e = h(F(x, u) + f - beta_1 e, x) - y, by Newton's method."""

        def loop(e: Float[Array, ""], _: None) -> Float[Array, ""]:
            injected = self.faults(f - self.beta_1 * e)
            return respond(self.plant, x, u, injected)[1][self.output] - y - e

        newton = optx.Newton(rtol=1e-9, atol=1e-12)
        return optx.root_find(loop, newton, y * 0.0, max_steps=NEWTON_STEPS, throw=False).value


def design_output_eso(
    plant: Plant,
    fault: str,
    output: str,
    beta_1: float,
    beta_2: float,
    substeps: int,
    *,
    kappa: float = 1.0,
    delta: float = 1.0,
) -> OutputClosedObserver:
    """Eq (11) with its own gains; `output` must read the derivative that `fault` enters."""
    signals = plant.signals
    target = signals.fault_names.index(fault)
    if signals.faults[target].enters != "state":
        raise InputError(f"fault {fault!r} does not enter a state, which eq (11) requires.")
    return OutputClosedObserver(
        plant=plant,
        target=target,
        output=signals.output_names.index(output),
        substeps=substeps,
        beta_1=jnp.asarray(beta_1),
        beta_2=jnp.asarray(beta_2),
        kappa=kappa,
        delta=jnp.asarray(delta),
    )


def time_constant(beta_1: float, beta_2: float, c: float) -> float:
    """(1 + c beta_1) / (c beta_2) [s] in the linear zone; negative where f diverges."""
    return (1 + c * beta_1) / (c * beta_2)
