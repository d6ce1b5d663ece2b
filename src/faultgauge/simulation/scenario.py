"""The scenario file: TOML in, a checked `Scenario` out. Every mistake is answered by its key."""

import math
import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pydantic
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.plants.expression import unknown
from faultgauge.plants.gray_box import GrayBoxPlant, load_plant
from faultgauge.plants.model import load_model
from faultgauge.plants.plant_file import presets
from faultgauge.plants.toml_file import (
    Number,
    Positive,
    SchemaTable,
    parse_toml,
    read_text,
    typed,
    values_in,
)
from faultgauge.simulation.closed_loop import Controller
from faultgauge.simulation.fault_tables import schedules
from faultgauge.simulation.satellite.observatory import (
    MOMENTA,
    PERIOD,
    SLEW,
    STEPS_PER_PERIOD,
    Three,
)
from faultgauge.simulation.schedules import Schedule
from faultgauge.simulation.sources import SOURCES, Source

__all__ = [
    "MOST_STEPS",
    "TRUTH",
    "Drive",
    "Flight",
    "Scenario",
    "parse_scenario",
    "read_scenario",
    "trained_plant",
]

MOST_STEPS = 20_000_000  # integration steps: 1 to 2 GB while they run
TRUTH = "true_"

Tables = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Drive:
    """An input or a reference over time: `offset` plus its source (None: nothing more)."""

    source: Source | None = None
    offset: float = 0.0


@dataclass(frozen=True)
class Flight:
    """The plant as the wheels of a satellite: whose log is kept (`axis`), how far it is turned at
    first [deg], the wheels' first momenta; roll, pitch, yaw."""

    axis: str
    angles: Three
    momenta: Three


@dataclass(frozen=True, eq=False)
class Scenario:
    """A checked scenario: one entry per input, output or state, in the plant's order.

    Samples are `step` [s] apart; every `log_every`-th is logged. `substeps` is None where the
    plant decides. `folder` is where relative paths start. With a `flight` a satellite's attitude
    controller sets the inputs, and those of the file are empty. `accommodation` is that table of
    the file as it stands, to be read by `faultgauge.accommodation.table`. `reads` are the files
    that the file names.
    """

    name: str
    source: str
    folder: Path
    plant: GrayBoxPlant
    step: float
    samples: int
    substeps: int | None
    log_every: int
    seed: int
    x0: Float[np.ndarray, "states"]
    inputs: tuple[Drive, ...]
    references: tuple[Drive, ...]
    controller: Controller
    sigma: Float[np.ndarray, "outputs"]
    faults: tuple[Schedule, ...]
    disturbances: tuple[Schedule, ...]
    flight: Flight | None = None
    accommodation: dict[str, Any] | None = None
    reads: tuple[Path, ...] = ()


# The file's schema, as pydantic sees it; sources and profiles are typed by their kind, below.
class _Driven(SchemaTable):
    source: str | None = None
    offset: Number = 0.0


class _Feedback(SchemaTable):
    kp: Number = 0.0
    ki: Number = 0.0


_Three = Annotated[list[Number], pydantic.Field(min_length=3, max_length=3)]


class _Satellite(SchemaTable):
    axis: Literal["roll", "pitch", "yaw"] = "pitch"
    angles: _Three = pydantic.Field(default_factory=lambda: [*SLEW])
    momenta: _Three = pydantic.Field(default_factory=lambda: [*MOMENTA])


class _File(SchemaTable):
    name: str
    plant: str
    satellite: _Satellite | None = None
    seconds: Positive
    step: Positive
    substeps: Annotated[int, pydantic.Field(ge=1, le=10_000)] | None = None
    log_every: Annotated[int, pydantic.Field(ge=1)] = 1
    seed: Annotated[int, pydantic.Field(ge=0)] = 0
    parameters: dict[str, Number] = pydantic.Field(default_factory=dict)
    initial: dict[str, Number] = pydantic.Field(default_factory=dict)
    noise: dict[str, Annotated[float, pydantic.Field(ge=0, allow_inf_nan=False)]] = pydantic.Field(
        default_factory=dict
    )
    inputs: Tables = pydantic.Field(default_factory=dict)
    references: Tables = pydantic.Field(default_factory=dict)
    faults: Tables = pydantic.Field(default_factory=dict)
    disturbances: Tables = pydantic.Field(default_factory=dict)
    accommodation: dict[str, Any] | None = None


def read_scenario(path: str | Path, plant: GrayBoxPlant | None = None) -> Scenario:
    """Read a scenario file; `plant` stands in place of the one that it names. Raises `InputError`
    naming the key of the first mistake."""
    path = Path(path)
    text = read_text(path, "scenario file", "give the path of a scenario file")
    return parse_scenario(text, str(path), path.parent, plant)


