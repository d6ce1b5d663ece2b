"""Many flights at once, each drawn from its seed: dispersed, with or without a fault, summarised.

A flight's noise and its case are functions of its seed and the step alone (a counter-based
generator), so what comes out of seed 7 hangs neither on how many fly beside it nor in which order
nor on which device. Nothing of a flight is kept but what `Flown` says: the sums run along in the
scan, and memory does not grow with the duration, nor with the count beyond the figures themselves.
"""

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt32

from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant, Stuck, respond
from faultgauge.plants.signals import Entry, Fault
from faultgauge.simulation.closed_loop import with_faults
from faultgauge.simulation.satellite import rotations
from faultgauge.simulation.satellite.counted import normal, uniform
from faultgauge.simulation.satellite.loop import NOISES, Now, Satellite, SatelliteState, start, step
from faultgauge.simulation.satellite.observatory import KNOWN_TO, MOMENTA, SLEW
from faultgauge.simulation.side_by_side import cores, rows, side_by_side, whole

__all__ = ["Chance", "Flown", "Spread", "flights"]

CACHED = 64  # flights at once on a processor: what a step carries then stays in its cache
BYTES = 16_384  # of an accelerator's memory for one flight, what a step needs in between included
CASE = np.uint32(2**32 - 1)  # place of a flight's case among its draws; steps begin at 0

Real = float | Array


class Spread(NamedTuple):
    """How far flights are apart, one standard deviation each (normal; shares log-normal)."""

    angles: Real = 0.0  # deg, of the attitude at the start, about each axis
    momenta: Real = 0.0  # N*m*s, of each wheel at the start
    inertia: Real = 0.0  # share, about each axis; the controller keeps the nominal one
    disturbance: Real = 0.0  # share of each torque from outside
    constants: Real = 0.0  # share of each free constant of each wheel


NOTHING = Spread()


@dataclass(frozen=True)
class Chance:
    """A fault that a flight may have, as likely as any other: one wheel, which is as likely as any
    other, has it from an onset on, with a size that is uniform between `low` and `high`."""

    enters: Entry
    target: str
    low: float
    high: float
    relative: bool = False


class Flown(NamedTuple):
    """What is kept of every flight. A residual is the torque output less that of the nominal wheel
    at the momentum and the command of the wheel; without a fault all of a flight is before."""

    seed: Int[np.ndarray, "flights"]
    fault: Int[np.ndarray, "flights"]  # place in the chances, -1: none
    wheel: Int[np.ndarray, "flights"]
    size: Float[np.ndarray, "flights"]  # the fault's own unit
    onset: Float[np.ndarray, "flights"]  # s
    pointing_peak: Float[np.ndarray, "flights"]  # rad, from when the slew is over
    pointing_rms: Float[np.ndarray, "flights"]  # rad, likewise
    knowledge_rms: Float[np.ndarray, "flights"]  # rad: of the estimated attitude, likewise
    momentum_peak: Float[np.ndarray, "flights wheels"]  # N*m*s, of all the flight
    residual_before: Float[np.ndarray, "flights wheels"]  # N*m, RMS before the onset
    residual_after: Float[np.ndarray, "flights wheels"]  # N*m, RMS from it on
    shift_after: Float[np.ndarray, "flights wheels"]  # N*m, the residual's mean from it on


class _Case(NamedTuple):
    """What a seed says of its flight."""

    angles: Array
    momenta: Array
    inertia: Array
    disturbance: Array
    constants: dict[str, Array]
    fault: Array
    wheel: Array
    size: Array
    onset: Array


class _Sums(NamedTuple):
    """What runs along."""

    peak: Array
    pointing: Array
    knowledge: Array
    momentum: Array
    before: Array
    after: Array
    shift: Array
    rows: Array  # from the onset on


class _Plan(NamedTuple):
    """What flights are drawn from and flown with."""

    satellite: Satellite  # whose wheel is open to the chances
    reference: Plant  # the nominal wheel
    spread: Spread
    low: Array
    high: Array
    angles: Array
    momenta: Array
    settled: Array
    seconds: Array


