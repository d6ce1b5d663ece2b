"""Free runs of h' = NN(h, u), a 2-10-1 tanh network, by RK4 under a held input: one trajectory of
10,000 steps, and 1,000 side by side; ours goes through a user's plant file, outputs and all.
"""

import ctypes
from collections.abc import Callable
from importlib.util import find_spec

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from compiled import compiled, pointer
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.simulation.free_run import free_run, simulate
from interleave import Absent, Times, interleaved

__all__ = ["compete_alone", "compete_together"]

STEP, BY_NUMPY, HIDDEN, REACH = 0.25, 500, 10, 100.0
PLANT = """
name = "wheel"
[states.h]
derivative = "torque(h, u)"
[inputs.u]
hold = "zero"
[outputs.h]
value = "h"
[networks.torque]
hidden = 10
"""


def network() -> np.ndarray:
    """Weights in, bias, weights out and bias of a wheel that comes to rest by itself."""
    random = np.random.default_rng(0)
    inner = np.stack([-random.uniform(0.1, 0.5, HIDDEN), random.uniform(0.1, 0.5, HIDDEN)], axis=1)
    bias, outer = 0.1 * random.standard_normal(HIDDEN), random.uniform(0.0, 0.2, HIDDEN)
    return np.concatenate([inner.ravel(), bias, outer, [0.0]])


def plant_of(theta: np.ndarray) -> GrayBoxPlant:
    """The same as a plant file's, whose network holds its arguments within +- `REACH`."""
    plant = GrayBoxPlant.untrained(parse_plant(PLANT))
    old = plant.networks["torque"]
    W, b, v, c = np.split(theta, [20, 30, 40])
    new = eqx.tree_at(
        lambda n: (n.weights_out, n.weights_in, n.bias, n.bias_out, n.input_scale),
        old,
        (
            jnp.asarray(v),
            jnp.asarray(REACH * W.reshape(HIDDEN, 2)),
            jnp.asarray(b),
            jnp.asarray(c[0]),
            REACH * old.input_scale,
        ),
    )
    return eqx.tree_at(lambda p: p.networks["torque"], plant, new)


def inputs(steps: int) -> np.ndarray:
    return np.repeat(np.random.default_rng(1).uniform(-1, 1, steps // 10), 10)


def ours(
    theta: np.ndarray, u: np.ndarray, starts: np.ndarray
) -> tuple[Callable[[], int], Callable[[], np.ndarray]]:
    """(the work, what it gives: states of every trajectory, samples first)."""
    plant, steps = plant_of(theta), len(u)
    dt, f = jnp.full(steps, STEP), jnp.zeros((steps, 0))
    given, x0 = jnp.asarray(u)[:, None], jnp.asarray(starts)[:, None]

    @eqx.filter_jit
    def together(x0: jax.Array) -> jax.Array:
        run = jax.vmap(lambda x: simulate(plant, x, given, dt, f, 1).x, out_axes=1)
        return run(x0)

    def states() -> np.ndarray:
        if len(starts) == 1:
            return np.asarray(free_run(plant, x0[0], given, dt, f, 1).x)
        return np.asarray(together(x0))[..., 0]

    def work() -> int:
        states()
        return steps * len(starts)

    return work, states


def c_loop(
    theta: np.ndarray, u: np.ndarray, starts: np.ndarray, expected: np.ndarray
) -> Callable[[], int]:
    library, steps = compiled("free_run"), len(u)
    x = np.zeros((steps, len(starts)))
    dt = ctypes.c_double(STEP)

    def work() -> int:
        x[0] = starts
        if len(starts) == 1:
            library.free_run(steps, dt, pointer(theta), pointer(u), pointer(x))
        else:
            library.free_runs(len(starts), steps, dt, pointer(theta), pointer(u), pointer(x))
        return x.size

    work()
    # the same runs, so that the C timed is the work meant; -ffast-math reorders sums
    np.testing.assert_allclose(x, expected.reshape(x.shape), rtol=1e-6, atol=1e-9)
    return work


def numpy(theta: np.ndarray, u: np.ndarray) -> Callable[[], int]:
    W, b, v, c = theta[:20].reshape(HIDDEN, 2), theta[20:30], theta[30:40], theta[40]

    def rate(x: float, command: float) -> float:
        return v @ np.tanh(W @ np.array([x, command]) + b) + c

    def work() -> int:
        x = 0.0
        for command in u[:BY_NUMPY]:
            k1 = rate(x, command)
            k2 = rate(x + STEP / 2 * k1, command)
            k3 = rate(x + STEP / 2 * k2, command)
            x += STEP / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + STEP * k3, command))
        return BY_NUMPY

    return work


def diffrax(theta: np.ndarray, u: np.ndarray) -> Callable[[], int] | Absent:
    if not find_spec("diffrax"):
        return Absent("not installed: pip install diffrax")
    import diffrax as dfx

    W, b, v, c = (jnp.asarray(part) for part in np.split(theta, [20, 30, 40]))
    given = jnp.asarray(u)

    def rate(t: jax.Array, x: jax.Array, _: None) -> jax.Array:
        command = given[jnp.clip((t / STEP).astype(int), 0, len(u) - 1)]
        return v @ jnp.tanh(W.reshape(HIDDEN, 2) @ jnp.stack([x, command]) + b) + c[0]

    @jax.jit
    def solve(x0: jax.Array) -> jax.Array:
        found = dfx.diffeqsolve(
            dfx.ODETerm(rate), dfx.Heun(), 0.0, STEP * len(u), STEP, x0, max_steps=len(u) + 1
        )
        return found.ys

    def work() -> int:
        jax.block_until_ready(solve(jnp.asarray(0.0)))
        return len(u)

    return work


def compete_alone(rounds: int) -> tuple[Times, dict[str, str]]:
    """Seconds per step of one trajectory."""
    theta, u, starts = network(), inputs(10_000), np.zeros(1)
    mine, states = ours(theta, u, starts)
    return interleaved(
        {
            "faultgauge": mine,
            "C": c_loop(theta, u, starts, states()),
            "NumPy": numpy(theta, u),
            "diffrax, Heun": diffrax(theta, u),
        },
        rounds,
    )


def compete_together(rounds: int) -> tuple[Times, dict[str, str]]:
    """Seconds per step and trajectory, of 1,000 at once."""
    theta, u, starts = network(), inputs(1000), np.linspace(-1, 1, 1000)
    mine, states = ours(theta, u, starts)
    return interleaved(
        {"faultgauge": mine, "C": c_loop(theta, u, starts, states()), "NumPy": numpy(theta, u)},
        rounds,
    )