def parse_scenario(
    text: str,
    source: str = "scenario",
    folder: Path = Path(),
    plant: GrayBoxPlant | None = None,
) -> Scenario:
    """Check the text of a scenario file; relative paths in it start at `folder`."""
    tables = parse_toml(text, source)
    file = typed(_File, tables, source)
    if plant is None:
        plant = trained_plant(file.plant, f"{source}: plant", folder)
    texts = [each for _, each in values_in(tables) if isinstance(each, str)]
    reads = tuple(folder / each for each in texts if os.path.isfile(folder / each))
    return replace(_Checker(file, plant, source, folder).scenario(), reads=reads)


def trained_plant(name: str, where: str, folder: Path) -> GrayBoxPlant:
    """A preset, a plant file or a model by its `name` in a scenario; `where` says at which key."""
    path = folder / name
    if name in presets() and not os.path.isfile(path):
        plant = load_plant(name)
    elif not os.path.isfile(path):
        legal = "a plant file, a model (.fgm) or one of the presets " + ", ".join(presets())
        raise InputError(f"{where} = {name!r}: {path} is no file; give {legal}.")
    elif path.suffix == ".fgm":
        return load_model(path).plant
    else:
        plant = load_plant(path)
    if plant.networks:
        raise InputError(
            f"{where} = {name!r}: its networks ({', '.join(plant.networks)}) are "
            "untrained, so there is nothing to simulate; give a model made by `faultgauge fit`."
        )
    return plant


