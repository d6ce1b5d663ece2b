"""The campaign file: TOML in, a checked `Plan` out. Every mistake is answered by its key."""

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import pydantic

from faultgauge.campaigns.axis import Axis, AxisOf
from faultgauge.errors import InputError
from faultgauge.plants.expression import unknown
from faultgauge.plants.plant_file import presets
from faultgauge.plants.signals import Entry
from faultgauge.plants.toml_file import Positive, SchemaTable, parse_toml, read_text, typed
from faultgauge.simulation.fault_tables import schedules
from faultgauge.simulation.scenario import Scenario, read_scenario
from faultgauge.simulation.schedules import Schedule

__all__ = [
    "HEALTHY",
    "MADE",
    "TRUTH",
    "Kind",
    "Maker",
    "Plan",
    "key_of",
    "label",
    "read_campaign",
]

MOST_RUNS = 100_000  # of a campaign; a longer one is a slip of the pen
LABEL = "+"  # between the two of a pair
MADE = TRUTH, _ = "truth", "fitted"  # models that are made for the campaign
HEALTHY = "healthy"

Count = Annotated[int, pydantic.Field(ge=0)]


class _Kind(SchemaTable):
    enters: Entry | None = None
    target: str | None = None
    effect: Literal["add", "stuck", "dropout"] | None = None
    profile: Literal["constant", "ramp", "intermittent"] = "constant"
    size: AxisOf | None = None
    lasts: Positive | None = None
    period: Positive | None = None
    duty: Positive | None = None
    named: list[str] | None = None


class Maker(SchemaTable):
    """Where the model that judges comes from: `model` is a model file, "truth" (the plant's own
    equations and constants) or "fitted"; the latter two are made on healthy runs, so many for the
    fit and for the calibration, of `plant` (None: the scenario's)."""

    model: str
    plant: str | None = None
    fit: Annotated[int, pydantic.Field(ge=1)] = 2
    calibrate: Annotated[int, pydantic.Field(ge=1)] = 3
    mtbfa: Positive | None = None


class _File(SchemaTable):
    name: str
    scenario: str
    design: Literal["grid", "random"] = "grid"
    runs: Annotated[int, pydantic.Field(ge=1)] | None = None
    seeds: Annotated[int, pydantic.Field(ge=1)] = 1
    healthy: Count = 0
    seed: Count = 0
    onset: AxisOf
    noise: AxisOf = Axis((1.0,))
    pairs: list[list[str]] = pydantic.Field(default_factory=list)
    judge: Maker
    faults: dict[str, _Kind]
    dispersions: dict[str, Positive] = pydantic.Field(default_factory=dict)


@dataclass(frozen=True)
class Kind:
    """A kind of fault: the `table` that a scenario file would have but for sizes and times; it
    `lasts` so long [s] (None: to the end). `named` are the names that count as right (None: those
    that the judge has for it; none at all: nothing should be named)."""

    name: str
    table: dict[str, Any]
    size: Axis | None
    lasts: float | None
    named: tuple[str, ...] | None

    @property
    def constant(self) -> bool:
        """Whether it stays as it begins."""
        return self.sized and self.table["profile"] == "constant" and self.lasts is None

    @property
    def sized(self) -> bool:
        """Whether more of it is more of a fault."""
        return self.table.get("effect", "add") == "add"

    def schedule(self, scenario: Scenario, size: float, onset: float) -> Schedule:
        """The fault as the scenario would have it; a dropout has no size."""
        table = {**self.table, "start": onset}
        if self.lasts is not None:
            table["end"] = onset + self.lasts
        if self.size is not None:
            table["size"] = size
        return schedules("faults", {self.name: table}, scenario.plant.signals, scenario.source)[0]


@dataclass(frozen=True, eq=False)
class Plan:
    """A checked campaign.

    `kinds` are single kinds and pairs, each in so many runs: at every point of a grid `seeds`
    times, or `runs` in all, drawn at `random`. `onset` is in s, `noise` a factor of the scenario's.
    `dispersions` are standard deviations of the plant's parameters between runs, as shares of
    their values. `content` is all that decides what comes out, as plain JSON; `reads` are the files
    that the campaign names.
    """

    name: str
    source: str
    folder: Path
    scenario: Scenario
    judge: Maker
    random: bool
    runs: int
    seeds: int
    healthy: int
    seed: int
    onset: Axis
    noise: Axis
    kinds: tuple[tuple[Kind, ...], ...]
    dispersions: dict[str, float]
    content: dict[str, Any] = field(repr=False)
    reads: tuple[Path, ...] = ()


def label(kinds: Sequence[Kind]) -> str:
    """ "friction", "friction+gain", or "healthy" """
    return LABEL.join(each.name for each in kinds) or HEALTHY


def read_campaign(path: str | Path) -> Plan:
    """Read a campaign file. Raises `InputError` naming the key of the first mistake."""
    path = Path(path)
    text = read_text(path, "campaign file", "give the path of a campaign file")
    tables = parse_toml(text, str(path))
    file = typed(_File, tables, str(path))
    scenario = read_scenario(path.parent / file.scenario)
    return _Checker(file, scenario, str(path), path.parent).plan(tables)


