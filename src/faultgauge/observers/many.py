"""One observer beside thousands of units: many samples of many units in one call."""

from concurrent.futures import ThreadPoolExecutor
from threading import Lock
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from faultgauge.observers.observer import Observer, ObserverState
from faultgauge.simulation.side_by_side import cores, rows, side_by_side, whole

__all__ = ["begin_many", "observe_many"]

CACHED = 128  # units at once on a processor: what a step needs then stays in its nearest cache


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
    told: tuple[str, ...] = ("f", "innovation"),
    together: int | None = None,
) -> tuple[ObserverState, dict[str, Float[np.ndarray, "samples ..."]]]:
    """`observer.step` along some samples of many units: (state after them, what it told at each,
    of `ObserverInfo` the fields in `told`: memory written is time spent).

    All arrays have the units last, those that come back too. `dt[k]` [s] leads to sample k, in all
    units. On a processor `together` units at once go through the samples, on each of its cores that
    this process may use; no bit of a unit hangs on who is beside it, so one alone is told what it
    is told among thousands. On an accelerator all go at once.
    """
    units, cpu = u.shape[-1], jax.devices()[0].platform == "cpu"
    workers = cores() if cpu else 1
    group = together or (CACHED if cpu else units)
    # shares of whole groups, all of one size, the last over the one before: one program, and never
    # a rest that is reckoned apart
    share = -(-units // (workers * group)) * group
    lacking = max(share - units, 0)
    begin, us, ys = jax.tree.map(lambda a: jnp.asarray(_padded(a, lacking)), (state, u, y))
    firsts = [min(k, units + lacking - share) for k in range(0, units, share)]
    steps, one = jnp.asarray(dt), jnp.ones(())
    done: list[tuple[ObserverState, dict]] = []
    lock = Lock()

    def observed(first: int) -> None:
        at, groups = jnp.asarray(first), share // group
        found = _in_groups(observer, begin, us, ys, steps, one, at, groups, told, group)
        found = jax.device_get(found)
        with lock:
            if not done:
                done.append(jax.tree.map(lambda a: np.empty((*a.shape[:-1], units)), found))

        def put(into: np.ndarray, own: np.ndarray) -> None:
            into[..., first : first + share] = own[..., : units - first]

        jax.tree.map(put, done[0], found)

    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(observed, firsts))
    return done[0]


def _padded(a: np.ndarray, lacking: int) -> np.ndarray:
    return np.pad(a, [(0, 0)] * (a.ndim - 1) + [(0, lacking)]) if lacking else a


@eqx.filter_jit
def _in_groups(
    observer: Observer,
    state: ObserverState,
    u: Float[Array, "samples inputs units"],
    y: Float[Array, "samples outputs units"],
    dt: Float[Array, "samples"],
    one: Float[Array, ""],
    first: Int[Array, ""],
    groups: int,
    told: tuple[str, ...],
    together: int,
) -> tuple[ObserverState, dict[str, Array]]:
    """Group after group, from unit `first` on, along all samples, each row read where it lies."""
    samples, share = len(u), groups * together

    def stepped(*given: Any) -> tuple[ObserverState, dict[str, Array]]:
        state, info = observer.step(*given)
        return state, {name: getattr(info, name) for name in told}

    def group(g: Array, done: tuple[ObserverState, dict]) -> tuple:
        def mine(a: Array) -> Array:
            return jax.lax.dynamic_slice_in_dim(a, first + g * together, together, axis=-1)

        def put(a: Array, own: Array) -> Array:
            return jax.lax.dynamic_update_slice_in_dim(a, own, g * together, axis=-1)

        def sample(k: Array, carried: tuple) -> tuple:
            def now(a: Array) -> Array:
                return jax.lax.dynamic_slice(
                    a, (k, 0, first + g * together), (1, a.shape[1], together)
                )[0]

            def tell(a: Array, own: Array) -> Array:
                place = (k, *(0,) * (a.ndim - 2), g * together)
                return jax.lax.dynamic_update_slice(a, own[None], place)

            state, infos = carried
            after, info = side_by_side(
                lambda *given: stepped(*given, dt[k]), state, *rows((now(u), now(y))), one=one
            )
            return after, jax.tree.map(tell, infos, whole(info))

        ends, infos = done
        after, infos = jax.lax.fori_loop(
            0, samples, sample, (rows(jax.tree.map(mine, state)), infos)
        )
        return jax.tree.map(put, ends, whole(after)), infos

    like = jax.eval_shape(jax.vmap(lambda *a: stepped(*a, dt[0])[1], -1, -1), state, u[0], y[0])
    infos = jax.tree.map(lambda a: jnp.zeros((samples, *a.shape[:-1], share), a.dtype), like)
    ends = jax.tree.map(lambda a: jnp.zeros((*a.shape[:-1], share), a.dtype), state)
    return jax.lax.fori_loop(0, groups, group, (ends, infos))
