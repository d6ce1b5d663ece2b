"""Scenarios with a policy in the loop."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np

from faultgauge.accommodation.policy import Info
from faultgauge.accommodation.table import policy_of
from faultgauge.accommodation.wheels import EachWheel
from faultgauge.observers.observer import OperatingPoints
from faultgauge.simulation.policy import Policy
from faultgauge.simulation.run_scenario import fault_free_points, run_under
from faultgauge.simulation.scenario import Scenario, read_scenario
from faultgauge.telemetry import Run

__all__ = ["ACTED", "ADDED", "ESTIMATED", "simulate"]

ESTIMATED, ACTED, ADDED = "fhat_", "acted_", "added_"


def simulate(scenario: Scenario | str | Path) -> Run:
    """Run a scenario (or the file of one) in closed loop, accommodated if it says so.

    The run holds the inputs as commanded inside their limits, the outputs as measured (NaN where
    no sample came) and `true_<fault>` for every fault: its size, NaN while it is not stuck, 1
    while it is dropped out. With `[accommodation]` it also holds `fhat_<fault>` and
    `acted_<fault>` (1 while it is acted upon) for every fault of its model, and `added_<input>`,
    what was added to the controller's command. The same scenario gives the same run.

    Raises `InputError` for a scenario that makes no sense, or whose plant leaves all bounds.
    """
    if not isinstance(scenario, Scenario):
        scenario = read_scenario(scenario)
    if scenario.accommodation is None:
        return run_under(scenario, None)[0]
    accommodated = policy_of(scenario, OperatingPoints(*fault_free_points(scenario)))
    assert accommodated is not None
    policy: Policy = accommodated
    if scenario.flight:
        policy = EachWheel(accommodated, jnp.eye(3))
    run, info = run_under(scenario, policy)
    faults = accommodated.estimator.plant.signals.fault_names
    columns = run.columns | _told(info, faults, scenario.plant.signals.input_names)
    return Run(run.name, run.source, run.t, columns)


def _told(info: Info, faults: tuple[str, ...], inputs: tuple[str, ...]) -> dict[str, np.ndarray]:
    found = {ESTIMATED + name: np.asarray(info.f[:, k]) for k, name in enumerate(faults)}
    found |= {ACTED + name: np.asarray(info.engaged[:, k], float) for k, name in enumerate(faults)}
    return found | {ADDED + name: np.asarray(info.c[:, k]) for k, name in enumerate(inputs)}