class _Checker:
    """Turns a well-typed file into a `Plan`, or says what makes no sense in it."""

    def __init__(self, file: _File, scenario: Scenario, source: str, folder: Path) -> None:
        self.file, self.scenario, self.source, self.folder = file, scenario, source, folder

    def fail(self, place: str, message: str) -> InputError:
        return InputError(f"{self.source}: {place} {message}.")

    def plan(self, tables: dict[str, Any]) -> Plan:
        file = self.file
        if self.scenario.faults:
            raise self.fail(
                f"scenario = {file.scenario!r}",
                "has [faults] of its own, which every run would have; remove them there, a "
                "campaign has its own",
            )
        self.check_times()
        self.check_noise()
        kinds = {name: self.kind(name, table) for name, table in file.faults.items()}
        groups = (*((each,) for each in kinds.values()), *self.pairs(kinds))
        self.check_count(groups)
        self.check_dispersions()
        read = self.files()
        hashes = {n: hashlib.sha256(path.read_bytes()).hexdigest() for n, path in read.items()}
        return Plan(
            name=file.name,
            source=self.source,
            folder=self.folder,
            scenario=self.scenario,
            judge=file.judge,
            random=file.design == "random",
            runs=file.runs or 0,
            seeds=file.seeds,
            healthy=file.healthy,
            seed=file.seed,
            onset=file.onset,
            noise=file.noise,
            kinds=groups,
            dispersions=dict(file.dispersions),
            content={"campaign": tables, "files": hashes},
            reads=tuple(read.values()),
        )

    def check_times(self) -> None:
        seconds = self.scenario.samples * self.scenario.step
        low, high = self.file.onset.ends
        if low <= 0 or high >= seconds:
            raise self.fail(
                "onset", f"has to lie within the run, between 0 and {seconds:g} s; correct it"
            )

    def check_noise(self) -> None:
        if self.file.noise.ends[0] < 0:
            raise self.fail("noise", "is a factor of the scenario's and cannot be negative")

    def kind(self, name: str, table: _Kind) -> Kind:
        place = f"[faults.{name}]"
        if not name.isidentifier() or name == HEALTHY:
            raise self.fail(place, f"{name!r} is not a name of a fault; use letters, digits, _")
        dropout = table.effect == "dropout"
        if dropout != (table.size is None):
            what = "is a dropout and has no size; remove it" if dropout else "is missing; add it"
            raise self.fail(f"{place} size", what)
        if table.size is not None and 0.0 in table.size.values and table.effect != "stuck":
            raise self.fail(f"{place} size", "of 0 is no fault; runs without one are `healthy`")
        if table.profile == "ramp" and table.lasts is None:
            raise self.fail(f"{place} lasts", "is missing: how long a ramp grows [s]; add it")
        more = {"period": table.period, "duty": table.duty}
        if table.profile != "intermittent" and any(v is not None for v in more.values()):
            raise self.fail(f"{place} period and duty", 'are of profile = "intermittent" alone')
        given = {"enters": table.enters, "target": table.target, "effect": table.effect, **more}
        body = {key: value for key, value in given.items() if value is not None}
        found = Kind(
            name,
            {**body, "profile": table.profile},
            table.size,
            table.lasts,
            None if table.named is None else tuple(table.named),
        )
        if len(found.named or ()) > 2:
            raise self.fail(f"{place} named", "holds more than two names, which tells nothing")
        try:
            found.schedule(self.scenario, 1.0, self.file.onset.values[0])
        except InputError as wrong:
            raise InputError(f"{self.source}: {wrong}") from None
        return found

    def pairs(self, kinds: dict[str, Kind]) -> list[tuple[Kind, ...]]:
        found = []
        for pair in self.file.pairs:
            for name in pair:
                if name not in kinds:
                    raise self.fail("pairs", unknown("fault", name, kinds))
            if len(set(pair)) != 2:
                raise self.fail(f"pairs: {pair}", "has to be two different faults")
            found.append(tuple(kinds[name] for name in pair))
        return found

    def check_count(self, groups: Sequence[tuple[Kind, ...]]) -> None:
        file = self.file
        if (file.design == "random") != (file.runs is not None):
            raise self.fail(
                "runs",
                "is of a random design: how many runs have faults; a grid has `seeds` at every "
                "point; add or remove it",
            )
        if not groups:
            raise self.fail("[faults]", "holds no fault, so the grid is empty; add one at least")
        cells = sum(_points(group) for group in groups)
        cells *= len(file.onset.values) * len(file.noise.values) * file.seeds
        count = (cells if file.runs is None else file.runs) + file.healthy
        if count > MOST_RUNS:
            raise self.fail("the design", f"has {count} runs; give {MOST_RUNS} at most")

    def check_dispersions(self) -> None:
        parameters = self.scenario.plant.parameters
        for name, share in self.file.dispersions.items():
            if name not in parameters:
                raise self.fail("[dispersions]", unknown("parameter", name, parameters))
            if share > 1:
                raise self.fail(
                    f"[dispersions] {name} = {share:g}", "is a share of its value; give 1 at most"
                )

    def files(self) -> dict[str, Path]:
        """All that the campaign is made of, by their names in it."""
        file, judge = self.file, self.file.judge
        names = [file.scenario, *([judge.plant] if judge.plant else []), judge.model]
        read = {name: self.folder / name for name in names}
        read |= {os.path.relpath(each, self.folder): each for each in self.scenario.reads}
        found = {name: path for name, path in read.items() if path.is_file()}
        if judge.model not in (*MADE, *found):
            legal = ", ".join(f'"{each}"' for each in MADE)
            raise self.fail(
                f"[judge] model = {judge.model!r}",
                f"is no file; give a calibrated model (.fgm), or one of {legal}",
            )
        if judge.plant and judge.plant not in (*found, *presets()):
            raise self.fail(
                f"[judge] plant = {judge.plant!r}",
                f"is no file; give a plant file or one of the presets {', '.join(presets())}",
            )
        return found


def _points(group: Sequence[Kind]) -> int:
    found = 1
    for each in group:
        found *= len(each.size.values) if each.size else 1
    return found


def key_of(content: Any) -> str:
    """A hash of plain JSON."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