def flights(
    satellite: Satellite,
    count: int,
    seconds: float,
    *,
    spread: Spread = NOTHING,
    chances: Sequence[Chance] = (),
    angles: Sequence[float] = SLEW,
    momenta: Sequence[float] = MOMENTA,
    settled: float = 400.0,
    first: int = 0,
    together: int | None = None,
    single: bool = False,
    apart: bool | None = None,
) -> Flown:
    """Fly the `satellite` for `seconds` with the seeds `first` to `first + count - 1`.

    `angles` [deg] and `momenta` [N*m*s] are what starts scatter about; `settled` [s] is when the
    slew is over: pointing counts from there, and faults begin between it and the end. A share
    1/(1 + chances) of flights has no fault. `together` fly at once, by default as many as suit the
    device: the cache of a processor, all of whose cores that this process may use take their turn,
    or the memory of an accelerator. On a processor no bit hangs on it. `single` reckons in float32.
    `apart` keeps a row for each number of a flight (`side_by_side`), as is best on a processor, in
    place of JAX's `vmap`. Raises `ValueError` where nothing is to fly, or no fault can begin.
    """
    if count < 1 or not 0 <= settled < seconds:
        raise ValueError(f"flights: count = {count}, settled = {settled:g} s of {seconds:g} s")
    device = jax.devices()[0]
    together = together or _suited(device, count)
    apart = device.platform == "cpu" if apart is None else apart
    steps = round(seconds / satellite.dt)
    plan = _plan(satellite, spread, chances, angles, momenta, (settled, seconds))
    if single:
        plan = jax.tree.map(lambda a: a.astype("float32") if eqx.is_inexact_array(a) else a, plan)

    def fly(begin: int, steps: int = steps) -> tuple[_Case, _Sums]:
        # of this thread; a GPU multiplies matrices of float32 by 10 bits unless it is told not to
        with jax.enable_x64(not single), jax.default_matmul_precision("highest"):
            seeds = jnp.asarray(np.arange(begin, begin + together, dtype=np.uint32))
            return jax.device_get(_together(plan, seeds, jnp.asarray(steps), apart))

    fly(first, 0)  # it compiles, once
    with ThreadPoolExecutor(_workers(device)) as workers:
        # of the last chunk too many fly, so that all are one program
        parts = list(workers.map(fly, range(first, first + count, together)))
    case, sums = jax.tree.map(lambda *each: np.concatenate(each, axis=-1)[..., :count], *parts)
    return _told(np.arange(first, first + count), case, sums, steps, satellite.dt, settled)


