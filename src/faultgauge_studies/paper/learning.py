"""What is learned from which log, and how well it runs beside a wheel that it never saw."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.identification.fit import FitReport, fit
from faultgauge.identification.optimise.algorithms import AlgorithmName
from faultgauge.plants.gray_box import GrayBoxPlant, load_plant
from faultgauge.plants.model import Model
from faultgauge.plants.plant import Plant
from faultgauge.simulation.free_run import Trajectory, free_run
from faultgauge.simulation.satellite.loop import Telemetry
from faultgauge.simulation.satellite.observatory import AXES, STEPS_PER_PERIOD
from faultgauge.telemetry import Run
from faultgauge_studies.merit import rms

__all__ = ["GRAY_BOX", "PITCH", "Learned", "Scores", "beside", "fitted", "learn", "rms", "scores"]

PITCH = AXES.index("pitch")
GRAY_BOX = "reaction_wheel_network"


class Learned(NamedTuple):
    """A model and the account of its fit."""

    model: Model
    account: FitReport


class Scores(NamedTuple):
    """Free run against the wheel: eqs (20) and (21) on torque, and R^2 on momentum."""

    r2: float
    rmse: float
    r2_h: float


def learn(
    training: Sequence[Run],
    validation: Sequence[Run],
    seed: int,
    restarts: int = 10,
    algorithm: AlgorithmName = "lm",
) -> Learned:
    """The GBNNM (NN1 and NN2 of 10 units) from healthy logs, selected on `validation`."""
    return fitted(load_plant(GRAY_BOX), training, validation, seed, restarts, algorithm)


def fitted(
    plant: GrayBoxPlant,
    training: Sequence[Run],
    validation: Sequence[Run],
    seed: int,
    restarts: int = 10,
    algorithm: AlgorithmName = "lm",
) -> Learned:
    """Any plant with unknowns, from the same logs by the same means."""
    return Learned(
        *fit(plant, training, validation, seed=seed, restarts=restarts, algorithm=algorithm)
    )


def beside(
    plant: Plant, flown: Telemetry, reference: Literal["free", "measured"] = "free"
) -> Trajectory:
    """`plant` beside the pitch wheel of a flight, on the same commands; NumPy arrays.

    "free" starts at the wheel's first momentum and is then alone; "measured" is given the
    wheel's momentum at every sample.
    """
    u, h = jnp.asarray(flown.u[:, [PITCH]]), jnp.asarray(flown.momentum[:, [PITCH]])
    if reference == "measured":
        return jax.device_get(_at(plant, h, u))
    samples = len(flown.t)
    dt = jnp.full(samples, float(flown.t[1] - flown.t[0]))
    f = jnp.zeros((samples, len(plant.signals.faults)))
    return jax.device_get(free_run(plant, h[0], u, dt, f, STEPS_PER_PERIOD))


@eqx.filter_jit
def _at(
    plant: Plant, x: Float[Array, "samples states"], u: Float[Array, "samples inputs"]
) -> Trajectory:
    dx = jax.vmap(plant.derivative)(x, u)
    return Trajectory(x, dx, jax.vmap(plant.output)(dx, x, u))


def scores(run: Trajectory, flown: Telemetry) -> Scores:
    """How well a trajectory reproduces the pitch wheel."""
    torque, momentum = flown.torque[:, PITCH], flown.momentum[:, PITCH]
    error, drift = torque - run.y[:, 0], momentum - run.x[:, 0]
    return Scores(
        r2=1 - float(np.mean(error**2) / np.var(torque)),
        rmse=rms(error),
        r2_h=1 - float(np.mean(drift**2) / np.var(momentum)),
    )
