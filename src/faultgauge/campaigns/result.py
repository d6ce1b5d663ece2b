"""What a campaign found: every run, and the figures over them."""

from dataclasses import dataclass, field, replace
from typing import Any

from faultgauge.campaigns.outcome import Row
from faultgauge.rehearsal.result import FaultResult, Trial, plain
from faultgauge.rehearsal.shares import Rate, Share

__all__ = ["Bin", "Campaign", "Curve", "Isolation", "KindResult", "RunFigure", "Separable"]


@dataclass(frozen=True)
class RunFigure:
    """A figure over runs, and the 95 % interval of drawing them anew; None: none, or never."""

    value: float | None
    lo: float | None
    hi: float | None


@dataclass(frozen=True)
class KindResult:
    """One kind of fault, or a pair: in so many `runs`, with the names that are `right`.

    `faults` are the figures of a rehearsal, over its sizes; `smallest` is the size that was named
    90 % of the time, with its interval. Of the rows since a fault was named, the share whose
    interval `covers` its size, and the median `width` of these intervals over the size.
    """

    runs: int
    right: tuple[str, ...]
    faults: FaultResult
    smallest: RunFigure
    covers: RunFigure
    width: RunFigure
    delay: RunFigure
    trials: tuple[Trial, ...] = field(repr=False)


@dataclass(frozen=True)
class Curve:
    """Alarms at each level, of one kind or `all`: how many runs had one with the fault in them, and
    the median time [s] until then, where a fault without an alarm counts as one that never came."""

    name: str
    detected: tuple[Share, ...]
    delay: tuple[RunFigure, ...]


@dataclass(frozen=True)
class Isolation:
    """How many runs of each of `kinds` got each of `answers`; and, of those under alarm without a
    name, by the `sets` of what was still possible (5 % and more)."""

    kinds: tuple[str, ...]
    answers: tuple[str, ...]
    counts: tuple[tuple[int, ...], ...]
    sets: dict[str, dict[str, int]]


@dataclass(frozen=True)
class Bin:
    """Of the probabilities from `low` to `high`, whose mean is `said`: how often it was so."""

    low: float
    high: float
    said: float | None
    share: Share


@dataclass(frozen=True)
class Separable:
    """Runs whose faults are all of the size, at least, that the sheet foretold it would name:
    `exact` of those that were named otherwise or not at all, or exactly. Counted `apart`, of all
    runs with a fault: those below that size, those left undecided, and those not judged."""

    exact: Share
    apart: Share
    below: int
    undecided: int
    not_judged: int


@dataclass(frozen=True)
class Campaign:
    """What `campaign` found.

    `levels` are alarm levels [log-odds], `false` the rate of false alarms at each of them, and
    `false_alarms` that at the calibrated `level`, beside the rate that calibration allows (1/h).
    Brier score and log score are sums over all causes, means over the runs; `rows` are the runs.
    """

    name: str
    plant: str
    kinds: tuple[KindResult, ...]
    levels: tuple[float, ...]
    level: float
    false: tuple[Rate, ...]
    curves: tuple[Curve, ...]
    isolation: Isolation
    reliability: tuple[Bin, ...]
    brier: RunFigure
    log_score: RunFigure
    size_covered: Share
    onset_covered: Share
    covers: RunFigure
    separable: Separable
    false_alarms: Rate
    calibrated_rate: float
    warnings: tuple[str, ...]
    rows: tuple[Row, ...] = field(repr=False)

    def as_dict(self) -> dict[str, Any]:
        """All figures as plain JSON; the runs are a table of their own."""
        found = plain(replace(self, rows=()))
        del found["rows"]
        for kind in found["kinds"]:
            del kind["trials"]
        return found

    def table(self) -> dict[str, list[Any]]:
        """Every run as a row; None is an empty cell."""
        names = dict.fromkeys(name for row in self.rows for name in row)
        return {name: [row.get(name) for row in self.rows] for name in names}