def _suited(device: Any, count: int) -> int:
    """How many fly at once."""
    if device.platform == "cpu":
        return CACHED
    free = (device.memory_stats() or {}).get("bytes_limit", 0) // 2
    return min(-(-count // CACHED) * CACHED, max(1, free // (BYTES * CACHED)) * CACHED)


def _workers(device: Any) -> int:
    """Threads: one drives an accelerator."""
    return cores() if device.platform == "cpu" else 1


def _plan(
    satellite: Satellite,
    spread: Spread,
    chances: Sequence[Chance],
    angles: Sequence[float],
    momenta: Sequence[float],
    times: tuple[float, float],
) -> _Plan:
    wheel = cast(GrayBoxPlant, satellite.wheel)
    faults = tuple(
        Fault(f"chance {k}", each.enters, each.target, relative=each.relative)
        for k, each in enumerate(chances)
    )
    return _Plan(
        dataclasses.replace(satellite, wheel=with_faults(wheel, faults), stacked=True),
        with_faults(wheel, ()),
        Spread(*map(jnp.asarray, map(float, spread))),
        jnp.array([each.low for each in chances], float),
        jnp.array([each.high for each in chances], float),
        jnp.deg2rad(jnp.array(angles, float)),
        jnp.array(momenta, float),
        *map(jnp.asarray, map(float, times)),
    )


@eqx.filter_jit
def _together(
    plan: _Plan, seeds: UInt32[Array, "flights"], steps: Int[Array, ""], apart: bool
) -> tuple[_Case, _Sums]:
    """All of some seeds, flights last: neighbours in memory are the same number of two flights."""
    split, every, join = (rows, side_by_side, whole) if apart else (_same, _vmapped, _same)
    cases = jax.vmap(lambda seed: _drawn(plan, seed), out_axes=-1)(seeds)
    own = split((seeds, cases))

    def advance(k: Array, carried: tuple[SatelliteState, _Sums]) -> tuple:
        def one(seed: Array, case: _Case, state: SatelliteState, sums: _Sums) -> tuple:
            return _advanced(plan, seed, case, state._replace(step=k), sums)

        return every(one, *own, *carried)

    carried = every(lambda case: _begun(plan, case), own[1])
    told = cases._replace(angles=(), momenta=(), inertia=(), disturbance=(), constants={})
    return told, join(jax.lax.fori_loop(0, steps, advance, carried)[1])


def _same(tree: Any) -> Any:
    return tree


def _vmapped(function: Callable, *args: Any) -> Any:
    return jax.vmap(function, in_axes=-1, out_axes=-1)(*args)


def _begun(plan: _Plan, case: _Case) -> tuple[SatelliteState, _Sums]:
    """A flight's start; its steps are counted for all together."""
    satellite = _dispersed(plan.satellite, case)
    error = jnp.deg2rad(jnp.array(KNOWN_TO))
    state = start(satellite, case.angles, case.momenta, error)
    one, each = jnp.zeros(()), jnp.zeros(len(case.momenta))
    return state._replace(step=()), _Sums(one, one, one, each, each, each, each, one)


def _drawn(plan: _Plan, seed: Array) -> _Case:
    """What a seed says of its flight."""
    wheels, spread = len(plan.momenta), plan.spread
    free = [p for p in plan.reference.constants if not p.fixed]
    counts = (3, wheels, 3, 6, *(wheels for _ in free))
    drawn = normal(seed, CASE, sum(counts))
    angles, momenta, inertia, outside, *constants = jnp.split(drawn, np.cumsum(counts)[:-1])
    values = plan.reference.values()
    which, wheel, size, onset = uniform(seed, CASE - np.uint32(1), 4)
    kinds = len(plan.low)
    fault = jnp.floor(which * (kinds + 1)).astype(int) - 1
    low, high = (jnp.concatenate([a, jnp.zeros(1)])[fault] for a in (plan.low, plan.high))
    return _Case(
        angles=plan.angles + jnp.deg2rad(spread.angles) * angles,
        momenta=plan.momenta + spread.momenta * momenta,
        inertia=plan.satellite.inertia * jnp.exp(spread.inertia * inertia),
        disturbance=plan.satellite.disturbance
        * jnp.exp(spread.disturbance * outside.reshape(2, 3)),
        constants={
            p.name: jnp.clip(values[p.name] * jnp.exp(spread.constants * each), p.min, p.max)
            for p, each in zip(free, constants, strict=True)
        },
        fault=fault,
        wheel=jnp.where(fault < 0, -1, jnp.floor(wheel * wheels).astype(int)),
        size=low + (high - low) * size,
        onset=plan.settled + (plan.seconds - plan.settled) * onset,
    )


def _dispersed(satellite: Satellite, case: _Case) -> Satellite:
    """Each wheel with numbers of its own."""
    own = eqx.filter_vmap(satellite.wheel.with_constants, axis_size=len(case.momenta))
    return dataclasses.replace(
        satellite,
        inertia=case.inertia,
        disturbance=case.disturbance,
        wheel=own(case.constants),
    )


def _advanced(
    plan: _Plan, seed: Array, case: _Case, state: SatelliteState, sums: _Sums
) -> tuple[SatelliteState, _Sums]:
    """One control period of one flight."""
    satellite, wheels = _dispersed(plan.satellite, case), len(plan.momenta)
    t = state.step * satellite.dt
    inner = t + satellite.dt / satellite.substeps * jnp.arange(satellite.substeps)
    mine = (jnp.arange(wheels) == case.wheel)[:, None] & (jnp.arange(len(plan.low)) == case.fault)
    acts = (inner >= case.onset)[:, None, None] & mine
    signals = satellite.wheel.signals
    counts = (len(signals.states), len(signals.inputs), len(signals.outputs))
    free = Stuck(*(jnp.full((satellite.substeps, wheels, n), jnp.nan) for n in counts))
    noises = NOISES + (0 if satellite.policy is None else wheels)
    now = Now(normal(seed, state.step, noises), jnp.where(acts, case.size, 0.0), free)
    after, flown = step(satellite, state, now)
    target = rotations.conjugate(satellite.orbit.frame(t))
    pointing = rotations.angle(rotations.product(target, state.q))
    known = rotations.angle(rotations.product(rotations.conjugate(state.q), after.estimate.q))
    r = flown.torque - jax.vmap(lambda h, u: _healthy_torque(plan.reference, h, u))(
        flown.momentum, flown.u
    )
    held, on = t >= plan.settled, t >= case.onset
    return after._replace(step=()), _Sums(
        peak=jnp.maximum(sums.peak, jnp.where(held, pointing, 0.0)),
        pointing=sums.pointing + jnp.where(held, pointing**2, 0.0),
        knowledge=sums.knowledge + jnp.where(held, known**2, 0.0),
        momentum=jnp.maximum(sums.momentum, jnp.abs(flown.momentum)),
        before=sums.before + jnp.where(on, 0.0, r**2),
        after=sums.after + jnp.where(on, r**2, 0.0),
        shift=sums.shift + jnp.where(on, r, 0.0),
        rows=sums.rows + on,
    )


def _healthy_torque(wheel: Plant, h: Array, u: Array) -> Array:
    return respond(wheel, h[None], u[None])[1][0]


def _told(seeds: np.ndarray, case: Any, sums: Any, steps: int, dt: float, settled: float) -> Flown:
    """Sums as means and roots of means; flights first."""
    held = np.count_nonzero(dt * np.arange(steps) >= settled)
    with np.errstate(divide="ignore", invalid="ignore"):  # of no rows: no number
        return Flown(
            seed=seeds,
            fault=case.fault,
            wheel=case.wheel,
            size=case.size,
            onset=np.where(case.fault < 0, np.nan, case.onset),
            pointing_peak=sums.peak,
            pointing_rms=np.sqrt(sums.pointing / held),
            knowledge_rms=np.sqrt(sums.knowledge / held),
            momentum_peak=sums.momentum.T,
            residual_before=np.sqrt(sums.before / (steps - sums.rows)).T,
            residual_after=np.sqrt(sums.after / sums.rows).T,
            shift_after=(sums.shift / sums.rows).T,
        )
