"""Any plant under output feedback, with faults inside the loop."""

from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant, Stuck, respond
from faultgauge.plants.signals import Fault, Signals
from faultgauge.programs import program
from faultgauge.simulation.delay_line import Taps, acting, taps
from faultgauge.simulation.integrators import step
from faultgauge.simulation.policy import Policy

__all__ = [
    "Conditions",
    "Controller",
    "Loop",
    "LoopRecord",
    "LoopState",
    "closed_loop",
    "governed_loop",
    "with_faults",
]


class Controller(NamedTuple):
    """u = u_f + K_p (r - y) + z with d(z)/dt = K_i (r - y), one row per input, one column per
    output; zero gains leave the loop open. z does not push an input further beyond its limit, and
    comes back from there as soon as the error turns."""

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


class LoopRecord(NamedTuple):
    """A simulated run at the controller's samples: `u` as commanded inside its limits, the true
    x, dx and y under that u, and `measured` = y with noise (a stuck output shows its value and no
    noise), NaN where no sample came."""

    u: Float[Array, "samples inputs"]
    x: Float[Array, "samples states"]
    dx: Float[Array, "samples states"]
    y: Float[Array, "samples outputs"]
    measured: Float[Array, "samples outputs"]


class LoopState(NamedTuple):
    """What is carried from sample to sample (a checkpoint)."""

    x: Array
    u: Array
    past: Array
    z: Array
    seen: Array
    policy: Any


def with_faults(plant: GrayBoxPlant, faults: tuple[Fault, ...]) -> GrayBoxPlant:
    """`plant` with other faults than its file declares: those that a simulation injects."""
    return replace(plant, signals=replace(plant.signals, faults=faults))


class Loop(eqx.Module):
    """`plant` under `controller`: pure `init` and `step`; samples are `dt` [s] apart.

    At a sample the controller reads y under the input that stood until now, then sets the new
    one, held between the samples. The record holds what the plant does under the new one. An input
    that is not held runs straight to its next feedforward; gains on such an input have no meaning,
    since nobody knows the next command before its sample. A delayed input acts later, to the
    nearest integration step, and stood at its first command before the run. A `policy` turns what
    the controller wants into the command; while that is beyond a limit, z does not push it further.
    """

    plant: Plant
    controller: Controller
    dt: float = eqx.field(static=True)
    substeps: int = eqx.field(static=True)
    policy: Policy | None = None

    @property
    def line(self) -> Taps:
        return taps([each.delay for each in self.plant.signals.inputs], self.dt, self.substeps)

    def init(self, x0: Float[Array, "states"], feedforward: Float[Array, "inputs"]) -> LoopState:
        """Start at state `x0`, the first `feedforward` having stood until now."""
        signals = self.plant.signals
        u0 = jnp.clip(feedforward, *_limits(signals))
        y0 = respond(self.plant, x0, u0, jnp.zeros(len(signals.faults)))[1]
        past = jnp.broadcast_to(u0, (self.line.depth, 2, len(u0)))
        inner = () if self.policy is None else self.policy.init(x0, u0)
        return LoopState(x0, u0, past, jnp.zeros(len(signals.inputs)), y0, inner)

    def step(
        self, state: LoopState, now: Conditions, later: Float[Array, "inputs"]
    ) -> tuple[LoopState, tuple[LoopRecord, Any]]:
        """One sample under the conditions `now` of it; `later` is the next feedforward. The
        policy's info comes beside the record."""
        plant, controller, dt = self.plant, self.controller, self.dt
        lower, upper = _limits(plant.signals)
        moving = jnp.array([each.hold != "zero" for each in plant.signals.inputs], bool)
        first = jax.tree.map(lambda a: a[0], now.stuck)
        noise = jnp.where(jnp.isnan(first.y), now.noise, 0.0)
        before = respond(plant, state.x, state.u, now.f[0], first)[1] + noise
        seen = jnp.where(now.dropped, state.seen, before)
        error = now.reference - seen
        wanted = now.feedforward + controller.kp @ error + state.z
        asked, inner, info = wanted, state.policy, ()
        if self.policy is not None:
            sampled = jnp.where(now.dropped, jnp.nan, before)
            inner, asked, info = self.policy.step(inner, wanted, sampled, jnp.asarray(dt))
        u = jnp.clip(asked, lower, upper)
        more = dt * controller.ki @ error
        winds = ((asked > upper) & (more > 0)) | ((asked < lower) & (more < 0))
        z = state.z + jnp.where(winds, 0.0, more)
        end = jnp.where(moving, jnp.clip(later, lower, upper), u)
        past = jnp.concatenate([jnp.stack([u, end])[None], state.past[:-1]])
        begins, ends = acting(self.line, past)
        dx, y = respond(plant, state.x, begins[0], now.f[0], first)
        measured = jnp.where(now.dropped, jnp.nan, y + noise)

        def advance(x: Array, held: tuple[Array, Array, Array, Stuck]) -> tuple[Array, None]:
            u0, u1, f, stuck = held
            return step(plant, x, u0, u1, f, jnp.asarray(dt / self.substeps), 1, stuck), None

        x = jax.lax.scan(advance, state.x, (begins, ends, now.f, now.stuck))[0]
        record = LoopRecord(u, state.x, dx, y, measured)
        return LoopState(x, ends[-1], past, z, seen, inner), (record, info)


def _limits(signals: Signals) -> tuple[Float[Array, "inputs"], Float[Array, "inputs"]]:
    lower = jnp.array([each.min for each in signals.inputs])
    return lower, jnp.array([each.max for each in signals.inputs])


def closed_loop(
    plant: Plant,
    controller: Controller,
    x0: Float[Array, "states"],
    conditions: Conditions,
    dt: float,
) -> LoopRecord:
    """Run `plant` from `x0` in a `Loop`."""
    return governed_loop(plant, controller, None, x0, conditions, dt)[0]


@program
def governed_loop(
    plant: Plant,
    controller: Controller,
    policy: Policy | None,
    x0: Float[Array, "states"],
    conditions: Conditions,
    dt: float,
) -> tuple[LoopRecord, Any]:
    """(record, info of every sample): `closed_loop` with a `policy` in the loop."""
    loop = Loop(plant, controller, dt, conditions.f.shape[1], policy)
    uf = conditions.feedforward
    following = jnp.concatenate([uf[1:], uf[-1:]])
    start = loop.init(x0, uf[0])
    return jax.lax.scan(lambda s, given: loop.step(s, *given), start, (conditions, following))[1]
