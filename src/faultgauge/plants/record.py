"""What a model file tells beside its plant and its numbers: typed and checked when it is read.

A seal shows that nothing was altered since, not that what was sealed makes sense. What is read and
written again is the same JSON: a number keeps its type, and what was not told stays untold.
"""

from collections.abc import Collection
from typing import Annotated, Any, TypeVar

import pydantic

from faultgauge.plants.spec import PlantSpec

__all__ = [
    "BankLevel",
    "BetweenRuns",
    "CalibrationRecord",
    "FitRecord",
    "FleetRecord",
    "Interval",
    "LawRecord",
    "NoiseLevels",
    "ReadingRecord",
    "UnitRecord",
    "calibration_in",
    "check_record",
    "fit_in",
]

LARGEST = 1e100  # of any number: its square is one too
MOST_POINTS = 100_000  # of training in a model file
MOST_MEMBERS = 100  # of an ensemble
OLDER = "the calibration is of an older version; run `faultgauge calibrate` on healthy logs again."

Number = Annotated[int | float, pydantic.Field(gt=-LARGEST, lt=LARGEST)]
Positive = Annotated[int | float, pydantic.Field(gt=1 / LARGEST, lt=LARGEST)]
Least = Annotated[int | float, pydantic.Field(ge=0, lt=LARGEST)]
Count = Annotated[int, pydantic.Field(ge=0, lt=1_000_000_000)]
Share = Annotated[float, pydantic.Field(gt=0, lt=1)]
Text = Annotated[str, pydantic.Field(max_length=10_000)]
Span = tuple[str, Number, Number]


class Part(pydantic.BaseModel):
    """A part of the record; keys that are not named here are nobody's input."""

    # what JSON cannot say stays what it is, and is refused where it is written
    model_config = pydantic.ConfigDict(extra="allow", frozen=True, ser_json_inf_nan="constants")

    def as_dict(self) -> dict[str, Any]:
        """What was told of it, as plain JSON."""
        return self.model_dump(mode="json", by_alias=True, exclude_unset=True)


class ConstantsRecord(Part):
    """Uncertain constants: names, standard errors by chance, correlations; None where not known;
    and standard errors that hold the model's errors, too."""

    names: list[str]
    errors: list[Least | None]
    standard_errors: list[Least | None] | None = None
    correlation: list[list[Annotated[float, pydantic.Field(ge=-1.001, le=1.001)] | None]]

    @pydantic.model_validator(mode="after")
    def of_one_size(self) -> "ConstantsRecord":
        count = len(self.names)
        if not count == len(self.errors) == len(self.correlation):
            raise ValueError("sizes")
        if any(len(row) != count for row in self.correlation):
            raise ValueError("sizes")
        return self


class Columns(Part):
    """Where states come from: a column ("" where hidden), and which derivative of it they are; and
    which outputs have one."""

    states: list[tuple[str, Annotated[int, pydantic.Field(ge=0, le=10)]]]
    outputs: list[str] = []


class Metrics(Part):
    """How well the fit went: the free run's error on held-out data, as a share of the outputs'
    spread; of every group of equations and of the refinement what they tell of themselves."""

    validation_free_run_nrmse: Number | None
    groups: list[dict[str, Any]] = []
    refinement: dict[str, Any] | None = None

    @property
    def free_run_error(self) -> float:
        """That error; nan for a model that nobody fitted."""
        error = self.validation_free_run_nrmse
        return float("nan") if error is None else float(error)


class Choices(Part):
    """What the plant file left to the fit: holds and dead times [s] of inputs, sizes of
    networks."""

    hold: dict[str, str]
    hidden: dict[str, pydantic.StrictInt]
    delay: dict[str, Positive] = {}


class DataRecord(Part):
    """Hashes of runs."""

    fit: list[str]
    validate_: list[str] = pydantic.Field(alias="validate")


class BetweenRuns(Part):
    """How far `apart` runs lie in each parameter that varies (one standard deviation, of the
    logarithm where the parameter is positive), how far `off` a free run is expected to be in each
    output (r.m.s., its unit), and for how long [s] such an error is `lasting`."""

    apart: dict[str, Positive]
    off: dict[str, Positive]
    lasting: Positive


