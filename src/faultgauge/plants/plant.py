"""The one protocol: dx = F(x, u), y = h(dx, x, u)."""

import abc
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.plants.signals import Signals

__all__ = ["Plant", "Stuck", "clip_state", "respond"]

# Every JAX module of faultgauge imports this one. float32 surprises: identification needs 1e-8.
jax.config.update("jax_enable_x64", True)
# A program runs in the thread that calls it; else two of them wait for each other's threads.
jax.config.update("jax_cpu_enable_async_dispatch", False)


class Plant(eqx.Module):
    """A plant of the form (paper, eq 1)

        dx = F(x, u),    y = h(dx, x)        (h may also read u)

    Bodies are physics written by hand, a plant file, or the same file after fitting. Everything
    downstream takes a `Plant` and cannot tell which it got.
    """

    signals: eqx.AbstractVar[Signals]

    @abc.abstractmethod
    def derivative(
        self, x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Float[Array, "states"]:
        """F(x, u): each state's unit per second; `u` is what the actuator applies."""

    @abc.abstractmethod
    def output(
        self,
        dx: Float[Array, "states"],
        x: Float[Array, "states"],
        u: Float[Array, "inputs"],
    ) -> Float[Array, "outputs"]:
        """h(dx, x, u): each output in its own unit."""


class Stuck(NamedTuple):
    """Channels that hold a value whatever happens: what each is stuck at, NaN where it is free."""

    dx: Float[Array | np.ndarray, "*grid states"]
    u: Float[Array | np.ndarray, "*grid inputs"]
    y: Float[Array | np.ndarray, "*grid outputs"]


def respond(
    plant: Plant,
    x: Float[Array, "states"],
    u: Float[Array, "inputs"],
    f: Float[Array, "faults"] | None = None,
    stuck: Stuck | None = None,
) -> tuple[Float[Array, "states"], Float[Array, "outputs"]]:
    """(dx, y) of the plant under command `u` with fault sizes `f` (None: healthy).

    u  <-  clip((1 - f_gain) u + f_input, min, max)
    dx  =  F(x, u) + f_state
    y   =  h(dx, x, u) + f_output

    each overwritten where it is `stuck`.
    """
    signals = plant.signals
    extra_x, extra_y = jnp.zeros(len(signals.states)), jnp.zeros(len(signals.outputs))
    extra_u, gain = jnp.zeros(len(signals.inputs)), jnp.ones(len(signals.inputs))
    if f is not None:
        for size, fault in zip(f, signals.faults, strict=True):
            match fault.enters:
                case "state":
                    extra_x = extra_x.at[signals.state_names.index(fault.target)].add(size)
                case "output":
                    extra_y = extra_y.at[signals.output_names.index(fault.target)].add(size)
                case "input":
                    extra_u = extra_u.at[signals.input_names.index(fault.target)].add(size)
                case "gain":
                    gain = gain.at[signals.input_names.index(fault.target)].multiply(1.0 - size)
    lower = jnp.array([each.min for each in signals.inputs])
    upper = jnp.array([each.max for each in signals.inputs])
    u = jnp.clip(gain * u + extra_u, lower, upper)
    if stuck is None:
        dx = plant.derivative(x, u) + extra_x
        return dx, plant.output(dx, x, u) + extra_y
    u = _overwritten(u, stuck.u)
    dx = _overwritten(plant.derivative(x, u) + extra_x, stuck.dx)
    return dx, _overwritten(plant.output(dx, x, u) + extra_y, stuck.y)


def _overwritten(
    value: Float[Array, "n"], stuck: Float[Array | np.ndarray, "n"]
) -> Float[Array, "n"]:
    return jnp.where(jnp.isnan(stuck), value, stuck)


def clip_state(plant: Plant, x: Float[Array, "states"]) -> Float[Array, "states"]:
    """`x` inside the limits that the plant declares for its states."""
    lower = jnp.array([state.min for state in plant.signals.states])
    upper = jnp.array([state.max for state in plant.signals.states])
    return jnp.clip(x, lower, upper)
