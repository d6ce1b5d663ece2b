"""An adaptive neural observer: a network that goes on learning while it runs.

    d(xhat)/dt = u + NN(xhat, u) + l e,   e = x - xhat,   torque = u + NN(xhat, u)
    d(theta)/dt = eta e dNN/dtheta - rho |e| theta

Backpropagation of the observer's error with e-modification, as in H. A. Talebi, K. Khorasani and
S. Tafazoli, "A recurrent neural-network-based sensor and actuator fault detection and isolation for
nonlinear systems with application to the satellite's attitude control subsystem", IEEE Trans.
Neural Networks 20, 2009. Of the plant it knows that the input integrates to the state.
"""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from faultgauge_studies.baselines.baseline import Baseline, Record, Scaling, Weights
from faultgauge_studies.baselines.static_network import layers

__all__ = ["AdaptiveObserver", "Gains", "adaptive_observer", "learn_online"]


class Gains(NamedTuple):
    """`l` [1/s], `eta` and `rho` of the laws above."""

    l: float  # noqa: E741  (its name in the equations)
    eta: float
    rho: float


class Running(NamedTuple):
    """Estimate of the state, its network, and the input that is being held."""

    x: Float[Array, ""]
    theta: Float[Array, "parameters"]
    u: Float[Array, ""]


class AdaptiveObserver(Baseline):
    """Outputs (rate, state) of one input and one state; always fed the measured state."""

    weights: Weights
    scaling: Scaling
    gains: Gains
    dt: float = eqx.field(static=True)

    def every(self, dt: float) -> "AdaptiveObserver":
        """The same model for samples `dt` [s] apart."""
        return replace(self, dt=dt)

    def begin(self, u: Float[Array, "1"], y: Float[Array, "2"]) -> Running:
        x = self.scaling.back(y)[1]
        return Running(x, ravel_pytree(self.weights)[0], self._input(u))

    def step(
        self, carry: Running, u: Float[Array, "1"], y: Float[Array, "2"]
    ) -> tuple[Running, Float[Array, "2"]]:
        """Corrected by the state of the sample before, then predicted to this one."""
        now, gains = self._input(u), self.gains
        e = self.scaling.back(y)[1] - carry.x
        f, slope = jax.value_and_grad(self._network)(carry.theta, carry.x, carry.u)
        x = carry.x + self.dt * (carry.u + f + gains.l * e)
        learning = gains.eta * e * slope - gains.rho * jnp.abs(e) * carry.theta
        theta = carry.theta + self.dt * learning
        rate = now + self._network(theta, x, now)
        return Running(x, theta, now), self.scaling.y(jnp.stack([rate, x]))

    def _input(self, u: Float[Array, "1"]) -> Float[Array, ""]:
        return u[0] * self.scaling.u_scale[0] + self.scaling.u_center[0]

    def _network(self, theta: Array, x: Array, u: Array) -> Float[Array, ""]:
        """In units of the rate."""
        w = ravel_pytree(self.weights)[1](theta)
        state = (x - self.scaling.y_center[1]) / self.scaling.y_scale[1]
        scaled = jnp.stack([state, self.scaling.u(u[None])[0]])
        hidden = jnp.tanh(w["weights_in"] @ scaled + w["bias"])
        return self.scaling.y_scale[0] * (w["weights_out"] @ hidden + w["bias_out"])


def adaptive_observer(
    scaling: Scaling, hidden: int, gains: Gains, dt: float, rng: np.random.Generator
) -> AdaptiveObserver:
    return AdaptiveObserver(layers(hidden, 2, rng), scaling, gains, dt)


@eqx.filter_jit
def learn_online(model: AdaptiveObserver, record: Record, passes: int) -> AdaptiveObserver:
    """The observer after `passes` runs beside a healthy record (samples, signals)."""
    u, y = model.scaling.u(jnp.asarray(record.u)), model.scaling.y(jnp.asarray(record.y))

    def one_pass(_: Array, theta: Array) -> Array:
        carry = model.begin(u[0], y[0])._replace(theta=theta)
        return jax.lax.scan(lambda c, s: model.step(c, *s), carry, (u[1:], y[:-1]))[0].theta

    theta, unravel = ravel_pytree(model.weights)
    learned = jax.lax.fori_loop(0, passes, one_pass, theta)
    return eqx.tree_at(lambda m: m.weights, model, unravel(learned))
