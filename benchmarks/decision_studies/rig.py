"""Windows of two heated zones: two heaters, two thermometers, and a room that drifts.

Heaters have limits, so a bias is cut off where they stand at one; the room's temperature is the
nuisance. What each window holds is drawn from its seed alone.
"""

from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
from jaxtyping import Float

from decision_studies.stated import as_stated
from faultgauge.plants.gray_box import GrayBoxPlant, load_plant
from faultgauge.plants.model import Model
from faultgauge.simulation.free_run import RATE_STEP, fastest_rate
from faultgauge.simulation.run_scenario import simulate
from faultgauge.simulation.scenario import Drive, Scenario, read_scenario
from faultgauge.simulation.schedules import Constant, Schedule, Sine
from faultgauge.simulation.sources import SOURCES
from faultgauge.telemetry import Run

__all__ = ["FAULTS", "LIMIT", "Window", "every_set", "rig", "true_model", "window"]

FOLDER = Path(__file__).parent
FAULTS = ("heater_p", "heater_q", "sensor_a", "sensor_b")
LARGEST = {"heater": 12.0, "sensor": 1.5}  # W, K; the smallest is a quarter of it
HELD = 100.0  # s: how long a power command stands
LIMIT = 60.0  # W


@dataclass(frozen=True)
class Window:
    """A run, the size of every fault in it and when it begins [s]; `hidden` is the one that
    nobody can see, because its heater stands at the limit that cuts it off all the while."""

    run: Run
    faults: dict[str, float]
    onsets: dict[str, float]
    hidden: str | None
    scenario: Scenario

    def without(self, fault: str) -> Run:
        """The same window, noise and all, without this fault."""
        kept = tuple(each for each in self.scenario.faults if each.name != fault)
        return simulate(replace(self.scenario, faults=kept))


def rig(left_out: str | None = None) -> GrayBoxPlant:
    """The plant, without the fault `left_out` of its hypotheses."""
    plant = load_plant(FOLDER / "rig.toml")
    kept = tuple(each for each in plant.signals.faults if each.name != left_out)
    signals = replace(plant.signals, faults=kept)
    return GrayBoxPlant(signals, plant.spec, plant.networks, plant.parameters)


def true_model(plant: GrayBoxPlant, runs: list[Run]) -> Model:
    """`plant` as a model without any error, its envelope that of the healthy `runs`.

    Every state of the plant must be an output.
    """
    signals = plant.signals
    columns = [
        next(o.name for o in signals.outputs if o.measures == state)
        for state in signals.state_names
    ]
    names = [*columns, *signals.input_names]
    points = np.concatenate([[run.columns[name] for name in names] for run in runs], axis=1).T
    points = points[:: max(len(points) // 500, 1)]
    rate = fastest_rate(plant, points[:, : len(columns)], points[:, len(columns) :])
    return as_stated(plant, points, columns, columns, RATE_STEP / max(rate, 1e-3))


def every_set() -> list[tuple[str, ...]]:
    """The singles, then the pairs."""
    return [*((name,) for name in FAULTS), *combinations(FAULTS, 2)]


def window(
    seed: int, faults: tuple[str, ...] = (), *, stuck: str | None = None, seconds: float = 1200.0
) -> Window:
    """One window with `faults` of random size and sign from a random onset on. The heater `stuck`
    ("p" or "q") stands at a limit throughout, and its own bias has the sign that is cut off."""
    rng = np.random.default_rng([seed, 6])
    onsets = {name: float(np.round(rng.uniform(0.25, 0.5) * seconds)) for name in FAULTS}
    sizes = {
        name: float(LARGEST[name[:6]] * 4 ** -rng.uniform() * rng.choice([-1.0, 1.0]))
        for name in FAULTS
    }
    powers = {name: _powers(rng, seconds) for name in ("p", "q")}
    if stuck is not None:
        high = bool(rng.integers(2))
        powers[stuck] = np.full(len(powers[stuck]), LIMIT if high else 0.0)
        sizes[f"heater_{stuck}"] = abs(sizes[f"heater_{stuck}"]) * (1.0 if high else -1.0)
    base = _base()
    declared = {fault.name: fault for fault in base.plant.signals.faults}
    scenario = replace(
        base,
        name=f"{'+'.join(faults) or 'healthy'} {seed}",
        seed=seed,
        samples=int(seconds / base.step),
        inputs=tuple(_drive(values) for values in powers.values()),
        x0=np.array([20.0, 20.0]) + _settled(powers["p"][0], powers["q"][0]),
        faults=tuple(
            Schedule(n, declared[n].enters, declared[n].target, Constant(sizes[n], onsets[n]))
            for n in faults
        ),
        disturbances=_room(base, float(rng.uniform(0, 2 * np.pi))),
    )
    run = simulate(scenario)
    columns = {n: v for n, v in run.columns.items() if not n.startswith("true_")}
    hidden = f"heater_{stuck}" if stuck and f"heater_{stuck}" in faults else None
    return Window(
        Run(run.name, run.source, run.t, columns),
        {name: sizes[name] for name in faults},
        {name: onsets[name] for name in faults},
        hidden,
        scenario,
    )


@cache
def _base() -> Scenario:
    return read_scenario(FOLDER / "window.toml")


def _powers(rng: np.random.Generator, seconds: float) -> Float[np.ndarray, "levels"]:
    """Power commands; a sixth of them at a limit."""
    values = rng.uniform(5.0, 55.0, int(np.ceil(seconds / HELD)))
    at_limit = rng.uniform(size=len(values))
    return np.where(at_limit < 1 / 12, 0.0, np.where(at_limit > 11 / 12, LIMIT, values))


def _drive(values: Float[np.ndarray, "levels"]) -> Drive:
    times = [HELD * k for k in range(len(values))]
    return Drive(SOURCES["steps"].model_validate({"times": times, "values": values.tolist()}))


def _settled(p: float, q: float) -> Float[np.ndarray, "two"]:
    """Steady temperatures above the room's."""
    k, c = 1.0, 0.5
    return np.linalg.solve(np.array([[k + c, -c], [-c, k + c]]), np.array([p, q]))


def _room(base: Scenario, phase: float) -> tuple[Schedule, ...]:
    """The room's wave with another phase."""
    found = []
    for each in base.disturbances:
        assert isinstance(each.profile, Sine)
        found.append(replace(each, profile=replace(each.profile, phase=phase)))
    return tuple(found)
