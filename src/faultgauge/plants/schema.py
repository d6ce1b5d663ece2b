"""The schema of the plant file, as pydantic sees it: keys and types only.

What the keys mean, and whether they go together, is checked where the file becomes a `PlantSpec`.
"""

from typing import Annotated, Literal

import pydantic

from faultgauge.plants.shape import Monotone
from faultgauge.plants.signals import Entry, Hold, Monitor
from faultgauge.plants.toml_file import Number, Positive, SchemaTable

__all__ = [
    "MAX_HIDDEN",
    "DetectionTable",
    "FaultTable",
    "FileTable",
    "InputTable",
    "NetworkTable",
    "ParameterTable",
    "StateTable",
]

MAX_HIDDEN = 200  # units of a network

Text = str
Seconds = Annotated[float, pydantic.Field(ge=0, allow_inf_nan=False)]


class StateTable(SchemaTable):
    """`[states.NAME]`."""

    derivative: Text
    unit: Text = ""
    min: Number | None = None
    max: Number | None = None
    initial: Number | None = None
    exact: bool = False
    trusted: list[Number] | None = None


class InputTable(SchemaTable):
    """`[inputs.NAME]`."""

    unit: Text = ""
    min: Number | None = None
    max: Number | None = None
    hold: Hold | None = None
    delay: Seconds | None = None
    instrument: Text | None = None
    trusted: list[Number] | None = None


class OutputTable(SchemaTable):
    """`[outputs.NAME]`."""

    value: Text
    unit: Text = ""
    sigma: Positive | None = None
    trusted: list[Number] | None = None


class ParameterTable(SchemaTable):
    """`[parameters.NAME]`."""

    value: Number | None = None
    unit: Text = ""
    min: Number | None = None
    max: Number | None = None
    fixed: bool = False
    vary: Literal["run", "slow"] | None = None


class NetworkTable(SchemaTable):
    """`[networks.NAME]`."""

    hidden: Annotated[int, pydantic.Field(ge=1, le=MAX_HIDDEN)] | None = None
    odd: bool = False
    zero_at_zero: bool = False
    positive: bool = False
    monotone: Annotated[
        Monotone | None,
        pydantic.BeforeValidator(lambda given: "increasing" if given is True else given),
    ] = None


class FaultTable(SchemaTable):
    """`[faults.NAME]`."""

    enters: Entry
    target: Text
    unit: Text = ""
    min: Number | None = None
    max: Number | None = None
    rate: Positive | None = None
    prior_per_hour: Positive | None = None
    monitor: Monitor = "active"
    relative: bool | None = None


class ObserverTable(SchemaTable):
    """`[observer]`."""

    outputs: list[Text] | None = None
    bandwidth: Positive | None = None


class DetectionTable(SchemaTable):
    """`[detection]`."""

    max_simultaneous: Literal[1, 2, 3] = 2
    persistence: Seconds = 0.0
    release: Annotated[float, pydantic.Field(gt=0, le=0.95)] = 0.5
    latch: bool = False
    hold_off: Seconds | None = None


class FileTable(SchemaTable):
    """A whole plant file."""

    name: Text
    states: dict[str, StateTable]
    inputs: dict[str, InputTable] = pydantic.Field(default_factory=dict)
    outputs: dict[str, OutputTable]
    parameters: dict[str, ParameterTable] = pydantic.Field(default_factory=dict)
    networks: dict[str, NetworkTable] = pydantic.Field(default_factory=dict)
    terms: dict[str, Text] = pydantic.Field(default_factory=dict)
    faults: dict[str, FaultTable] = pydantic.Field(default_factory=dict)
    observer: ObserverTable = ObserverTable()
    detection: DetectionTable = DetectionTable()
