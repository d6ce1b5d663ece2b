"""Records and networks of other sizes for the claims, and how a plant is held against them."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from faultgauge.excitation import Experiment
from faultgauge.identification.fit import FitReport, fit
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant
from faultgauge.plants.plant_file import parse_plant, read_plant_text
from faultgauge.simulation.free_run import Trajectory, free_run
from faultgauge.simulation.schedules import Schedule
from faultgauge.telemetry import Run
from faultgauge_studies.paper.excited import Records, experiment_log
from faultgauge_studies.paper.learning import GRAY_BOX

__all__ = [
    "RESTARTS",
    "medians",
    "rates",
    "replay",
    "sized",
    "teach",
    "unseen",
]

RESTARTS = 3
TEST = 10_000  # seeds of the test records: far from those of training and validation
SUBSTEPS = 5  # per sample of 1 s: friction's fastest rate is 0.044 1/s


def sized(hidden: int, plant: str = GRAY_BOX) -> GrayBoxPlant:
    """The untrained gray-box wheel with `hidden` units in each of its networks."""
    text = read_plant_text(plant)
    changed = text.replace("hidden = 10", f"hidden = {hidden}")
    return GrayBoxPlant.untrained(parse_plant(changed, f"{plant}, {hidden} units"))


def unseen(
    wheel: GrayBoxPlant, experiment: Experiment, seed: int, inner: Sequence[Schedule]
) -> Run:
    """A record that nothing is fitted to or selected by."""
    return experiment_log(wheel, experiment, TEST + seed, tuple(inner))


def teach(
    plant: GrayBoxPlant, given: Records, seed: int, restarts: int = RESTARTS
) -> tuple[GrayBoxPlant, FitReport]:
    """Fit and select as the bench does, from fewer starts."""
    model, account = fit(plant, [given.training], [given.validation], seed=seed, restarts=restarts)
    return model.plant, account


def rates(
    plant: Plant, h: Float[np.ndarray, "points"], u: Float[np.ndarray, "points"]
) -> Float[np.ndarray, "points"]:
    """dh [N*m] at momenta `h` [N*m*s] and commands `u` [N*m], beside no trajectory."""
    return np.asarray(_rates(plant, jnp.asarray(h[:, None]), jnp.asarray(u[:, None])))


@eqx.filter_jit
def _rates(
    plant: Plant, x: Float[Array, "points 1"], u: Float[Array, "points 1"]
) -> Float[Array, "points"]:
    return jax.vmap(plant.derivative)(x, u)[:, 0]


def replay(plant: Plant, log: Run) -> Trajectory:
    """`plant` alone on the commands of `log`, from its first momentum; NumPy arrays."""
    u, h = jnp.asarray(log.columns["u"][:, None]), jnp.asarray(log.columns["hm"][:1])
    dt = jnp.full(len(log.t), log.step)
    f = jnp.zeros((len(log.t), len(plant.signals.faults)))
    return jax.device_get(free_run(plant, h, u, dt, f, SUBSTEPS))


def medians(values: Sequence[Mapping[str, float | None]]) -> Float[np.ndarray, "values"]:
    """The medians over the seeds of a list of figures; NaN where there is none."""
    return np.array([each["median"] for each in values], float)
