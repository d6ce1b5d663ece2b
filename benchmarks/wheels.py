"""A hundred or a thousand wheels fitted, N = 1,000 each, 40 Levenberg-Marquardt trials: ours in
batches of eight against the C loop, wheel after wheel, and SciPy on some of them.
"""

import ctypes
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from compiled import compiled, pointer
from faultgauge.identification.optimise.levenberg_marquardt import Options, levenberg_marquardt
from interleave import Times, interleaved
from lm_trial import data, jacobian, prepared, values

__all__ = ["compete", "compete_many"]

COUNT, TRIALS, TOGETHER = 1000, 40, 8
BY_SCIPY = 4  # wheels: it takes its time


def compete(rounds: int, wheels: int = 100) -> tuple[Times, dict[str, str]]:
    """Seconds per trial."""
    p, y = data(COUNT * wheels)
    each_p, each_y = p.reshape(wheels, COUNT, 2), y.reshape(wheels, COUNT)
    residual, theta, _, start = prepared(each_p[0], each_y[0])
    batch = jax.tree.map(
        lambda *every: jnp.stack(every),
        *(prepared(a, b)[2] for a, b in zip(each_p, each_y, strict=True)),
    )
    starts, free = jnp.asarray(theta)[None], jnp.full(theta.size, jnp.inf)
    options = Options(max_trials=TRIALS, tolerance=0.0)

    @eqx.filter_jit
    def fit_all(batch: object) -> jax.Array:
        def one(samples: object) -> jax.Array:
            found = levenberg_marquardt(residual, starts, samples, None, -free, free, options)
            return found.trials[0] + 1  # the start is evaluated too

        return jax.lax.map(one, batch, batch_size=TOGETHER)

    def ours() -> int:
        return int(np.sum(fit_all(batch)))

    return interleaved(
        {
            "faultgauge": ours,
            "C": c_loop(each_p, each_y, start),
            "SciPy lm, analytic Jacobian": scipy(each_p, each_y, start),
        },
        rounds,
    )


def compete_many(rounds: int) -> tuple[Times, dict[str, str]]:
    """The same of ten times as many."""
    return compete(rounds, 1000)


def c_loop(p: np.ndarray, y: np.ndarray, start: np.ndarray) -> Callable[[], int]:
    """Every trial takes its step, damped alike: the work, not the way."""
    trial = compiled("lm_trial").lm_trial
    trial.restype = ctypes.c_double
    every = zip(p, y, strict=True)
    columns = [[np.ascontiguousarray(a) for a in (q[:, 0], q[:, 1], r)] for q, r in every]

    def work() -> int:
        for arrays in columns:
            given, theta = [pointer(a) for a in arrays], start.copy()
            for _ in range(TRIALS + 1):
                trial(COUNT, *given, pointer(theta), ctypes.c_double(1.0), pointer(theta))
        return (TRIALS + 1) * len(columns)

    return work


def scipy(p: np.ndarray, y: np.ndarray, start: np.ndarray) -> Callable[[], int]:
    def work() -> int:
        trials = 0
        for q, r in zip(p[:BY_SCIPY], y[:BY_SCIPY], strict=True):
            found = least_squares(
                values, start, jacobian, args=(q, r), method="lm", max_nfev=TRIALS,
                xtol=1e-15, ftol=1e-15, gtol=1e-15,
            )  # fmt: skip
            trials += found.nfev
        return trials

    return work
