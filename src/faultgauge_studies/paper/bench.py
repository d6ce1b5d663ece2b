"""The bench of one seed: the wheel, what disturbs it, the learned model, flights."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from faultgauge.excitation import Experiment
from faultgauge.plants.gray_box import GrayBoxPlant, load_plant
from faultgauge.plants.plant import Plant
from faultgauge.simulation.satellite.loop import Telemetry
from faultgauge.simulation.satellite.observatory import run
from faultgauge.simulation.schedules import Schedule
from faultgauge_studies.paper.cases import SECONDS, inner_disturbance
from faultgauge_studies.paper.excited import SWEEP, records
from faultgauge_studies.paper.learning import Learned, learn

__all__ = ["WHEEL", "Bench", "Traces", "learn_from", "set_up"]

Traces = dict[str, Mapping[str, Any]]  # curves by figure, then by name

WHEEL = "reaction_wheel"


class Bench(NamedTuple):
    """What the parts of one experiment share: `wheel` is the true one, `inner` its f(t)."""

    seed: int
    wheel: GrayBoxPlant
    inner: tuple[Schedule, ...]
    learned: Learned

    def fly(self, *faults: Schedule) -> Telemetry:
        """1000 s of the satellite, with `faults` in its pitch wheel."""
        return run(self.wheel, SECONDS, self.seed, self.inner, {"pitch": faults})

    @property
    def references(self) -> dict[str, Plant]:
        return {"desired": self.wheel, "gbnnm": self.learned.model.plant}


def set_up(seed: int) -> Bench:
    """Learn the wheel from the paper's experiment."""
    wheel = load_plant(WHEEL)
    inner = (inner_disturbance(wheel),)
    return Bench(seed, wheel, inner, learn_from(wheel, SWEEP, seed, inner))


def learn_from(
    wheel: GrayBoxPlant, experiment: Experiment, seed: int, inner: tuple[Schedule, ...], **how: Any
) -> Learned:
    """Trained on one record of the experiment and selected on another."""
    given = records(wheel, experiment, seed, inner)
    return learn([given.training], [given.validation], seed, **how)