class BankLevel(Part):
    """The bank's alarm `level` (log-odds), for noise `widened` by a factor, and from what: healthy
    blocks of `block_s` each, `judged_s` in all of `healthy_s`, with so many `alarms`, prove
    `mtbfa_s` between false alarms; `memory_s` is the bank's; `size` the prior of each fault;
    `shape` and `gain` by which shares the model's answer is off, in all and in size; `changes`, by
    how much each input changes from row to row at most; which two faults are `alike`, no data
    telling them apart, and how many units of the second do what one of the first does; `nis`, how
    badly an explanation may fit in the mean of each window; `mimicked`, the sizes (one standard
    deviation) of what in healthy logs looks like a fault, by how old it is."""

    level: Number
    widened: Positive
    mtbfa_s: Positive
    confidence: Share
    judged_s: Positive
    healthy_s: Positive
    memory_s: Least
    alarms: Count
    blocks: Count
    block_s: Positive
    samples: Count
    size: dict[str, Positive]
    suspects: list[Span]
    shape: Least = 0.0
    gain: Least = 0.0
    changes: dict[str, Least] = {}
    alike: Annotated[list[tuple[str, str, Number]], pydantic.Field(max_length=10_000)] = []
    nis: Annotated[list[Positive], pydantic.Field(max_length=2)] = []
    mimicked: dict[str, Annotated[list[Least], pydantic.Field(min_length=5, max_length=5)]] = {}


class Interval(Part):
    """Of an observer's healthy estimates of a fault: 95 % lie within +-`interval`."""

    interval: Least


class NoiseLevels(Part):
    """Noise and model error by name (`detection.noise.Noise` says of what); what is not a size nor
    a time is any number."""

    __pydantic_extra__: dict[str, dict[str, Number]]  # pyright: ignore
    sigma: dict[str, Least] = {}
    process: dict[str, Least] = {}
    drift: dict[str, Least] = {}
    size: dict[str, Least] = {}
    lasting: dict[str, Positive] = {}
    share: dict[str, Least] = {}
    settling: dict[str, Positive] = {}
    spread: dict[str, Least] = {}
    together: dict[str, Number] = {}
    wander: dict[str, Positive] = {}
    wandering: dict[str, Positive] = {}
    late: dict[str, Positive] = {}
    lag: dict[str, Positive] = {}
    stray: dict[str, Positive] = {}
    straying: dict[str, Positive] = {}
    leaning: dict[str, Positive] = {}
    lean: dict[str, Number] = {}
    trail: dict[str, Positive] = {}
    zero: dict[str, Positive] = {}
    bend: dict[str, Number] = {}
    grip: dict[str, Positive] = {}
    gripping: dict[str, Positive] = {}
    slip: dict[str, Positive] = {}
    travel: dict[str, Positive] = {}
    varying: dict[str, Positive] = {}
    jitter: dict[str, Positive] = {}
    doubt: dict[str, Positive] = {}
    above: dict[str, Number] = {}
    below: dict[str, Number] = {}

    @pydantic.model_validator(mode="after")
    def whole(self) -> "NoiseLevels":
        pairs = (
            *((self.wander, self.wandering), (self.late, self.lag)),
            *((self.stray, self.straying), (self.lean, self.leaning)),
            *((self.grip, self.gripping), (self.grip, self.slip)),
        )
        if any(set(size) != set(time) for size, time in pairs):
            raise ValueError("a size without its time")
        if set(self.doubt) != {*self.above, *self.below}:
            raise ValueError("a doubt without its place")
        return self


class CalibrationRecord(Part):
    """What `calibrate` found on the runs with the hashes `data`: for the bank its noise and its
    alarm level, for an observer alone the intervals of its estimates, from `judged_s` of healthy
    rows, at its `bandwidth` [rad/s]. `repeats` says how often a healthy sensor repeats a value."""

    observer: str
    data: list[str]
    repeats: dict[str, Count]
    noise: NoiseLevels | None = None
    bank: BankLevel | None = None
    channels: dict[str, Interval] | None = None
    bandwidth: Positive | None = None
    judged_s: Least | None = None
    confidence: Share | None = None
    no_bank: Text | None = None

    @pydantic.model_validator(mode="after")
    def whole(self) -> "CalibrationRecord":
        pairs = ((self.noise, self.bank), (self.channels, self.bandwidth))
        if any((one is None) != (other is None) for one, other in pairs):
            raise ValueError("half a calibration")
        return self


class ReadingRecord(Part):
    """What was said of how the logs are read."""

    time: Text | None = None
    time_format: Text | None = None
    maps: Annotated[list[Text], pydantic.Field(max_length=10_000)] = []


class LawRecord(Part):
    """What a fleet tells of a constant (`identification.population`)."""

    center: Number
    spread: Positive
    error: Positive
    log: bool


class FleetRecord(Part):
    """Of a fleet's typical unit: where the fits of its units start, the laws of their constants,
    and who these are from; empty, while the units are still being fitted."""

    start: dict[str, Number]
    laws: dict[str, LawRecord]
    units: list[Text]
    unlike: dict[str, Annotated[float, pydantic.Field(ge=0, le=1)]] = {}
    warnings: list[Text] = []


