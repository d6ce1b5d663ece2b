"""The typical unit of a fleet: what its networks are, and where its constants lie, from some units
fitted together, each with constants of its own."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from faultgauge.detection.answer.alarmed import refuse_alarms
from faultgauge.errors import InputError
from faultgauge.fleet.units import Unit
from faultgauge.identification import fit as identification
from faultgauge.identification.population import Law, own_parameters, population, with_population
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model
from faultgauge.plants.record import FleetRecord
from faultgauge.plants.settle import settle
from faultgauge.telemetry import Run, cut
from faultgauge.verbs.how import How
from faultgauge.verbs.reading import runs_for_plant

__all__ = ["base_of", "fleet_of", "laws_of", "typical_unit", "unit_plant"]

POOL = 6  # units that are fitted together
SAMPLES = 20_000  # of all of them
UNLIKE = 0.5  # probability that a unit is unlike the others, from which on it is left out


def typical_unit(
    plant: GrayBoxPlant,
    units: Sequence[Unit],
    how: How,
    *,
    seed: int,
    robust: bool,
    despite_alarms: bool,
    progress: Callable[[str], None],
) -> Model:
    """The model of the typical unit, its laws not known yet.

    Of the units that can be read, some spread over all are fitted as runs whose constants vary; who
    is unlike the others is left out, and the rest fitted again, so that the networks know nothing
    of it. Raises `InputError` where no unit can be read.
    """
    runs = _pool(plant, units, how, despite_alarms)
    named = {p.name for p in own_parameters(plant.spec.parameters)}
    varied = tuple(replace(p, vary="run") if p.name in named else p for p in plant.spec.parameters)
    pooled = replace(plant, spec=replace(plant.spec, parameters=varied))
    progress(f"fitting {len(runs)} units together")
    model, own, warnings = _together(pooled, runs, seed, robust)
    like = _alike(plant, own, runs)
    if len(like) < len(runs):
        progress(f"fitting the {len(like)} units that are alike")
        model, own, warnings = _together(pooled, like, seed, robust)
    start = {name: float(np.median(list(each.values()))) for name, each in own.items()}
    center = {name: jnp.asarray(value) for name, value in start.items()}
    found = eqx.tree_at(lambda p: p.parameters, model.plant, model.plant.parameters | center)
    fleet = FleetRecord(start=start, laws={}, units=[], warnings=warnings)
    # between its runs were units, whose laws say how far they lie apart
    record = model.record.but(fleet=fleet, between=None)
    typical = Model(found, record).with_reading(how.said)
    return replace(typical, plant=base_of(plant, typical))


def _pool(plant: GrayBoxPlant, units: Sequence[Unit], how: How, despite_alarms: bool) -> list[Run]:
    """The longest run of some units each, spread over all of them, of `SAMPLES` in all."""
    count = min(POOL, len(units))
    chosen = [units[k] for k in np.linspace(0, len(units) - 1, count).round().astype(int)]
    rest = [each for each in units if each not in chosen]
    runs, failure = list[Run](), None
    for unit in (*chosen, *rest):
        try:
            found = runs_for_plant(plant.spec, [unit.source], how, fitting=True)
            if not despite_alarms:
                said = how.time, how.maps, how.where, None, how.time_format
                refuse_alarms(found, found.sources, *said)
        except InputError as wrong:  # it is named when its turn comes
            failure = failure or wrong
            continue
        longest = max(found, key=lambda run: len(run.t))
        runs.append(cut(replace(longest, name=unit.name), slice(0, SAMPLES // count)))
        if len(runs) == count:
            break
    if failure is not None and not runs:
        raise failure
    return runs


def _together(
    plant: GrayBoxPlant, runs: Sequence[Run], seed: int, robust: bool
) -> tuple[Model, dict[str, dict[str, float]], list[str]]:
    """(model, the runs' own values of every constant by its name, warnings)."""
    model, account = identification.fit(plant, runs, seed=seed, refine=True, robust=robust)
    assert account.refinement is not None
    return model, account.refinement.per_run, account.warnings


def _alike(plant: GrayBoxPlant, own: dict[str, dict[str, float]], runs: Sequence[Run]) -> list[Run]:
    """The runs whose constants are like those of the others."""
    parameters = own_parameters(plant.spec.parameters)
    values = np.array([[own[p.name].get(run.name, np.nan) for p in parameters] for run in runs])
    unlike = population(parameters, values, np.zeros_like(values)).unlike
    return [run for run, odds in zip(runs, unlike, strict=True) if odds < UNLIKE]


def base_of(plant: GrayBoxPlant, typical: Model) -> GrayBoxPlant:
    """`plant`, of the file, with what the fleet knows: what was left open is decided, networks and
    constants are the typical unit's."""
    choices = typical.record.choices
    settled = GrayBoxPlant.untrained(settle(plant.spec, choices.hold, choices.hidden))
    given = typical.plant
    return eqx.tree_at(
        lambda p: (p.networks, p.parameters), settled, (given.networks, given.parameters)
    )


def fleet_of(typical: Model) -> FleetRecord:
    """What its file tells of the fleet. Raises `InputError` where it is the model of no fleet."""
    if typical.record.fleet is None:
        raise InputError(
            f"{typical.plant.spec.name}: the model is no fleet's; give the fleet.fgm of a "
            "`faultgauge fit --fleet`."
        )
    return typical.record.fleet


def laws_of(typical: Model) -> dict[str, Law]:
    """How the units of a fleet differ, by parameter."""
    return {name: Law(**law.as_dict()) for name, law in fleet_of(typical).laws.items()}


def unit_plant(typical: Model, *, prior: bool) -> GrayBoxPlant:
    """A unit before its own logs are seen; with a `prior`, as uncertain as the fleet's laws say."""
    laws = laws_of(typical) if prior else {}
    centers = fleet_of(typical).start | {n: law.center for n, law in laws.items()}
    return with_population(typical.plant, typical.plant.networks, centers, laws)
