"""What a rehearsal found: every trial, and the figures of each fault."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from faultgauge.rehearsal.judging import UNKNOWN
from faultgauge.rehearsal.shares import Rate, Share, Smallest

__all__ = [
    "NEAR",
    "FaultResult",
    "Figures",
    "InjectedFault",
    "PairResult",
    "Rehearsal",
    "Trial",
    "plain",
]

NEAR = 1.5  # times: what is foretold is as good as what is found


@dataclass(frozen=True)
class InjectedFault:
    """One injected fault and what was said of it: `size` [its unit] from `onset` [s] on, `times`
    the smallest size that the model foretells (None where it foretells none).

    The rest is None where the fault was not named after its onset: `delay` [s] until it was first
    named, the `estimate` of the event that lasts longest, and whether the 95 % intervals of that
    estimate and of the first event's onset hold the truth.
    """

    fault: str
    size: float
    onset: float
    times: float | None
    delay: float | None = None
    estimate: float | None = None
    size_covered: bool | None = None
    onset_covered: bool | None = None

    @property
    def found(self) -> bool:
        return self.delay is not None

    @property
    def error(self) -> float | None:
        """|estimate - size| / |size|."""
        return None if self.estimate is None else abs(self.estimate - self.size) / abs(self.size)


@dataclass(frozen=True)
class Trial:
    """One log with one fault or two in it: the names told after the first onset, the events told
    before it, whether an alarm stood after it, and the share of rows that was not judged."""

    number: int
    window: str
    answers: tuple[InjectedFault, ...]
    told: tuple[str, ...]
    alarmed: bool
    false_before: int
    not_judged: float

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(each.fault for each in self.answers)

    @property
    def found(self) -> bool:
        """All that was injected was named."""
        return all(each.found for each in self.answers)

    @property
    def exact(self) -> bool:
        """Named was what was injected and nothing else."""
        return set(self.told) == set(self.names)

    @property
    def wrong(self) -> tuple[str, ...]:
        """Declared faults that were named and are not there."""
        return tuple(name for name in self.told if name not in (*self.names, UNKNOWN))

    @property
    def unknown(self) -> bool:
        """An undeclared fault was told of."""
        return UNKNOWN in self.told

    @property
    def times(self) -> float | None:
        """The least `times` of what was injected."""
        known = [each.times for each in self.answers if each.times is not None]
        return min(known) if len(known) == len(self.answers) else None


@dataclass(frozen=True)
class Figures:
    """Over some trials: `size` where all have it [the fault's unit], shares with their 95 %
    intervals, the relative size error of what was found, and its median delay [s]; `instead` counts
    what was told where it was not exactly what was injected."""

    size: float | None
    trials: int
    alarmed: Share
    found: Share
    exact: Share
    wrong: Share
    unknown: Share
    size_covered: Share
    onset_covered: Share
    error_median: float | None
    error_p90: float | None
    delay_median: float | None
    instead: dict[str, int]


@dataclass(frozen=True)
class FaultResult:
    """One declared fault: the smallest size that the model foretells from the middle of a window,
    and for 90 % of onsets `along` the windows; the one that was found 90 % of the time (None where
    none was), figures by size and over all sizes of at least 4 times the foretold (or over all
    where none is foretold), and how often a log did not allow it, and why."""

    name: str
    unit: str
    predicted: float | None
    along: float | None
    smallest: Smallest | None
    by_size: tuple[Figures, ...]
    large: Figures
    not_injectable: dict[str, int]

    @property
    def ratio(self) -> float | None:
        """Named 90 % of the time over foretold along the windows."""
        return self.smallest.size / self.along if self.smallest and self.along else None

    @property
    def within(self) -> bool | None:
        """Whether that is within 1.5 times, either way; None where it is not known."""
        if self.ratio is None or self.smallest is None:
            return None
        if self.smallest.at_most and self.ratio > 1 / NEAR:
            return None  # it may be smaller
        return 1 / NEAR <= self.ratio <= NEAR


@dataclass(frozen=True)
class PairResult:
    """Two faults in one log, each of `times` the smallest size that the model foretells."""

    names: tuple[str, str]
    times: float
    figures: Figures


@dataclass(frozen=True)
class Rehearsal:
    """What `rehearse` found.

    `windows` are the healthy logs that were used, with their samples; `exact` pools all trials of
    one fault of at least 4 times the foretold size; `false_alarms` are those of the untouched
    windows, beside the rate that calibration allows (1/h); `left_out` says of faults why they could
    not be rehearsed.
    """

    plant: str
    windows: dict[str, int]
    faults: tuple[FaultResult, ...]
    pairs: tuple[PairResult, ...]
    exact: Share
    false_alarms: Rate
    calibrated_rate: float
    left_out: dict[str, str]
    trials: tuple[Trial, ...]
    warnings: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Everything as plain JSON: NaN and infinities are None."""
        return plain(self)

    def table(self) -> dict[str, list[Any]]:
        """Every injected fault as a row, the columns of `trials.csv`."""
        rows = [(trial, each) for trial in self.trials for each in trial.answers]
        columns: dict[str, list[Any]] = {
            "trial": [trial.number for trial, _ in rows],
            "window": [trial.window for trial, _ in rows],
        }
        for key in ("fault", "size", "times", "onset", "found", "delay", "estimate", "error"):
            columns[key] = [_cell(getattr(each, key)) for _, each in rows]
        for key in ("size_covered", "onset_covered"):
            columns[key] = [_cell(getattr(each, key)) for _, each in rows]
        columns |= {
            "exact": [int(trial.exact) for trial, _ in rows],
            "alarmed": [int(trial.alarmed) for trial, _ in rows],
            "told": ["+".join(trial.told) for trial, _ in rows],
            "false_before": [trial.false_before for trial, _ in rows],
            "not_judged": [trial.not_judged for trial, _ in rows],
        }
        return columns

    def __repr__(self) -> str:
        return f"Rehearsal({self.plant}: {len(self.trials)} trials, {len(self.faults)} faults)"

    def __str__(self) -> str:
        from faultgauge.rehearsal.words import lines

        return "\n".join(lines(self))


def _cell(value: Any) -> Any:
    return int(value) if isinstance(value, bool) else value


def plain(value: Any) -> Any:
    """Plain JSON of a result, with the value of every share and rate."""
    if isinstance(value, Share | Rate):
        return {name: plain(x) for name, x in {"value": value.value, **vars(value)}.items()}
    if isinstance(value, Smallest):
        return value._asdict()
    if isinstance(value, Trial):
        more = {"found": value.found, "exact": value.exact, "wrong": list(value.wrong)}
        return {**_fields(value), **more, "unknown": value.unknown}
    if hasattr(value, "__dataclass_fields__"):
        return _fields(value)
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def _fields(value: Any) -> dict[str, Any]:
    return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__}
