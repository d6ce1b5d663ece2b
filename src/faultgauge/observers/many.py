"""One observer beside thousands of units: many samples of many units in one call."""

import os
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.observers.observer import Observer, ObserverInfo, ObserverState
from faultgauge.simulation.side_by_side import rows, side_by_side, whole

__all__ = ["begin_many", "observe_many"]

CACHED = 64  # units at once on a processor: what a step needs then stays in its nearest cache


def begin_many(
    observer: Observer, x: Float[np.ndarray, "states units"], u: Float[np.ndarray, "inputs units"]
) -> ObserverState:
    """`observer.init` of every unit, units last."""
    state = jax.vmap(observer.init, in_axes=-1, out_axes=-1)(jnp.asarray(x), jnp.asarray(u))
    return jax.device_get(state)


def observe_many(
    observer: Observer,
    state: ObserverState,
    u: Float[np.ndarray, "samples inputs units"],
    y: Float[np.ndarray, "samples outputs units"],
    dt: Float[np.ndarray, "samples"],
    together: int | None = None,
) -> tuple[ObserverState, ObserverInfo]:
    """`observer.step` along some samples of many units: (state after them, what it told at each).

    All arrays have the units last, those that come back too. `dt[k]` [s] leads to sample k, in all
    units. On a processor `together` units at once go through the samples, on each of its cores that
    this process may use; no bit of a unit hangs on who is beside it, so one alone is told what it
    is told among thousands. On an accelerator all go at once.
    """
    units, cpu = u.shape[-1], jax.devices()[0].platform == "cpu"
    workers = len(os.sched_getaffinity(0)) if cpu else 1
    together = together or (CACHED if cpu else units)
    # shares of whole groups, all of one size: one program, and never a rest that is reckoned apart
    share = -(-units // (workers * together)) * together
    parts = range(0, units, share)

    def observed(first: int) -> tuple[ObserverState, ObserverInfo]:
        def mine(a: np.ndarray) -> np.ndarray:
            own = np.asarray(a)[..., first : first + share]
            lacking = [(0, 0)] * (own.ndim - 1) + [(0, share - own.shape[-1])]
            return np.pad(own, lacking, mode="edge") if own.shape[-1] < share else own

        given = jax.tree.map(mine, (state, u, y))
        return jax.device_get(_in_groups(observer, *given, dt, together))

    with ThreadPoolExecutor(workers) as pool:
        found = list(pool.map(observed, parts)) if len(parts) > 1 else [*map(observed, parts)]
    return jax.tree.map(lambda *each: np.concatenate(each, axis=-1)[..., :units], *found)


@eqx.filter_jit
def _in_groups(
    observer: Observer,
    state: ObserverState,
    u: Float[Array, "samples inputs units"],
    y: Float[Array, "samples outputs units"],
    dt: Float[Array, "samples"],
    together: int,
) -> tuple[ObserverState, ObserverInfo]:
    """Group after group along all samples."""

    def split(a: Array) -> Array:
        return jnp.moveaxis(a.reshape(*a.shape[:-1], -1, together), -2, 0)

    def join(a: Array) -> Array:
        return jnp.moveaxis(a, 0, -2).reshape(*a.shape[1:-1], -1)

    def group(given: tuple) -> tuple:
        state, u, y = given

        def sample(state: ObserverState, now: tuple) -> tuple:
            u, y, dt = now
            after, info = side_by_side(lambda *a: observer.step(*a, dt), state, *rows((u, y)))
            return after, whole(info)

        after, info = jax.lax.scan(sample, rows(state), (u, y, dt))
        return whole(after), info

    if u.shape[-1] == together:
        return group((state, u, y))
    return jax.tree.map(join, jax.lax.map(group, jax.tree.map(split, (state, u, y))))
