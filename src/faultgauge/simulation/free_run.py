"""Free runs: the plant beside a log, fed with the log's inputs alone."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.plants.plant import Plant, respond
from faultgauge.programs import program
from faultgauge.simulation.integrators import step_through
from faultgauge.simulation.intersample import intersample

__all__ = [
    "RATE_STEP",
    "Trajectory",
    "blow_up",
    "bucket",
    "fastest_rate",
    "free_run",
    "pad",
    "simulate",
    "simulate_through",
    "substeps_for",
]

MAX_SUBSTEPS = 64  # between two samples
RATE_STEP = 0.5  # longest RK4 step times the fastest rate: error per step about 3e-4 of it
WILD = 1e6  # times its start: a simulation that blows up


class Trajectory(NamedTuple):
    """A simulated run: states, their derivatives and outputs at every sample."""

    x: Float[Array, "samples states"]
    dx: Float[Array, "samples states"]
    y: Float[Array, "samples outputs"]


@program
def free_run(
    plant: Plant,
    x0: Float[Array, "states"],
    u: Float[Array, "samples inputs"],
    dt: Float[Array, "samples"],
    f: Float[Array, "samples faults"],
    substeps: int,
) -> Trajectory:
    """Simulate from `x0`; `dt[k]` [s] leads from sample k to k+1 (0 where padded)."""
    return simulate(plant, x0, u, dt, f, substeps)


def simulate(
    plant: Plant,
    x0: Float[Array, "states"],
    u: Float[Array, "samples inputs"],
    dt: Float[Array, "samples"],
    f: Float[Array, "samples faults"],
    substeps: int,
) -> Trajectory:
    """`free_run` without its own compilation, for use inside other compiled functions."""
    return simulate_through(plant, x0, intersample(plant.signals, u, substeps), dt, f, substeps)


def simulate_through(
    plant: Plant,
    x0: Float[Array, "states"],
    stages: Float[Array, "samples stages inputs"],
    dt: Float[Array, "samples"],
    f: Float[Array, "samples faults"],
    substeps: int,
) -> Trajectory:
    """`simulate` with the inputs between the samples given, as `intersample` makes them."""

    def body(x: Array, sample: tuple[Array, ...]) -> tuple[Array, Trajectory]:
        stages, dt, f = sample
        dx, y = respond(plant, x, stages[0], f)
        return step_through(plant, x, stages, f, dt, substeps), Trajectory(x, dx, y)

    return jax.lax.scan(body, x0, (stages, dt, f))[1]


def blow_up(
    run: str,
    t: Float[np.ndarray, "samples"],
    x: Float[np.ndarray, "samples states"],
    names: Sequence[str],
) -> str | None:
    """Which state of a simulated run leaves all bounds first, and when; None where none does."""
    wild = ~(np.abs(x) < WILD * (1 + np.abs(x[0])))
    if not wild.any():
        return None
    k = int(np.argmax(wild.any(axis=1)))
    i = int(np.argmax(wild[k]))
    does = "is no longer a number" if np.isnan(x[k, i]) else "leaves all bounds"
    return f"state {names[i]!r} {does} at t = {t[k]:.6g} s of run {run!r}"


def substeps_for(step: float, max_step: float) -> int:
    """RK4 steps per sample so that none is longer than `max_step` [s]."""
    return int(np.clip(np.ceil(step / max_step * (1 - 1e-9)), 1, MAX_SUBSTEPS))


def bucket(samples: int) -> int:
    """The padded length of a record: few lengths, so that few programs are compiled."""
    length = 64
    while length < samples:
        length = length * 3 // 2 if length & (length - 1) == 0 else length // 3 * 4
    return length


def pad(x: Float[np.ndarray, "samples *rest"], length: int) -> Float[np.ndarray, "padded *rest"]:
    """`x` continued to `length` with its last row."""
    return np.concatenate([x, np.repeat(x[-1:], length - len(x), axis=0)])


@program
def _rates(plant: Plant, x: Array, u: Array) -> Float[Array, "samples states states"]:
    return jax.vmap(jax.jacfwd(plant.derivative), (0, 0))(x, u)


@program
def _faulty_rates(
    plant: Plant, x: Array, u: Array, f: Array
) -> Float[Array, "samples states states"]:
    def rate(x: Array, u: Array, f: Array) -> Array:
        return respond(plant, x, u, f)[0]

    return jax.vmap(jax.jacfwd(rate))(x, u, f)


def fastest_rate(
    plant: Plant,
    x: Float[np.ndarray, "samples states"],
    u: Float[np.ndarray, "samples inputs"],
    f: Float[np.ndarray, "samples faults"] | None = None,
) -> float:
    """Largest |eigenvalue| [1/s] of dF/dx over the points, leaving out the top 1 % (kinks).

    With fault sizes `f`, that of the faulty plant under the commands `u`.
    """
    if f is None:
        jacobians = np.asarray(_rates(plant, jnp.asarray(x), jnp.asarray(u)))
    else:
        given = (jnp.asarray(each) for each in (x, u, f))
        jacobians = np.asarray(_faulty_rates(plant, *given))
    jacobians = jacobians[np.all(np.isfinite(jacobians), axis=(1, 2))]
    if len(jacobians) == 0:
        return 0.0
    return float(np.quantile(np.abs(np.linalg.eigvals(jacobians)).max(axis=1), 0.99))
