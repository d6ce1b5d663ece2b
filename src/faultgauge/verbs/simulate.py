"""`simulate`: a plant in closed loop, healthy or not."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from faultgauge.accommodation import simulate as simulation
from faultgauge.errors import InputError
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.simulation.scenario import TRUTH, Scenario, read_scenario
from faultgauge.telemetry import Run
from faultgauge.telemetry.writing import as_table
from faultgauge.verbs.plants import plant as as_plant
from faultgauge.verbs.result import Columns, Result

__all__ = ["Simulation", "simulate"]

MOST_PANELS = 6  # of a figure


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(Result):
    """A simulated log: `run` holds inputs as commanded, outputs as measured and the true faults,
    and is a log for the other verbs; `scenario` is what was planned."""

    scenario: Scenario
    run: Run
    warnings: Sequence[str] = ()

    @property
    def lines(self) -> list[str]:
        return [f"{self.scenario.name}: {len(self.run.t)} rows of {', '.join(self.columns())}"]

    def as_dict(self) -> dict[str, Any]:
        return {
            "rows": len(self.run.t),
            "columns": list(self.columns()),
            "faults": [
                {"name": f.name, "enters": f.enters, "target": f.target, "effect": f.effect}
                for f in self.scenario.faults
            ],
        }

    def columns(self) -> Columns:
        """The log: time as `t`, and every signal."""
        return as_table(self.run)

    def page(self) -> Any:
        from faultgauge.reporting.simulation_chapter import simulation_report

        return simulation_report(self.scenario, self.run)

    def figures(self) -> Any:
        """Inputs, outputs and true faults above each other."""
        from faultgauge.reporting.time_figures import Panel, panels

        signals, run = self.scenario.plant.signals, self.run
        shown = [(each.name, each.unit) for each in (*signals.inputs, *signals.outputs)]
        shown += [(TRUTH + each.name, each.unit) for each in self.scenario.faults]
        stack = [Panel(name, unit, {name: run.columns[name]}) for name, unit in shown]
        return [panels(run.t, stack[:MOST_PANELS], title=self.scenario.name)]


def simulate(scenario: Any, plant: Any = None) -> Simulation:
    """Simulate a plant in closed loop, healthy or with faults whose truth is known.

    **Arguments**

    - `scenario`: a scenario, or its file.
    - `plant`: what to simulate in place of the plant that the file names: a fitted model, or a
      plant without networks (`plant`).

    Returns a `Simulation`; its `.run` is a log for the other verbs. The same scenario gives the
    same run. Raises `InputError` for a scenario that makes no sense, or whose plant leaves all
    bounds.
    """
    if not isinstance(scenario, Scenario | str | Path):
        raise InputError(f"a {type(scenario).__name__} is no scenario; give a scenario file.")
    if plant is not None and isinstance(scenario, Scenario):
        raise InputError("a scenario has its plant already; give a scenario file to name another.")
    planned = scenario if isinstance(scenario, Scenario) else read_scenario(scenario, _known(plant))
    return Simulation(planned, simulation.simulate(planned))


def _known(plant: Any) -> GrayBoxPlant | None:
    """A plant with nothing left to learn; None for none."""
    if plant is None or isinstance(plant, Model):
        return plant and plant.plant
    found = as_plant(plant)
    if found.networks:
        raise InputError(
            f"plant {found.spec.name!r}: its networks ({', '.join(found.networks)}) are untrained, "
            "so there is nothing to simulate; give the `.model` of `faultgauge.fit`."
        )
    return found
