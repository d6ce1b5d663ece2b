"""10,000 wheels monitored by IESONN: an extended state observer over two 2-10-1 tanh networks.

    python benchmarks/monitor.py [--units N] [--together N]

Ours is the product's observer, step and all, of many units in one call of 100 samples; beside it
a tight C loop on the same numbers, in one thread, and `jax.vmap` of the same step.
"""

import argparse
import ctypes
import os
import platform
import time
from collections.abc import Callable

from faultgauge.settings import COMPILER

os.environ.setdefault("XLA_FLAGS", COMPILER)  # before JAX is loaded

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from compiled import compiled, pointer
from faultgauge.observers.eso import ExtendedStateObserver
from faultgauge.observers.many import begin_many, observe_many
from faultgauge.observers.observer import ObserverState
from faultgauge.plants.gray_box import load_plant
from faultgauge.plants.network import Network
from interleave import Times, interleaved

__all__ = ["compete"]

UNITS, SAMPLES, STEP, HIDDEN = 10_000, 100, 0.25, 10
REACH = 100.0  # of the networks' arguments, beyond which they count as the edge
GAIN = (0.3, 0.05)  # of momentum and fault; 1/s


def network(rng: np.random.Generator) -> np.ndarray:
    """Weights in, bias, weights out and bias; a wheel that comes to rest by itself."""
    inner = np.stack([-rng.uniform(0.1, 0.5, HIDDEN), rng.uniform(0.1, 0.5, HIDDEN)], axis=1)
    bias, outer = 0.1 * rng.standard_normal(HIDDEN), rng.uniform(0.0, 0.2, HIDDEN)
    return np.concatenate([inner.ravel(), bias, outer, [0.0]])


def network_of(theta: np.ndarray) -> Network:
    W, b, v, c = np.split(theta, [20, 30, 40])
    return Network(
        weights_out=jnp.asarray(v),
        weights_in=jnp.asarray(REACH * W.reshape(HIDDEN, 2)),
        bias=jnp.asarray(b),
        bias_out=jnp.asarray(c[0]),
        input_center=jnp.zeros(2),
        input_scale=jnp.full(2, REACH),
        output_center=jnp.zeros(()),
        output_scale=jnp.ones(()),
    )


def observer_of(nn1: np.ndarray, nn2: np.ndarray) -> ExtendedStateObserver:
    plant = load_plant("reaction_wheel_network")
    networks = {"NN1": network_of(nn1), "NN2": network_of(nn2)}
    plant = eqx.tree_at(lambda p: p.networks, plant, networks)
    gain_x, gain_f = jnp.array([[0.0, GAIN[0]]]), jnp.array([0.0, GAIN[1]])
    return ExtendedStateObserver(plant, 0, 1, gain_x, gain_f, 1.0, jnp.asarray(1.0))


class Work:
    """The same samples for all."""

    def __init__(self, units: int) -> None:
        rng = np.random.default_rng(0)
        self.units = -(-units // 64) * 64  # the C loop's blocks
        self.nn1, self.nn2 = network(rng), network(rng)
        self.observer = observer_of(self.nn1, self.nn2)
        self.u = rng.uniform(-0.8, 0.8, (SAMPLES, 1, self.units))
        self.y = rng.uniform(-1, 1, (SAMPLES, 2, self.units))
        self.x = rng.uniform(-1, 1, (1, self.units))
        self.dt = np.full(SAMPLES, STEP)

    @property
    def state(self) -> ObserverState:
        return begin_many(self.observer, self.x, self.u[0])

    def ours(self, together: int | None = None) -> Callable[[], int]:
        state = self.state

        def work() -> int:
            self.said = observe_many(
                self.observer, state, self.u, self.y, self.dt, together=together
            )[1]
            return self.u.size

        return work

    def vmap(self) -> Callable[[], int]:
        @eqx.filter_jit
        def along(
            observer: ExtendedStateObserver, state: ObserverState, u: jax.Array, y: jax.Array
        ) -> tuple[jax.Array, ...]:
            def sample(state: ObserverState, now: tuple) -> tuple:
                after, info = jax.vmap(lambda *a: observer.step(*a, jnp.asarray(STEP)))(state, *now)
                return after, (info.f, info.innovation)

            return jax.lax.scan(sample, state, (u, y))[1]

        state = jax.tree.map(lambda a: np.moveaxis(a, -1, 0), self.state)
        given = [np.moveaxis(a, -1, 1) for a in (self.u, self.y)]

        def work() -> int:
            jax.device_get(along(self.observer, state, *given))
            return self.u.size

        return work

    def c_loop(self) -> Callable[[], int]:
        library = compiled("monitor")
        u, T, hm = (np.ascontiguousarray(a) for a in (self.u[:, 0], self.y[:, 0], self.y[:, 1]))
        told = [np.zeros_like(u) for _ in range(3)]
        constants = [pointer(a) for a in (self.nn1, self.nn2, np.array(GAIN))]

        def work() -> int:
            own = [self.x[0].copy(), np.zeros(self.units), self.u[0, 0].copy()]
            samples = [pointer(a) for a in (u, hm, T, *own, *told)]
            library.monitor(self.units, SAMPLES, ctypes.c_double(STEP), *constants, *samples)
            return u.size

        self.ours()()
        work()
        # the same estimates, so that the C timed is the work meant; -ffast-math reorders sums
        innovation = self.said["innovation"]
        for a, b in zip(told, (self.said["f"], innovation[:, 1], innovation[:, 0]), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9)
        return work


def compete(rounds: int) -> tuple[Times, dict[str, str]]:
    """Seconds per unit and sample; ours on all cores, C on one."""
    work = Work(UNITS)
    return interleaved(
        {
            "faultgauge": work.ours(),
            "C": work.c_loop(),
            "jax.vmap of the same step": work.vmap(),
        },
        rounds,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--units", type=int, default=UNITS)
    parser.add_argument("--together", type=int)
    arguments = parser.parse_args()
    work = Work(arguments.units)
    ours, c_loop = work.ours(arguments.together), work.c_loop()
    ours()
    seconds, busy, by_c = [], [], []
    for _ in range(9):
        start, began = time.perf_counter(), time.process_time()
        units = ours()
        seconds.append((time.perf_counter() - start) / units)
        busy.append((time.process_time() - began) / units)
        began = time.process_time()
        units = c_loop()
        by_c.append((time.process_time() - began) / units)
    device = jax.devices()[0]
    print(
        f"{work.units:,} units, {SAMPLES} samples a call: {1e9 * np.median(seconds):.2f} ns "
        f"({1e9 * min(seconds):.2f} to {1e9 * max(seconds):.2f}) a unit-step, "
        f"{1e-6 / np.median(seconds):.1f} M/s; {device.device_kind}, {device.platform}, "
        f"{len(os.sched_getaffinity(0))} cores, {platform.machine()}"
    )
    print(
        f"of the processor {1e9 * min(busy):.0f} ns at the best, the C loop {1e9 * min(by_c):.0f}"
    )


if __name__ == "__main__":
    main()
