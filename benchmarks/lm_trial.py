"""One Levenberg-Marquardt trial at N = 10,000: ours against C, SciPy and Optimistix.

A trial is one damped step and the cost at its end; ours and C also evaluate the Jacobian there
every time, the peers only where the step was good. The work is a 2-10-1 tanh
network (41 parameters). Ours goes the whole way of a user's plant file: expression, scalings and
saturation of the network's arguments included. C and the peers get the bare network.
"""

import ctypes
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from scipy.optimize import least_squares

from compiled import compiled, pointer
from faultgauge.identification.equation.groups import (
    EquationResidual,
    groups,
    scale_networks,
    start_vector,
)
from faultgauge.identification.optimise.levenberg_marquardt import Options, levenberg_marquardt
from faultgauge.identification.samples import Samples
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from interleave import Times, interleaved

__all__ = ["HIDDEN", "PLANT", "compete", "data", "prepared"]

HIDDEN = 10
TRIALS = 20  # per timing, for those that are fast
PLANT = """
name = "wheel"
[states.h]
derivative = "friction(h, u)"
[inputs.u]
[outputs.h]
value = "h"
[networks.friction]
hidden = 10
"""


def data(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (samples, 2) in [-1, 1] and a noisy target that no such network meets exactly."""
    rng = np.random.default_rng(0)
    p = rng.uniform(-1, 1, (count, 2))
    return p, np.sin(3 * p[:, 0]) * p[:, 1] + np.tanh(5 * p[:, 0]) + 0.01 * rng.normal(size=count)


def prepared(
    p: np.ndarray, y: np.ndarray
) -> tuple[EquationResidual, np.ndarray, Samples, np.ndarray]:
    """(residual, its start, its samples, the same start as all others have it: weights in, bias,
    weights out)."""
    plant = GrayBoxPlant.untrained(parse_plant(PLANT, "wheel.toml"))
    (group,) = groups(plant.spec, ["h"])
    samples = Samples(x=p[:, :1], u=p[:, 1:], dx=y[:, None], y=p[:, :1])
    plant = scale_networks(plant, group, samples)
    theta = start_vector(plant, group, np.ones(0), np.random.default_rng(1))
    residual = EquationResidual(plant, jnp.array([np.std(y)]), jnp.zeros(0), group)
    order = np.r_[HIDDEN : 4 * HIDDEN, :HIDDEN, 4 * HIDDEN]
    return residual, theta, jax.tree.map(jnp.asarray, samples), theta[order]


def ours(residual: EquationResidual, theta: np.ndarray, samples: Samples) -> Callable[[], int]:
    starts, free = jnp.asarray(theta)[None], jnp.full(theta.size, jnp.inf)
    options = Options(max_trials=TRIALS, tolerance=0.0)

    def work() -> int:
        found = levenberg_marquardt(residual, starts, samples, None, -free, free, options)
        return int(found.trials[0]) + 1  # the start is evaluated too

    return work


def c_loop(p: np.ndarray, y: np.ndarray, start: np.ndarray) -> Callable[[], int]:
    trial = compiled("lm_trial").lm_trial
    trial.restype = ctypes.c_double
    arrays = [np.ascontiguousarray(a) for a in (p[:, 0], p[:, 1], y)]
    theta, following = start.copy(), np.empty_like(start)
    pointers, target = [pointer(a) for a in (*arrays, theta)], pointer(following)

    def work() -> int:
        for _ in range(TRIALS):
            trial(len(y), *pointers, ctypes.c_double(1.0), target)
        return TRIALS

    work()
    # the same step, so that the C timed is the work meant; -ffast-math reorders sums of 10,000
    np.testing.assert_allclose(following, reference_step(p, y, start, 1.0), rtol=1e-6)
    return work


def values(theta: np.ndarray, p: np.ndarray, y: np.ndarray) -> np.ndarray:
    W, b, v, c = theta[:20].reshape(HIDDEN, 2), theta[20:30], theta[30:40], theta[40]
    return np.tanh(p @ W.T + b) @ v + c - y


def jacobian(theta: np.ndarray, p: np.ndarray, y: np.ndarray) -> np.ndarray:
    W, b, v = theta[:20].reshape(HIDDEN, 2), theta[20:30], theta[30:40]
    a = np.tanh(p @ W.T + b)
    inner = v * (1 - a * a)
    outer = (inner[:, :, None] * p[:, None, :]).reshape(len(p), -1)
    return np.concatenate([outer, inner, a, np.ones((len(p), 1))], axis=1)


def reference_step(p: np.ndarray, y: np.ndarray, theta: np.ndarray, mu: float) -> np.ndarray:
    J, r = jacobian(theta, p, y), values(theta, p, y)
    return theta - np.linalg.solve(J.T @ J + mu * np.eye(theta.size), J.T @ r)


def scipy(
    p: np.ndarray, y: np.ndarray, start: np.ndarray, method: str, exact: bool
) -> Callable[[], int]:
    """SciPy's least_squares; `nfev` counts trial steps, the calls for a 2-point Jacobian not."""

    def work() -> int:
        found = least_squares(
            values,
            start,
            jacobian if exact else "2-point",
            args=(p, y),
            method=method,
            max_nfev=10,
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        )
        return found.nfev

    return work


def optimistix(p: np.ndarray, y: np.ndarray, start: np.ndarray) -> Callable[[], int]:
    """Optimistix's LevenbergMarquardt as it comes, compiled once."""
    p, y, start = map(jnp.asarray, (p, y, start))
    solver = optx.LevenbergMarquardt(rtol=1e-15, atol=1e-15)

    def residual(theta: jax.Array, args: tuple[jax.Array, jax.Array]) -> jax.Array:
        p, y = args
        W, b, v, c = theta[:20].reshape(HIDDEN, 2), theta[20:30], theta[30:40], theta[40]
        return jnp.tanh(p @ W.T + b) @ v + c - y

    @eqx.filter_jit
    def solve(start: jax.Array) -> jax.Array:
        found = optx.least_squares(residual, solver, start, (p, y), max_steps=5, throw=False)
        return found.stats["num_steps"]

    return lambda: int(solve(start))


def compete(rounds: int, count: int = 10_000) -> tuple[Times, dict[str, str]]:
    """Seconds per trial of every competitor."""
    p, y = data(count)
    residual, theta, samples, start = prepared(p, y)
    return interleaved(
        {
            "faultgauge": ours(residual, theta, samples),
            "C": c_loop(p, y, start),
            "SciPy lm, analytic Jacobian": scipy(p, y, start, "lm", True),
            "SciPy lm, 2-point": scipy(p, y, start, "lm", False),
            "SciPy trf, analytic Jacobian": scipy(p, y, start, "trf", True),
            "SciPy trf, 2-point": scipy(p, y, start, "trf", False),
            "Optimistix": optimistix(p, y, start),
        },
        rounds,
    )
