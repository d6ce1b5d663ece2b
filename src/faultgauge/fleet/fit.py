"""`fit --fleet`: a model for every unit, and what the fleet tells of its next one."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Unpack

import jax.numpy as jnp
import numpy as np

from faultgauge.crew.crew import Crew, Done, crew
from faultgauge.errors import InputError
from faultgauge.fleet.folder import (
    FLEET,
    check_some,
    fleet_file,
    folder_for,
    land,
    model_path,
    models_in,
    unit_file,
    unit_of,
)
from faultgauge.fleet.result import FleetFit, UnitFit, failures
from faultgauge.fleet.typical import fleet_of, laws_of, typical_unit, unit_plant
from faultgauge.fleet.units import Unit, units_in
from faultgauge.identification.population import Law, Population, own_parameters, population
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.model import Model, decoded, encoded, load_model, save_model
from faultgauge.plants.record import LawRecord, UnitRecord
from faultgauge.telemetry import Run, cut
from faultgauge.verbs.fit import fit
from faultgauge.verbs.how import How, Reading, reads
from faultgauge.verbs.plants import plant as as_plant
from faultgauge.verbs.reading import Runs, runs_for_plant

__all__ = ["FitJob", "fit_fleet"]

VAGUE = 0.5  # of a fleet's spread: a unit that knows less of a constant leans on the fleet


@dataclass(frozen=True)
class FitJob:
    """A model of one unit: its constants alone where there is a `typical` unit of the fleet (the
    bytes of its model file), with its laws as `prior` where asked for. `own` are what units were
    before they leaned on the fleet."""

    text: str
    typical: bytes | None
    prior: bool
    how: How
    seed: int
    robust: bool
    despite_alarms: bool
    own: dict[str, dict[str, Any]] = field(default_factory=dict)

    def __call__(self, unit: Unit) -> Done:
        plant = as_plant(self.text)
        runs = runs_for_plant(plant.spec, [unit.source], self.how, fitting=True)
        check_excited(plant, runs)
        given = {
            "seed": self.seed,
            "robust": self.robust,
            "despite_alarms": self.despite_alarms,
        }
        if self.typical is None:
            found = fit(plant, runs, **given)
            model = found.model
        else:
            typical = decoded(self.typical, FLEET)
            shorter = [cut(run, slice(0, common_length(len(run.t)))) for run in runs]
            runs = Runs(shorter, runs.sources, runs.how)
            found = fit(unit_plant(typical, prior=self.prior), runs, restarts=1, **given)
            model = replace(found.model, plant=replace(found.model.plant, spec=typical.plant.spec))
            if "choices" in typical.record.model_fields_set:
                model = Model(model.plant, model.record.but(choices=typical.record.choices))
        constants = {each.name: each for each in _constants(found)}
        own = {
            p.name: (found.parameters[p.name], constants[p.name].by_chance)
            for p in own_parameters(plant.spec.parameters)
            if p.name in constants
        }
        told = UnitRecord(
            samples=sum(len(run.t) for run in runs),
            seconds=float(sum(run.t[-1] - run.t[0] for run in runs)),
            constants=own,
            own=self.own.get(unit.name, {}) if self.prior else own,
            prior=self.prior,
            warnings=list(found.account.warnings),
        )
        model = Model(model.plant, model.record.but(unit=told), model.members)
        return Done(unit.name, {unit_file(unit.name): encoded(model)})


def _constants(found: Any) -> Sequence[Any]:
    account = found.account
    known = account.refinement.information if account.refinement else account.information
    return known.constants if known else ()


def common_length(count: int) -> int:
    """As many of `count` samples as make a length that other logs have too, 8 to an octave: each
    length is a program to compile, and constants do not miss the rest."""
    step = 1 << max(count.bit_length() - 4, 0)
    return count // step * step


def check_excited(plant: GrayBoxPlant, runs: Sequence[Run]) -> None:
    """Raises `InputError` where an input never moves."""
    for name in plant.signals.input_names:
        values = np.concatenate([run.columns[name] for run in runs])
        if not np.nanmax(values) > np.nanmin(values):
            raise InputError(
                f"{runs[0].source}: input {name!r} never changes, so that what it does cannot be "
                "learned (no excitation); give a log of this unit in which it moves."
            )


@reads
def fit_fleet(
    plant: Any,
    logs: Any,
    out: str | Path,
    *,
    prior: str | Path | None = None,
    again: bool = False,
    scheduler: str | None = None,
    seed: int = 0,
    robust: bool = False,
    despite_alarms: bool = False,
    progress: Callable[[str], None] = lambda text: None,
    **reading: Unpack[Reading],
) -> FleetFit:
    """Learn a model for every unit of a fleet, and what the fleet tells of its next one.

    Networks are shared: some units are fitted together first. Constants are each unit's own, and
    the fleet tells their mean and spread. A unit whose own log says too little of one is fitted
    again with the fleet as its prior. A plant without free parameters shares nothing: every unit
    is fitted by itself.

    **Arguments**

    - `plant`: a plant file, a preset, the text of a plant file, or a dict.
    - `logs`: a folder with a log, or a folder of logs, for every unit; several such paths; or one
      file with a column `unit`.
    - `out`: the folder for `fleet.fgm`, `units/NAME.fgm` and `units.csv`. Units whose model is
      there are not fitted `again` unless that is asked for.
    - `prior`: the file or the folder of a fleet: units are fitted with its networks, and constants
      that lean on what it tells of them, which asks for a few minutes of log only.
    - `scheduler`: `"local"`, or the address of a Dask scheduler; here, without.
    - `seed`, `robust`, `despite_alarms` as in `fit`; `time`, `time_format`, `map`, `where` and
      `resample` as in `read`; `progress` is told what is being done.

    Returns a `FleetFit` of all units in `out`. Raises `InputError` for logs that are not those of a
    fleet, and where no unit can be fitted.
    """
    untrained, how = as_plant(plant), How(**reading)
    units, text = units_in(logs), untrained.spec.text
    typical = None if prior is None else _prior(fleet_file(prior), text)
    folder = _folder(out, logs, text)
    todo = [u for u in units if again or not model_path(folder, u.name).is_file()]
    shares = typical is None and bool(own_parameters(untrained.spec.parameters))
    with crew(scheduler, progress) as workers:
        if shares:
            given = {"seed": seed, "robust": robust, "despite_alarms": despite_alarms}
            typical = _typical(folder, again, untrained, units, how, progress=progress, **given)
        data = typical and encoded(typical)
        job = FitJob(text, data, prior is not None, how, seed, robust, despite_alarms)
        failed = land(workers, job, todo, folder, len(todo), "fitting", progress)
        fitted = [unit for unit in units if model_path(folder, unit.name).is_file()]
        check_some(failed, {unit.name for unit in fitted})
        if shares and typical is not None:
            typical, lost = _with_the_fleet(workers, job, fitted, typical, folder, progress)
            failed |= lost
    told = {name: UnitFit.of(model) for name, model in models_in(folder)}
    before = len(told.keys() - {unit.name for unit in todo})
    known = fleet_of(typical).warnings if shares and typical is not None else []
    warnings = [*known, *failures(failed)]
    return FleetFit(untrained.spec, folder, typical, told, failed, before, warnings).written()


def _with_the_fleet(
    workers: Crew,
    job: FitJob,
    units: Sequence[Unit],
    typical: Model,
    folder: Path,
    progress: Callable[[str], None],
) -> tuple[Model, dict[str, str]]:
    """(the typical unit with the laws of its units, who failed) once those of `units` that know too
    little of themselves are fitted again, with the fleet as their prior."""
    typical, own = _with_laws(as_plant(job.text), typical, folder)
    weak = [unit for unit in units if _leans(folder, unit, own, typical)]
    job = replace(job, typical=encoded(typical), prior=True, own=own)
    failed = land(workers, job, weak, folder, len(weak), "with the fleet", progress)
    save_model(typical, folder / FLEET)
    return typical, failed


def _prior(path: Path, text: str) -> Model:
    typical = load_model(path)
    if typical.record.fleet is None or not typical.record.fleet.laws:
        raise InputError(
            f"{path}: tells nothing of the units to come, because it is no fleet's or fewer than "
            "four units are behind it; give the fleet.fgm of a `faultgauge fit --fleet`."
        )
    if typical.plant.spec.text != text:
        raise InputError(
            f"{path}: is a fleet of another plant file; give that file, or fit the fleet anew."
        )
    return typical


def _typical(
    folder: Path, again: bool, plant: GrayBoxPlant, units: Sequence[Unit], how: How, **given: Any
) -> Model:
    """The typical unit: the one in `folder`, or one found, `again`, which is then there."""
    kept = folder / FLEET
    if kept.is_file() and not again:
        return load_model(kept)
    typical = typical_unit(plant, units, how, **given)
    save_model(typical, kept)
    return typical


def _folder(out: str | Path, logs: Any, text: str) -> Path:
    """Where models go. Raises `InputError` where those that are there are of another plant."""
    folder = folder_for(out, logs)
    for path in (folder / FLEET, *(folder / unit_file("_")).parent.glob("*")):
        if path.is_file() and load_model(path).plant.spec.text != text:
            raise InputError(
                f"{path}: is of another plant file; give another folder for --out, or remove it."
            )
        if path.is_file():
            break
    return folder


def _with_laws(
    untrained: GrayBoxPlant, typical: Model, folder: Path
) -> tuple[Model, dict[str, Any]]:
    """(the typical unit with the laws that its units tell, what each says of its own constants)."""
    own = {name: unit_of(model).own for name, model in models_in(folder)}
    own = {name: each for name, each in own.items() if each}
    parameters = own_parameters(untrained.spec.parameters)
    found = laws_from(parameters, own)
    centers = {name: jnp.asarray(law.center) for name, law in found.laws.items()}
    plant = typical.plant
    plant = replace(plant, parameters=plant.parameters | centers)
    told = {
        "laws": {name: LawRecord(**law.to_dict()) for name, law in found.laws.items()},
        "units": list(own),
        "unlike": dict(zip(own, found.unlike.tolist(), strict=True)),
    }
    fleet = fleet_of(typical).model_copy(update=told)
    return Model(plant, typical.record.but(fleet=fleet)), own


def laws_from(parameters: Sequence[Any], own: dict[str, Any]) -> Population:
    """What [value, standard error or None] by unit and constant tell of the fleet."""
    cells = [[own[unit].get(p.name, [np.nan, None]) for p in parameters] for unit in own]
    values = np.array([[value for value, _ in row] for row in cells], float)
    errors = np.array([[np.nan if e is None else e for _, e in row] for row in cells], float)
    shape = len(own), len(parameters)
    return population(parameters, values.reshape(shape), errors.reshape(shape))


def _leans(folder: Path, unit: Unit, own: dict[str, Any], typical: Model) -> bool:
    """Whether a unit's own log tells too little, and it does not lean on the fleet yet."""
    if unit.name not in own or not _vague(own[unit.name], laws_of(typical)):
        return False
    return not unit_of(load_model(model_path(folder, unit.name))).prior


def _vague(own: dict[str, Any], laws: dict[str, Law]) -> bool:
    """Whether a unit knows a constant less well than leaning on the fleet would tell it."""

    def vague(law: Law, value: float, error: float | None) -> bool:
        return error is None or error > VAGUE * law.spread * (abs(value) if law.log else 1.0)

    return any(vague(laws[name], *each) for name, each in own.items() if name in laws)
