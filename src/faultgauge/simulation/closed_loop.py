"""Any plant under output feedback, with faults inside the loop."""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant, Stuck, respond
from faultgauge.plants.signals import Fault
from faultgauge.simulation.integrators import step

__all__ = ["Conditions", "Controller", "Record", "closed_loop", "with_faults"]


class Controller(NamedTuple):
    """u = u_f + K_p (r - y) + z with d(z)/dt = K_i (r - y), one row per input, one column per
    output; zero gains leave the loop open. z stops where the input is at its limit."""

    kp: Float[Array, "inputs outputs"]
    ki: Float[Array, "inputs outputs"]


class Conditions(NamedTuple):
    """What a run is subjected to. Faults have a value for every integration step."""

    feedforward: Float[Array, "samples inputs"]
    reference: Float[Array, "samples outputs"]
    noise: Float[Array, "samples outputs"]
    f: Float[Array, "samples substeps faults"]
    stuck: Stuck  # arrays (samples, substeps, ...)
    dropped: Bool[Array, "samples outputs"]


class Record(NamedTuple):
    """A simulated run at the controller's samples: `u` as commanded inside its limits, the true
    x, dx and y under that u, and `measured` = y with noise, NaN where no sample came."""

    u: Float[Array, "samples inputs"]
    x: Float[Array, "samples states"]
    dx: Float[Array, "samples states"]
    y: Float[Array, "samples outputs"]
    measured: Float[Array, "samples outputs"]


class _State(NamedTuple):
    x: Array
    u: Array
    z: Array
    seen: Array


def with_faults(plant: GrayBoxPlant, faults: tuple[Fault, ...]) -> GrayBoxPlant:
    """`plant` with other faults than its file declares: those that a simulation injects."""
    return GrayBoxPlant(
        replace(plant.signals, faults=faults), plant.spec, plant.networks, plant.parameters
    )


@eqx.filter_jit
def closed_loop(
    plant: Plant,
    controller: Controller,
    x0: Float[Array, "states"],
    conditions: Conditions,
    dt: float,
) -> Record:
    """Run `plant` from `x0`; samples are `dt` [s] apart, inputs are held between them.

    At a sample the controller reads y under the input that was held until now, then sets the new
    one. The record holds what the plant does under the new one.
    """
    signals = plant.signals
    lower = jnp.array([each.min for each in signals.inputs])
    upper = jnp.array([each.max for each in signals.inputs])
    substeps = conditions.f.shape[1]

    def sample(state: _State, now: Conditions) -> tuple[_State, Record]:
        first = jax.tree.map(lambda a: a[0], now.stuck)
        before = respond(plant, state.x, state.u, now.f[0], first)[1] + now.noise
        seen = jnp.where(now.dropped, state.seen, before)
        error = now.reference - seen
        wanted = now.feedforward + controller.kp @ error + state.z
        u = jnp.clip(wanted, lower, upper)
        z = state.z + jnp.where(u == wanted, dt * controller.ki @ error, 0.0)
        dx, y = respond(plant, state.x, u, now.f[0], first)
        measured = jnp.where(now.dropped, jnp.nan, y + now.noise)

        def advance(x: Array, held: tuple[Array, Stuck]) -> tuple[Array, None]:
            f, stuck = held
            return step(plant, x, u, u, f, jnp.asarray(dt / substeps), 1, stuck), None

        x = jax.lax.scan(advance, state.x, (now.f, now.stuck))[0]
        return _State(x, u, z, seen), Record(u, state.x, dx, y, measured)

    u0 = jnp.clip(conditions.feedforward[0], lower, upper)
    y0 = respond(plant, x0, u0, jnp.zeros(len(signals.faults)))[1]
    start = _State(x0, u0, jnp.zeros(len(signals.inputs)), y0)
    return jax.lax.scan(sample, start, conditions)[1]
