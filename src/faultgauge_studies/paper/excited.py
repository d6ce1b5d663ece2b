"""Healthy logs of one wheel: the experiment, noise alone, and what normal operation gives."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from faultgauge.excitation import Experiment, Sweep, design
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.simulation.closed_loop import Conditions, Controller, closed_loop, with_faults
from faultgauge.simulation.satellite.loop import Telemetry
from faultgauge.simulation.satellite.observatory import AXES
from faultgauge.simulation.schedules import Schedule, grid, inject
from faultgauge.telemetry import Run

__all__ = ["NOISE_ALONE", "SWEEP", "Records", "experiment_log", "records", "wheel_log"]

# Table 2: 1000 samples at 1 Hz. One cycle is two triangles, up and down: 600 N*m*s of travel in
# 1000 s is what the motor can do beside the noise.
SWEEP = Experiment(
    "noise_with_sweep",
    seconds=1000.0,
    dt=1.0,
    low=0.005,
    high=0.4,
    sigma={"u": 0.4},
    sweep=Sweep("hm", gain=0.03, amplitude=150.0, cycles=1),
)
NOISE_ALONE = Experiment("noise", seconds=1000.0, dt=1.0, low=0.005, high=0.4, sigma={"u": 0.4})
SUBSTEPS = 20


class Records(NamedTuple):
    """One record of an experiment to fit, one to stop and select by."""

    training: Run
    validation: Run


def experiment_log(
    wheel: GrayBoxPlant, experiment: Experiment, seed: int, inner: tuple[Schedule, ...]
) -> Run:
    """The log of an `experiment` on the bench, from rest, with `inner` disturbances.

    It holds u, T, hm and the derivative d_h, which is what the paper resamples: {u, x, dx, y}.
    """
    signals = wheel.signals
    excitation = design(experiment, signals, seed)
    samples = len(excitation.t)
    injection = inject(inner, signals, grid(samples, experiment.dt, SUBSTEPS))
    outputs = len(signals.outputs)
    record = jax.device_get(
        closed_loop(
            with_faults(wheel, injection.faults),
            Controller(jnp.asarray(excitation.kp), jnp.zeros((len(signals.inputs), outputs))),
            jnp.zeros(len(signals.states)),
            Conditions(
                jnp.asarray(excitation.feedforward),
                jnp.asarray(excitation.reference),
                jnp.zeros((samples, outputs)),
                jnp.asarray(injection.f),
                jax.tree.map(jnp.asarray, injection.stuck),
                jnp.zeros((samples, outputs), bool),
            ),
            experiment.dt,
        )
    )
    columns = {
        "u": record.u[:, 0],
        "T": record.y[:, 0],
        "hm": record.y[:, 1],
        "d_h": record.dx[:, 0],
    }
    return Run(f"{experiment.kind} {seed}", experiment.kind, excitation.t, columns)


def records(
    wheel: GrayBoxPlant, experiment: Experiment, seed: int, inner: Sequence[Schedule]
) -> Records:
    """Two records of a seed, apart from each other and from those of every other seed."""
    first, second = (experiment_log(wheel, experiment, 2 * seed + k, tuple(inner)) for k in (0, 1))
    return Records(first, second)


def wheel_log(flown: Telemetry, axis: str, name: str) -> Run:
    """One wheel's telemetry from a flight of the satellite."""
    k = AXES.index(axis)
    columns = {
        "u": flown.u[:, k],
        "T": flown.torque[:, k],
        "hm": flown.momentum[:, k],
        "d_h": flown.rate[:, k],
    }
    return Run(name, name, np.asarray(flown.t), {n: np.asarray(c) for n, c in columns.items()})