class _Checker:
    """Turns a well-typed file into a `Scenario`, or says what makes no sense in it."""

    def __init__(self, file: _File, plant: GrayBoxPlant, source: str, folder: Path) -> None:
        self.file, self.plant, self.source, self.folder = file, plant, source, folder

    def fail(self, place: str, message: str) -> InputError:
        return InputError(f"{self.source}: {place} {message}.")

    def scenario(self) -> Scenario:
        file, signals = self.file, self.plant.signals
        self.known("noise", file.noise, "output", signals.output_names)
        sigma = [file.noise.get(o.name, o.sigma or 0.0) for o in signals.outputs]
        controller = self.controller()
        faults = schedules("faults", file.faults, signals, self.source)
        self.check_columns(faults)
        return Scenario(
            name=file.name,
            source=self.source,
            folder=self.folder,
            plant=self.with_parameters(),
            step=float(file.step),
            samples=self.samples(),
            substeps=file.substeps,
            log_every=file.log_every,
            seed=file.seed,
            x0=self.initial(),
            flight=self.flight(),
            inputs=() if file.satellite else self.inputs(),
            references=self.references(controller),
            controller=controller,
            sigma=np.array(sigma, float),
            faults=faults,
            disturbances=schedules("disturbances", file.disturbances, signals, self.source),
            accommodation=file.accommodation,
        )

    def flight(self) -> Flight | None:
        """What a satellite needs: a wheel, its own controller, and its own sample time."""
        file, signals = self.file, self.plant.signals
        if file.satellite is None:
            return None
        measures = [output.measures for output in signals.outputs]
        if (len(signals.states), len(signals.inputs)) != (1, 1) or measures != [
            None,
            signals.state_names[0],
        ]:
            raise self.fail(
                f"[satellite] plant = {file.plant!r}",
                "is no reaction wheel; a wheel has one state (momentum), one input (torque) and "
                "two outputs, torque and then momentum, as the preset reaction_wheel has",
            )
        for key in ("inputs", "references", "initial"):
            if getattr(file, key):
                raise self.fail(
                    f"[{key}]",
                    "has no use beside [satellite], whose controller sets the torque; remove it "
                    "(first momenta stand in [satellite] momenta)",
                )
        if file.step != PERIOD or file.substeps not in (None, STEPS_PER_PERIOD):
            raise self.fail(
                f"step = {file.step:g}:",
                f"the satellite's controller works every {PERIOD:g} s in {STEPS_PER_PERIOD} "
                f"substeps; write step = {PERIOD:g}, no substeps, and thin the log by log_every",
            )
        roll, pitch, yaw = file.satellite.angles
        first, second, third = file.satellite.momenta
        return Flight(file.satellite.axis, (roll, pitch, yaw), (first, second, third))

    def known(self, table: str, given: Collection[str], kind: str, legal: Collection[str]) -> None:
        for name in given:
            if name not in legal:
                raise self.fail(f"[{table}]", unknown(kind, name, legal))

    def samples(self) -> int:
        """How many samples lie in [0, seconds)."""
        file = self.file
        count = math.ceil(min(file.seconds / file.step, 1e9) * (1 - 1e-12))
        if count * (file.substeps or 1) > MOST_STEPS:
            raise self.fail(
                f"seconds = {file.seconds:g}, step = {file.step:g}:",
                f"more than {MOST_STEPS} integration steps; shorten the run or lengthen the step",
            )
        if count <= file.log_every:
            shortest = file.log_every * file.step
            raise self.fail(
                f"seconds = {file.seconds:g}:",
                f"the log would have fewer than two rows; give more than {shortest:g} s",
            )
        return count

    def with_parameters(self) -> GrayBoxPlant:
        plant, given = self.plant, self.file.parameters
        self.known("parameters", given, "parameter", plant.parameters)
        for parameter in plant.spec.parameters:
            self.inside("parameters", given, parameter)
        changed = {n: jnp.asarray(given.get(n, v), float) for n, v in plant.parameters.items()}
        return eqx.tree_at(lambda p: p.parameters, plant, changed)

    def initial(self) -> Float[np.ndarray, "states"]:
        signals, given = self.plant.signals, self.file.initial
        self.known("initial", given, "state", signals.state_names)
        for state in signals.states:
            self.inside("initial", given, state)
        return np.array([given.get(s.name, s.initial) for s in signals.states], float)

    def inside(self, table: str, given: Mapping[str, float], limits: Any) -> None:
        value = given.get(limits.name)
        if value is not None and not limits.min <= value <= limits.max:
            raise self.fail(
                f"[{table}] {limits.name} = {value:g}",
                f"lies outside [{limits.min:g}, {limits.max:g}], where the plant has it",
            )

    def inputs(self) -> tuple[Drive, ...]:
        given, names = self.file.inputs, self.plant.signals.input_names
        for name in names:
            if name not in given:
                raise self.fail("[inputs]", f"has no table for {name!r}; every input needs one")
        return tuple(self.drive(f"inputs.{name}", given[name], "feedback") for name in names)

    def references(self, controller: Controller) -> tuple[Drive, ...]:
        given, names = self.file.references, self.plant.signals.output_names
        self.known("references", given, "output", names)
        used = np.any(np.asarray(controller.kp) != 0, axis=0)
        used |= np.any(np.asarray(controller.ki) != 0, axis=0)
        for name in given:
            if not used[names.index(name)]:
                raise self.fail(
                    f"[references.{name}]",
                    f"has no use: no input has feedback of {name!r}; add one or remove it",
                )
        return tuple(
            self.drive(f"references.{name}", given[name]) if name in given else Drive()
            for name in names
        )

    def drive(self, table: str, data: dict[str, Any], *also: str) -> Drive:
        where = f"{self.source}: [{table}]"
        data = {key: value for key, value in data.items() if key not in also}
        own = {key: data.pop(key) for key in ("source", "offset") if key in data}
        head = typed(_Driven, own, where, also=also)
        if head.source is None:
            if data or not also:
                legal = ", ".join(SOURCES)
                raise self.fail(f"[{table}]", f"key 'source' is missing; legal: {legal}")
            return Drive(None, head.offset)
        if head.source not in SOURCES:
            raise self.fail(f"[{table}] source:", unknown("source", head.source, SOURCES))
        body = typed(SOURCES[head.source], data, where, also=("source", "offset", *also))
        return Drive(body, head.offset)

    def controller(self) -> Controller:
        signals, given = self.plant.signals, self.file.inputs
        self.known("inputs", given, "input", signals.input_names)
        kp = np.zeros((len(signals.inputs), len(signals.outputs)))
        ki = kp.copy()
        for i, each in enumerate(signals.inputs):
            place = f"inputs.{each.name}.feedback"
            tables = given.get(each.name, {}).get("feedback", {})
            if not isinstance(tables, dict) or not all(
                isinstance(table, dict) for table in tables.values()
            ):
                raise self.fail(f"[{place}]", f"should hold a table per output, as [{place}.NAME]")
            self.known(place, tables, "output", signals.output_names)
            if tables and each.hold != "zero":
                raise self.fail(
                    f"[{place}]",
                    f'needs an input that is held, but the plant says hold = "{each.hold}"; nobody '
                    "knows the next command before its sample",
                )
            for name, table in tables.items():
                gains = typed(_Feedback, table, f"{self.source}: [{place}.{name}]")
                j = signals.output_names.index(name)
                kp[i, j], ki[i, j] = gains.kp, gains.ki
        return Controller(jnp.asarray(kp), jnp.asarray(ki))

    def check_columns(self, faults: tuple[Schedule, ...]) -> None:
        """The log's columns for the truth must not be anything else."""
        signals = self.plant.signals
        taken = {*signals.input_names, *signals.output_names, *signals.state_names}
        for fault in faults:
            if not fault.name.isidentifier():
                raise self.fail("[faults]", f"{fault.name!r} is not a name; use letters, digits, _")
            if TRUTH + fault.name in taken:
                raise self.fail(
                    f"[faults.{fault.name}]",
                    f"its truth, {TRUTH}{fault.name}, is a signal of the plant; rename it",
                )
