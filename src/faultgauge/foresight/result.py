"""The detectability sheet: what could be seen in each log, told apart, and by what test input."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from faultgauge.foresight.experiments import Proposal

__all__ = ["Delay", "FaultSheet", "Help", "PairSheet", "RunSheet", "Sheet", "TripleSheet"]


@dataclass(frozen=True)
class Delay:
    """Over `seconds` since an onset in the middle of the log: the size `seen` from by then, the
    smallest `sizes` that would be named, by how many times as rare as calibrated false alarms are,
    and the standard deviation `sd` of a constant fault's size, alone; None: none."""

    seconds: tuple[float, ...]
    seen: tuple[float | None, ...]
    sizes: dict[float, tuple[float | None, ...]]
    sd: tuple[float | None, ...]


@dataclass(frozen=True)
class FaultSheet:
    """One fault in one log; sizes in its `unit`, times in s.

    `widest` is the standard deviation of its widest prior. From `seen_from` on it would raise an
    alarm, and of the `smallest` size be named, both by the end of the log from its middle on (None:
    of no size that it may have); `like` is the fault that it is taken for below that, where that is
    what costs most. `structural`: the equations alone let it be seen. The standard deviation of its
    estimate `levels_off` after so long (None: falls on), at the end it is `floor`. `from_onset` are
    the sizes seen from each of `onsets` on; `information` on it (1/unit^2), of faults that begin at
    each onset, by `times`.
    """

    name: str
    unit: str
    widest: float
    seen_from: float | None
    smallest: dict[float, float | None]
    like: str | None
    structural: bool
    levels_off: float | None
    floor: float | None
    delay: Delay
    onsets: tuple[float, ...]
    from_onset: tuple[float | None, ...]
    times: tuple[float, ...]
    information: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class PairSheet:
    """`fault` beside `other` of any size that its prior allows, at any onset nearby: the `share` of
    the information about it that is left at the end of the log, the size `apart_from` which it is
    told from the other (None: from none that it may have), the Kullback-Leibler `divergence`
    between a unit of it and the other at its most alike (nats; of a size f, times f^2); whether the
    equations alone tell them apart. `left` is the information (1/unit^2) over the `window` [s]."""

    fault: str
    other: str
    share: float
    apart_from: float | None
    divergence: float
    structural: bool
    window: tuple[float, ...]
    left: tuple[float, ...]


@dataclass(frozen=True)
class TripleSheet:
    """`fault` beside two `others` at once, that begin with it, or the one that hides more of it."""

    fault: str
    others: tuple[str, str]
    share: float
    apart_from: float | None


@dataclass(frozen=True)
class Help:
    """What would tell a `fault` of `size` that this log does not show (`other` None) or tell from
    the other: sensors as (what of, unit, noise, size told) and the least test input."""

    fault: str
    other: str | None
    size: float
    unit: str
    sensors: tuple[tuple[str, str, float, float], ...]
    test: Proposal | None


@dataclass(frozen=True)
class RunSheet:
    """One log of `seconds`, of whose rows so many were used."""

    name: str
    seconds: float
    rows: int
    faults: tuple[FaultSheet, ...]
    pairs: tuple[PairSheet, ...]
    triples: tuple[TripleSheet, ...]
    help: tuple[Help, ...]

    def pair(self, fault: str, other: str) -> PairSheet:
        return next(each for each in self.pairs if (each.fault, each.other) == (fault, other))


@dataclass(frozen=True)
class Sheet:
    """What `detectability` found for a plant, one `RunSheet` per log; `rate` is that of false
    alarms that calibration allows (1/h), and `rarer` by how much rarer ones were asked for."""

    plant: str
    rate: float
    rarer: tuple[float, ...]
    runs: tuple[RunSheet, ...]

    def as_dict(self) -> dict[str, Any]:
        """Everything as plain JSON: what is infinite or nowhere is None."""
        return _plain(asdict(self))

    def __repr__(self) -> str:
        faults = len(self.runs[0].faults) if self.runs else 0
        return f"Sheet({self.plant}: {len(self.runs)} logs, {faults} faults)"

    def __str__(self) -> str:
        from faultgauge.foresight.words import lines

        return "\n".join(lines(self))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        keys = (f"{k:g}" if isinstance(k, float) else k for k in value)
        return dict(zip(keys, map(_plain, value.values()), strict=True))
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
