"""Tables of a scenario file that become signals: sizes over time, noise, sweeps, recorded logs."""

import abc
import math
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import pydantic
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.excitation.multisine import multisine
from faultgauge.excitation.noise import band_limited_noise
from faultgauge.excitation.sweep import triangles
from faultgauge.plants.toml_file import Number, Positive, SchemaTable
from faultgauge.simulation.schedules import Constant, Intermittent, Profile, Ramp, Sine, Steps
from faultgauge.telemetry import read_telemetry

__all__ = ["PROFILES", "SOURCES", "ProfileTable", "SampleClock", "Source"]


class SampleClock(NamedTuple):
    """When the samples of a scenario are, and how a signal runs between those of a log."""

    t: Float[np.ndarray, "samples"]
    dt: float
    linear: bool
    folder: Path  # relative paths start here


class Source(SchemaTable, abc.ABC):
    """What an input or a reference is made of."""

    @abc.abstractmethod
    def signal(self, clock: SampleClock, rng: np.random.Generator) -> Float[np.ndarray, "samples"]:
        """Its values at the samples. Raises `InputError` where they cannot be had."""


class ProfileTable(Source):
    """Sizes over time, for inputs, references and faults alike."""

    @abc.abstractmethod
    def profile(self) -> Profile: ...

    def signal(self, clock: SampleClock, rng: np.random.Generator) -> Float[np.ndarray, "samples"]:
        return self.profile().sizes(clock.t)


class _Constant(ProfileTable):
    size: Number
    start: Number = 0.0
    end: Number | None = None

    @pydantic.model_validator(mode="after")
    def _forwards(self) -> "_Constant":
        _check_end(self.start, self.end)
        return self

    def profile(self) -> Profile:
        return Constant(self.size, self.start, math.inf if self.end is None else self.end)


class _Steps(ProfileTable):
    times: Annotated[list[Number], pydantic.Field(min_length=1)]
    values: list[Number]

    @pydantic.model_validator(mode="after")
    def _pairs(self) -> "_Steps":
        if len(self.times) != len(self.values):
            raise ValueError(
                f"{len(self.times)} times but {len(self.values)} values; each value holds from "
                "its time on"
            )
        if any(a >= b for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ValueError(f"times = {self.times} must increase")
        return self

    def profile(self) -> Profile:
        return Steps(tuple(self.times), tuple(self.values))


class _Ramp(ProfileTable):
    size: Number
    start: Number
    end: Number

    @pydantic.model_validator(mode="after")
    def _forwards(self) -> "_Ramp":
        _check_end(self.start, self.end)
        return self

    def profile(self) -> Profile:
        return Ramp(self.size, self.start, self.end)


class _Intermittent(ProfileTable):
    size: Number
    period: Positive
    start: Number = 0.0
    end: Number | None = None
    duty: Annotated[float, pydantic.Field(gt=0, le=1, allow_inf_nan=False)] = 0.5

    @pydantic.model_validator(mode="after")
    def _forwards(self) -> "_Intermittent":
        _check_end(self.start, self.end)
        return self

    def profile(self) -> Profile:
        end = math.inf if self.end is None else self.end
        return Intermittent(self.size, self.start, self.period, self.duty, end)


class _Sine(ProfileTable):
    size: Number
    frequency: Positive  # Hz, as everywhere in a scenario
    phase: Number = 0.0

    def profile(self) -> Profile:
        return Sine(self.size, 2 * math.pi * self.frequency, self.phase)


class _Triangles(Source):
    amplitude: Positive
    cycles: Annotated[int, pydantic.Field(ge=1)] = 2

    def signal(self, clock: SampleClock, rng: np.random.Generator) -> Float[np.ndarray, "samples"]:
        return triangles(len(clock.t), self.amplitude, self.cycles)


class _Noise(Source):
    sigma: Positive
    low: Number
    high: Number

    def signal(self, clock: SampleClock, rng: np.random.Generator) -> Float[np.ndarray, "samples"]:
        return band_limited_noise(rng, len(clock.t), clock.dt, self.low, self.high, self.sigma)


class _Multisine(_Noise):
    def signal(self, clock: SampleClock, rng: np.random.Generator) -> Float[np.ndarray, "samples"]:
        return multisine(rng, len(clock.t), clock.dt, self.low, self.high, self.sigma)


class _Log(Source):
    """A recorded column; the log's first sample is the scenario's time 0."""

    path: str
    column: str
    time: str | None = None

    def signal(self, clock: SampleClock, rng: np.random.Generator) -> Float[np.ndarray, "samples"]:
        runs = read_telemetry(clock.folder / self.path, time=self.time, names=[self.column])
        run = runs[0]
        if len(runs) > 1:
            raise InputError(
                f"{run.source} holds {len(runs)} runs; give a log of the one to be replayed."
            )
        values = run.columns[self.column]
        if np.isnan(values).any():
            raise InputError(
                f"{run.source}: column {self.column!r} has empty cells; fill them before it is "
                "replayed."
            )
        t = run.t - run.t[0]
        dust = 1e-6 * clock.dt  # of rounding, in either time column
        if clock.t[-1] > t[-1] + dust:
            raise InputError(
                f"{run.source} ends after {t[-1]:g} s, but the scenario's last sample is at "
                f"{clock.t[-1]:g} s; shorten `seconds` or give a longer log."
            )
        if clock.linear:
            return np.interp(clock.t, t, values)
        return values[np.searchsorted(t, clock.t + dust, side="right") - 1]


def _check_end(start: float, end: float | None) -> None:
    if end is not None and end <= start:
        raise ValueError(f"end = {end:g} must be later than start = {start:g}")


PROFILES: dict[str, type[ProfileTable]] = {
    "constant": _Constant,
    "steps": _Steps,
    "ramp": _Ramp,
    "intermittent": _Intermittent,
    "sine": _Sine,
}
SOURCES: dict[str, type[Source]] = {
    **PROFILES,
    "triangles": _Triangles,
    "noise": _Noise,
    "multisine": _Multisine,
    "log": _Log,
}
