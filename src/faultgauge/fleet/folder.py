"""The folder of a fleet: `fleet.fgm`, `units/NAME.fgm`, and `units.csv` with a row per unit.

Every file is there whole or not at all, so that a call that was ended is gone on with.
"""

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from faultgauge.crew.crew import Crew, Done, Job
from faultgauge.errors import InputError
from faultgauge.files import read_within, write_atomically
from faultgauge.fleet.units import Unit
from faultgauge.plants.model import Model, load_model
from faultgauge.plants.record import UnitRecord
from faultgauge.progress import Step

__all__ = [
    "FLEET",
    "check_some",
    "fleet_file",
    "folder_for",
    "land",
    "model_path",
    "models_in",
    "unit_file",
    "unit_of",
    "with_models",
]

FLEET, UNITS, ENDING = "fleet.fgm", "units", ".fgm"
LARGEST = 100_000_000  # bytes of a model file


def folder_for(path: str | Path, logs: Iterable[str | Path]) -> Path:
    """`path` as a folder with room for units, made where it is missing. Raises `InputError` where
    it is among the `logs`, which what is written would become some of."""
    folder = Path(path)
    for each in map(Path, logs):
        if folder.resolve().is_relative_to(each.resolve()):
            raise InputError(
                f"{path}: lies in {each}, where all is log of a unit; give a folder elsewhere."
            )
    try:
        folder.mkdir(exist_ok=True)
    except OSError as failure:
        raise InputError(
            f"{path}: cannot be made a folder ({failure.strerror}); choose another name."
        ) from None
    return folder


def unit_file(unit: str) -> str:
    """Name of a unit's model file within the folder of its fleet."""
    return f"{UNITS}/{unit}{ENDING}"


def model_path(folder: Path, unit: str) -> Path:
    """Where the model of `unit` stands in a fleet's `folder`."""
    return folder / unit_file(unit)


def fleet_file(given: str | Path) -> Path:
    """A fleet's own file: `given`, or the one in that folder."""
    path = Path(given)
    return path / FLEET if path.is_dir() else path


def models_in(folder: Path) -> Iterator[tuple[str, Model]]:
    """The units that have a model, by name, one at a time."""
    for path in sorted((folder / UNITS).glob(f"*{ENDING}")):
        model = load_model(path)
        if model.record.unit is None:
            raise InputError(
                f"{path}: is no unit of a fleet; move it elsewhere, or fit it with --fleet."
            )
        yield path.name.removesuffix(ENDING), model


def unit_of(model: Model) -> UnitRecord:
    """What the model of a unit tells of it; `models_in` sees to it that it does."""
    assert model.record.unit is not None
    return model.record.unit


def with_models(folder: Path, units: Iterable[Unit]) -> Iterator[Unit]:
    """`units` with the bytes of their models, which are read when they are asked for."""
    for unit in units:
        path = model_path(folder, unit.name)
        known = path.is_file()
        yield (
            replace(unit, model=read_within(path, LARGEST, "no model file does")) if known else unit
        )


def land(
    crew: Crew,
    job: Job,
    units: Iterable[Unit],
    folder: Path,
    count: int,
    what: str,
    progress: Callable[[str], None],
) -> dict[str, str]:
    """Has the `crew` do `units`, and writes their files to `folder`; gives why some failed, by
    name. `count` is how many they are and `what` is being done, for `progress`."""
    failed = {}
    for k, outcome in enumerate(crew(job, units), 1):
        if isinstance(outcome, Done):
            for name, data in outcome.files.items():
                path = folder / name
                path.parent.mkdir(exist_ok=True)
                write_atomically(path, data)
        else:
            failed[outcome.name] = outcome.why
        progress(Step(f"{what}: {k} of {count} units", k / count))
    return dict(sorted(failed.items()))


def check_some(failed: dict[str, str], done: Collection[str]) -> None:
    """Raises `InputError` where every unit failed."""
    if failed and not done:
        first, why = next(iter(failed.items()))
        raise InputError(
            f"none of the {len(failed)} units could be done; the first, {first}: {why}"
        )
