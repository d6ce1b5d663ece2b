"""One wheel observed by IESONN, an extended state observer over two 2-10-1 tanh networks: 10,000
samples in one scan, as printed in C, and a sample a call as a flight computer would have it.
"""

import ctypes
from collections.abc import Callable
from importlib.util import find_spec

import jax.numpy as jnp
import numpy as np

from compiled import compiled, pointer
from faultgauge.export.compile import ExportedStep, print_step
from faultgauge.export.native import FASTER, Native
from faultgauge.observers.observer import ObserverState, observe
from interleave import Absent, Times, interleaved
from monitor import GAIN, STEP, network, observer_of

__all__ = ["compete_calls", "compete_printed", "compete_scan"]

SAMPLES, CALLS, BY_FILTERPY = 10_000, 10_000, 200
NOISE = (1e-4, 1e-6, 1e-2)  # of filterpy's momentum, fault and sensors: variances


class Work:
    """The same samples for all."""

    def __init__(self, samples: int) -> None:
        rng = np.random.default_rng(0)
        self.nn1, self.nn2 = network(rng), network(rng)
        self.observer = observer_of(self.nn1, self.nn2)
        self.u = rng.uniform(-0.8, 0.8, (samples, 1))
        self.y = rng.uniform(-1, 1, (samples, 2))
        self.dt = np.full(samples, STEP)

    def ours(self) -> Callable[[], int]:
        given = [jnp.asarray(a) for a in (np.zeros(1), self.u, self.y, self.dt)]

        def work() -> int:
            self.told = np.asarray(observe(self.observer, *given).f)
            return len(self.u)

        return work

    def c_loop(self) -> Callable[[], int]:
        library, count = compiled("monitor"), len(self.u)
        u, T, hm = (np.ascontiguousarray(a) for a in (self.u[:, 0], *self.y.T))
        told = [np.zeros(count) for _ in range(3)]
        constants = [pointer(a) for a in (self.nn1, self.nn2, np.array(GAIN))]

        def work() -> int:
            state = np.array([0.0, 0.0, u[0]])
            arrays = [pointer(a) for a in (u, hm, T, state, *told)]
            library.observe(count, ctypes.c_double(STEP), *constants, *arrays)
            return count

        work()
        observed = np.asarray(
            observe(self.observer, *map(jnp.asarray, (np.zeros(1), self.u, self.y, self.dt))).f
        )
        # the same estimates, so that the C timed is the work meant; -ffast-math reorders sums
        np.testing.assert_allclose(told[0], observed, rtol=1e-6, atol=1e-9)
        return work

    def printed(self) -> Native:
        """The step as `export` prints it, for this processor, with its own tanh."""

        def observed(state: ObserverState, sample: dict) -> tuple:
            after, said = self.observer.step(state, sample["u"], sample["y"], jnp.asarray(STEP))
            return after, {"x": said.x, "f": said.f}

        start = ObserverState(jnp.zeros(1), jnp.zeros(()), jnp.asarray(self.u[0]))
        step = ExportedStep(observed, start, {"u": jnp.zeros(1), "y": jnp.zeros(2)}, {})
        text = print_step(step, "eso", fast_tanh=True, inline=True)
        return Native(text, [*FASTER, "-march=native"])

    def filterpy(self) -> Callable[[], int] | Absent:
        """Its EKF with the fault as a second state, a sample a call; Jacobians by hand."""
        if not find_spec("filterpy"):
            return Absent("not installed: pip install faultgauge[peers]")
        from filterpy.kalman import ExtendedKalmanFilter

        (W1, b1, v1), (W2, b2, v2) = (
            (n[:20].reshape(10, 2), n[20:30], n[30:40]) for n in (self.nn1, self.nn2)
        )
        known = ExtendedKalmanFilter(dim_x=2, dim_z=2)
        known.Q, known.R = np.diag(NOISE[:2]), NOISE[2] * np.eye(2)

        def rate(x: float, u: float) -> tuple[float, float]:
            z = np.tanh(W1 @ np.array([x, u]) + b1)
            return v1 @ z, (v1 * (1 - z**2)) @ W1[:, 0]

        def work() -> int:
            known.x, known.P, last = np.zeros(2), np.eye(2), self.u[0, 0]
            for u, y in zip(self.u[:BY_FILTERPY, 0], self.y, strict=False):
                slope, by_h = rate(known.x[0], last)
                known.F = np.array([[1 + STEP * by_h, STEP], [0.0, 1.0]])
                known.x = known.x + np.array([STEP * (slope + known.x[1]), 0.0])
                known.P = known.F @ known.P @ known.F.T + known.Q
                last = u

                def outputs(x: np.ndarray, u: float = u) -> np.ndarray:
                    dx = rate(x[0], u)[0] + x[1]
                    return np.array([v2 @ np.tanh(W2 @ np.array([dx, x[0]]) + b2), x[0]])

                def slopes(x: np.ndarray, u: float = u) -> np.ndarray:
                    f, by_h = rate(x[0], u)
                    z = np.tanh(W2 @ np.array([f + x[1], x[0]]) + b2)
                    by = (v2 * (1 - z**2)) @ W2
                    return np.array([[by[0] * by_h + by[1], by[0]], [1.0, 0.0]])

                known.update(y, slopes, outputs)
            return BY_FILTERPY

        return work


def compete_scan(rounds: int) -> tuple[Times, dict[str, str]]:
    """Seconds per sample of 10,000 in one scan."""
    work = Work(SAMPLES)
    return interleaved({"faultgauge": work.ours(), "C": work.c_loop()}, rounds)


def stepped(work: Work, native: Native, together: int) -> Callable[[], int]:
    """The printed step along all samples, `together` in a call; `Native.run` would time NumPy."""
    count = len(work.u)
    given, said = np.zeros(count, native.input), np.zeros(count, native.output)
    given["u"], given["y"] = work.u.reshape(given["u"].shape), work.y
    first, out, state = (a.ctypes.data for a in (given, said, native.state))
    size, told = given.itemsize, said.itemsize
    step = native._library.fg_run
    step.argtypes = [ctypes.c_int64, *(ctypes.c_void_p for _ in range(3))]

    def calls() -> int:
        for k in range(0, count, together):
            step(together, first + k * size, out + k * told, state)
        return min(len(given), len(said))  # which live as long as this function

    calls()
    native.begin()
    return calls


def compete_printed(rounds: int) -> tuple[Times, dict[str, str]]:
    """Seconds per step of the printed C, many in a call."""
    work = Work(SAMPLES)
    with work.printed() as native:
        run = stepped(work, native, SAMPLES)
        return interleaved({"faultgauge": run, "C": work.c_loop()}, rounds)


def compete_calls(rounds: int) -> tuple[Times, dict[str, str]]:
    """Seconds per call of the printed C from Python, one sample each; filterpy's EKF beside."""
    work = Work(CALLS)
    with work.printed() as native:
        calls = stepped(work, native, 1)
        return interleaved({"faultgauge": calls, "filterpy, EKF": work.filterpy()}, rounds)
