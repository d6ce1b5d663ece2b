"""The plant of Fig 2: four static parts f1 to f4 among two integrators, its excitation, and
how parts are compared.

The paper's text does not say how its parts are connected, so the connection is our own.
"""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from faultgauge.excitation import Experiment, design
from faultgauge.identification.samples import Samples
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant
from faultgauge.plants.plant_file import parse_plant
from faultgauge.simulation.free_run import free_run
from faultgauge.telemetry import Run
from faultgauge_studies.paper.learning import rms

__all__ = [
    "ARGUMENTS",
    "EXPERIMENT",
    "PARTS",
    "SPOILT",
    "SUMMED",
    "TRUE",
    "excited",
    "gray_box",
    "inside",
    "part_errors",
    "part_values",
    "samples_of",
    "spoilt",
    "true_plant",
]

PARTS = ("f1", "f2", "f3", "f4")
# A drive with lag pushes a mass against drag; a gauge reads force, another acceleration. The true
# plant and the learned one are this one file with other parts, so their integrators are the same.
PLANT = """
name = "four parts"
states.F = {{ unit = "N", derivative = "{f1}" }}
states.v = {{ unit = "m/s", derivative = "{f2}" }}
inputs.u = {{ unit = "V", min = -5, max = 5 }}
outputs.s = {{ unit = "V", value = "{f3}" }}
outputs.a = {{ unit = "V", value = "{f4}" }}
"""
TRUE = {
    "f1": "2*(60*tanh(u/3) - F)",  # a drive that saturates at 60 N, lag 0.5 s
    "f2": "(F - 8*v - 10*v**3 - 2*tanh(v/0.1))/4",  # viscous, cubic and dry drag on 4 kg
    "f3": "6*tanh(F/40)",  # a gauge that bends at its ends
    "f4": "0.5*d(v)*(1 + 0.2*v) + 0.3*v**2",  # another, sensitive to speed
}
ARGUMENTS = {"f1": "F, u", "f2": "F, v", "f3": "F", "f4": "d(v), v"}
LEARNED = {part: f"{part}({ARGUMENTS[part]})" for part in PARTS}
NETWORK = "networks.{} = {{ hidden = 10 }}\n"  # as Table 2
# Two parts in one equation, which no measured signal tells apart.
SUMMED = LEARNED | {"f1": "f1(u) + f2(F)", "f2": "f3(F, v)", "f3": "f4(F)", "f4": "d(v)"}
# 2000 samples: the paper's 1,000 to 10,000. The band holds the corners of both lags.
EXPERIMENT = Experiment("noise", seconds=200.0, dt=0.1, low=0.02, high=1.0)
SUBSTEPS = 20
SPOIL = 14  # stream of random numbers
SPOILT = 0.1  # of a column's standard deviation, as noise: plainly seen by a part that reads it


def true_plant() -> GrayBoxPlant:
    return GrayBoxPlant.untrained(parse_plant(PLANT.format(**TRUE), "true parts"))


def gray_box(parts: Mapping[str, str] = LEARNED) -> GrayBoxPlant:
    """The same integrators around four untrained networks."""
    text = PLANT.format(**parts) + "".join(NETWORK.format(part) for part in PARTS)
    return GrayBoxPlant.untrained(parse_plant(text, "four networks"))


def excited(plant: Plant, seed: int) -> Run:
    """The log {u, x, dx, y} of `plant` from rest under band-limited noise, as Fig 4 has it."""
    signals = plant.signals
    excitation = design(EXPERIMENT, signals, seed)
    samples = len(excitation.t)
    run = jax.device_get(
        free_run(
            plant,
            jnp.zeros(len(signals.states)),
            jnp.asarray(excitation.feedforward),
            jnp.full(samples, EXPERIMENT.dt),
            jnp.zeros((samples, 0)),
            SUBSTEPS,
        )
    )
    rates = [f"d_{name}" for name in signals.state_names]
    names = (*signals.input_names, *signals.state_names, *rates, *signals.output_names)
    columns = np.concatenate([excitation.feedforward, run.x, run.dx, run.y], axis=1)
    return Run(
        f"noise {seed}", "excitation", excitation.t, dict(zip(names, columns.T, strict=True))
    )


def part_values(plant: Plant, samples: Samples) -> Float[np.ndarray, "samples 4"]:
    """f1 to f4 at given (x, u, dx): two are the derivatives, two the outputs."""
    x, u, dx = jnp.asarray(samples.x), jnp.asarray(samples.u), jnp.asarray(samples.dx)
    two = jax.vmap(plant.derivative)(x, u), jax.vmap(plant.output)(dx, x, u)
    return np.concatenate(two, axis=1)


def samples_of(run: Run, plant: Plant) -> Samples:
    """The points of a log, as they are."""
    signals, columns = plant.signals, run.columns
    states, inputs, outputs = signals.state_names, signals.input_names, signals.output_names
    return Samples(
        np.stack([columns[name] for name in states], axis=1),
        np.stack([columns[name] for name in inputs], axis=1),
        np.stack([columns[f"d_{name}"] for name in states], axis=1),
        np.stack([columns[name] for name in outputs], axis=1),
    )


def spoilt(run: Run, column: str, seed: int) -> Run:
    """The log with white noise on one column, a tenth of its standard deviation."""
    x = run.columns[column]
    noise = np.random.default_rng([seed, SPOIL]).standard_normal(len(x))
    changed = {**run.columns, column: x + SPOILT * float(np.std(x)) * noise}
    return Run(run.name, run.source, run.t, changed)


def inside(trained: Samples, fresh: Samples) -> Bool[np.ndarray, "samples"]:
    """Which fresh points lie inside the training range of every quantity that a part reads."""
    found = np.ones(len(fresh.x), bool)
    for old, new in ((trained.x, fresh.x), (trained.u, fresh.u), (trained.dx, fresh.dx)):
        found &= ((new >= old.min(axis=0)) & (new <= old.max(axis=0))).all(axis=1)
    return found


def part_errors(true: Plant, learned: Plant, points: Samples) -> dict[str, dict[str, float]]:
    """Each learned part against its true function at some points: RMSE in the part's unit, and
    RMSE and largest error as shares of the true part's range there."""
    truth = part_values(true, points)
    error = part_values(learned, points) - truth
    return {
        part: {
            "rmse": rms(e),
            "rmse_share": rms(e) / float(np.ptp(f)),
            "largest_share": float(np.abs(e).max() / np.ptp(f)),
        }
        for part, e, f in zip(PARTS, error.T, truth.T, strict=True)
    }
