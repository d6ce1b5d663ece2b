"""Runs of a campaign as logs: simulated with their faults, and without them."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from faultgauge.accommodation.simulate import simulate
from faultgauge.campaigns.design import RunPlan
from faultgauge.campaigns.schema import Plan
from faultgauge.simulation.scenario import TRUTH, Scenario
from faultgauge.simulation.schedules import Schedule
from faultgauge.telemetry import Run

__all__ = ["constants_of", "healthy_run", "log_of", "schedules_of"]

CONSTANTS = 1  # stream of random numbers beside those of the scenario


def schedules_of(plan: Plan, run: RunPlan) -> tuple[Schedule, ...]:
    """What goes wrong in `run`."""
    each = zip(run.kinds, run.sizes, run.onsets, strict=True)
    return tuple(kind.schedule(plan.scenario, size, onset) for kind, size, onset in each)


def constants_of(plan: Plan, seed: int) -> dict[str, float]:
    """The constants that differ between runs, in the run of this `seed`: normal around the
    scenario's, within their limits."""
    rng = np.random.default_rng([seed, CONSTANTS])
    known = {each.name: each for each in plan.scenario.plant.spec.parameters}
    found = {}
    for name, share in plan.dispersions.items():
        value = float(plan.scenario.plant.parameters[name])
        drawn = value * (1 + share * rng.standard_normal())
        found[name] = float(np.clip(drawn, known[name].min, known[name].max))
    return found


def log_of(plan: Plan, run: RunPlan, faults: tuple[Schedule, ...]) -> Run:
    """The run as telemetry holds it, with `faults` in it."""
    return _log(plan, run.seed, run.noise, f"run {run.number}", faults)


def healthy_run(plan: Plan, seed: int, name: str) -> Run:
    """A run without a fault, with the scenario's own noise."""
    return _log(plan, seed, 1.0, name, ())


def _log(plan: Plan, seed: int, noise: float, name: str, faults: tuple[Schedule, ...]) -> Run:
    scenario = plan.scenario
    given: Scenario = replace(
        scenario,
        name=name,
        seed=seed,
        sigma=scenario.sigma * noise,
        faults=faults,
        plant=_with_constants(scenario, constants_of(plan, seed)),
    )
    run = simulate(given)
    columns = {k: v for k, v in run.columns.items() if not k.startswith(TRUTH)}
    return Run(run.name, run.source, run.t, columns)


def _with_constants(scenario: Scenario, values: dict[str, float]) -> object:
    plant = scenario.plant
    changed = plant.parameters | {name: jnp.asarray(value) for name, value in values.items()}
    return eqx.tree_at(lambda p: p.parameters, plant, changed)
