"""Many flights of the paper's satellite at once, and the residual of each of their wheels."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant, Stuck
from faultgauge.plants.signals import Fault
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.satellite.loop import (
    NOISES,
    Now,
    Satellite,
    SatelliteState,
    Telemetry,
    fly,
)
from faultgauge.simulation.satellite.observatory import (
    AXES,
    PERIOD,
    STEPS_PER_PERIOD,
    Three,
    paper_satellite,
    paper_start,
)
from faultgauge.simulation.schedules import Constant, Schedule, grid

__all__ = ["Plan", "flights", "one_wheel", "reference_torque", "residuals"]


class Plan(NamedTuple):
    """A flight to fly: its start (deg, N*m*s), its noise, and the faults in its wheels."""

    angles: Three
    momenta: Three
    noise: int
    faults: dict[str, Constant]


def flights(
    wheel: GrayBoxPlant, inner: Sequence[Schedule], plans: Sequence[Plan], seconds: float
) -> Telemetry:
    """`observatory.run` for many flights at once, flights first; friction faults and f(t) only."""
    steps = round(seconds / PERIOD)
    fault = Fault("friction", "state", wheel.signals.state_names[0])
    satellite = paper_satellite(with_faults(wheel, (fault,)))
    times = grid(steps, PERIOD, STEPS_PER_PERIOD)
    everywhere = sum((each.profile.sizes(times) for each in inner), np.zeros(times.shape))
    f = np.stack([_friction(plan, everywhere, times) for plan in plans])
    noise = np.stack(
        [np.random.default_rng([p.noise, 1]).standard_normal((steps, NOISES)) for p in plans]
    )
    starts = [paper_start(satellite, plan.angles, plan.momenta) for plan in plans]
    begin = jax.tree.map(lambda *each: jnp.stack(each), *starts)
    return jax.device_get(_fly(satellite, begin, jnp.asarray(noise), jnp.asarray(f)))


def _friction(
    plan: Plan,
    everywhere: Float[np.ndarray, "steps substeps"],
    times: Float[np.ndarray, "steps substeps"],
) -> Float[np.ndarray, "steps substeps wheels 1"]:
    """f(t) and the fault of every wheel, N*m."""
    none = Constant(0.0)
    sizes = [everywhere + plan.faults.get(axis, none).sizes(times) for axis in AXES]
    return np.stack(sizes, axis=-1)[..., None]


@eqx.filter_jit
def _fly(
    satellite: Satellite,
    begin: SatelliteState,
    noise: Float[Array, "flights steps noises"],
    f: Float[Array, "flights steps substeps wheels 1"],
) -> Telemetry:
    signals = satellite.wheel.signals
    counts = (len(signals.states), len(signals.inputs), len(signals.outputs))
    free = Stuck(*(jnp.full((*f.shape[1:-1], n), jnp.nan) for n in counts))

    def one(state: SatelliteState, noise: Array, f: Array) -> Telemetry:
        return fly(satellite, state, Now(noise, f, free))[1]

    return jax.vmap(one)(begin, noise, f)


def one_wheel(flown: Telemetry, axis: str) -> Telemetry:
    """The flight as if every wheel were that of `axis`: for what looks at the pitch wheel."""
    k = [AXES.index(axis)] * len(AXES)
    return flown._replace(u=flown.u[:, k], torque=flown.torque[:, k], momentum=flown.momentum[:, k])


def residuals(plant: Plant, flown: Telemetry) -> Float[np.ndarray, "flights samples wheels"]:
    """r = T - That [N*m] of every wheel, each beside the reference on its own h and u."""
    seen = reference_torque(plant, jnp.asarray(flown.momentum), jnp.asarray(flown.u))
    return np.asarray(flown.torque) - np.asarray(seen)


@eqx.filter_jit
def reference_torque(
    plant: Plant, h: Float[Array, "*points"], u: Float[Array, "*points"]
) -> Float[Array, "*points"]:
    """That [N*m] of the reference at measured momenta [N*m*s] and commands [N*m]."""

    def one(h: Array, u: Array) -> Array:
        x, given = h[None], u[None]
        return plant.output(plant.derivative(x, given), x, given)[0]

    return jax.vmap(one)(h.ravel(), u.ravel()).reshape(h.shape)