class UnitRecord(Part):
    """Of a fleet's unit: its log, and [value, standard error] of its constants, as they are and as
    its own log alone has them."""

    samples: Count
    seconds: Least
    constants: dict[str, tuple[Number, Least | None]]
    own: dict[str, tuple[Number, Least | None]]
    prior: bool
    warnings: list[Text]


class FitRecord(Part):
    """What `fit` did and found, beside the plant itself.

    `max_step` and `sample_time` [s]; `resample` [Hz], the rate that the logs were brought to, and
    `log_step` [s] before that; how many `members` the ensemble has beside the best; the `columns`
    that were read, `reading` what was said of them; `data`, the hashes of the runs; `envelope`, the
    training range by name, and `envelope_points` in it, states then inputs; `noise` and
    `derivatives` by column; how sure the `constants` are; what differs `between` runs, where any
    parameter varies; `fleet` and `unit` of units of a fleet.
    """

    max_step: Positive
    sample_time: Positive
    resample: Positive | None = None
    log_step: Positive | None = None
    members: Annotated[pydantic.StrictInt, pydantic.Field(ge=0, le=MOST_MEMBERS)] = 0
    choices: Choices = Choices(hold={}, hidden={})
    columns: Columns
    constants: ConstantsRecord = ConstantsRecord(names=[], errors=[], correlation=[])
    data: DataRecord
    derivatives: dict[str, dict[str, Number | None]]
    envelope: dict[str, tuple[Number, Number]]
    envelope_points: Annotated[list[list[Number]], pydantic.Field(max_length=MOST_POINTS)]
    instruments: dict[str, Number] = {}
    metrics: Metrics
    noise: dict[str, dict[str, Any]] = {}
    reading: ReadingRecord = ReadingRecord()
    between: BetweenRuns | None = None
    fleet: FleetRecord | None = None
    unit: UnitRecord | None = None

    def but(self, **told: Any) -> "FitRecord":
        """The record with what is `told` in place of what it was."""
        return self.model_copy(update=told)


def fit_in(told: object) -> FitRecord:
    """The record of a fit that a model file tells. Raises `ValueError` that names the key of what
    makes no sense."""
    return _parsed(FitRecord, told)


def calibration_in(told: object) -> CalibrationRecord | None:
    """The same of its calibration, if there is one."""
    return None if told is None else _parsed(CalibrationRecord, _of_today(told), "calibration.")


def _of_today(told: object) -> object:
    """A calibration `told` by a version whose bank had no discrepancy is one of observers alone."""
    if isinstance(told, dict) and isinstance(told.get("bank"), dict) and "error" in told["bank"]:
        known = {key: value for key, value in told.items() if key not in ("bank", "noise")}
        return known | {"no_bank": OLDER}
    return told


Kind = TypeVar("Kind", bound=Part)


def _parsed(kind: type[Kind], told: object, within: str = "") -> Kind:
    try:
        return kind.model_validate(told)
    except pydantic.ValidationError as failure:
        place = ".".join(map(str, failure.errors()[0]["loc"])) or "record"
        raise ValueError(f"{within}{place}") from None


def check_record(record: FitRecord, calibration: CalibrationRecord | None, spec: PlantSpec) -> None:
    """Raises `ValueError` that names the key of what does not fit the plant."""
    signals = spec.signals
    names = [*signals.state_names, *signals.input_names]
    if len(record.columns.states) != len(signals.state_names):
        raise ValueError("columns.states")
    if any(len(point) != len(names) for point in record.envelope_points):
        raise ValueError("envelope_points")
    if record.between is not None:
        if {*record.between.apart} != {p.name for p in spec.parameters if p.vary}:
            raise ValueError("between.apart")
        if {*record.between.off} != {*signals.output_names}:
            raise ValueError("between.off")
    _known("envelope", record.envelope, [*names, *signals.output_names])
    if calibration is None:
        return
    faults = signals.fault_names
    if calibration.bank is not None:
        _known("calibration.bank.size", calibration.bank.size, faults)
        for one, other, by in calibration.bank.alike:
            _known("calibration.bank.alike", (one, other), faults)
            if one == other or by == 0:
                raise ValueError("calibration.bank.alike")
    _known("calibration.channels", calibration.channels or {}, faults)


def _known(place: str, given: Collection[str], legal: Collection[str]) -> None:
    for name in given:
        if name not in legal:
            raise ValueError(f"{place}.{name}")
