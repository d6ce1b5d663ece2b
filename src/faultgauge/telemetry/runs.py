"""A run: one uninterrupted recording of one unit, possibly with holes in it."""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.telemetry.clock import Clock

__all__ = [
    "GAP_STEPS",
    "PACE_SAMPLES",
    "ROUNDING",
    "Run",
    "as_sampled",
    "cut",
    "gaps",
    "joined",
    "nearest",
    "paced",
    "segments",
]

GAP_STEPS = 3.0  # usual steps without a row are a gap
PACE_SAMPLES = 20  # samples that tell the step of a run to whoever cannot wait for its end
ROUNDING = 1e-3  # of a step: Unix time in float64 is good to 2e-7 s, logs to six digits to less


@dataclass(frozen=True, eq=False)
class Run:
    """Signals of one run, sampled together.

    `t` is in seconds and strictly increasing; `columns` are in the units of the log, NaN where
    nothing was sampled; `source` is the file as the user gave it and `name` is unique among the
    runs read together. `pace` is the step where it is settled, `paced`; `clock` is that of
    the log, where it has timestamps. `sampled` marks, in a column of a slow sensor that
    was filled in between, the cells that stand for its samples. `units` are those that the file
    gives. `resampled` is the rate [Hz] that the run was brought to, where it was, and `logged` the
    step [s] that its log has; `notes` say in sentences how the time of the file was understood.
    """

    name: str
    source: str
    t: Float[np.ndarray, "samples"]
    columns: dict[str, Float[np.ndarray, "samples"]]
    pace: float | None = None
    clock: Clock | None = None
    sampled: dict[str, Bool[np.ndarray, "samples"]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    resampled: float | None = None
    logged: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def step(self) -> float:
        """The time step, s: `pace`, or the median of the whole run."""
        return float(np.median(np.diff(self.t))) if self.pace is None else self.pace

    def own(self, name: str) -> Float[np.ndarray, "samples"]:
        """Column `name` as its sensor sampled it: NaN where it was filled in between."""
        values = self.columns[name]
        return np.where(self.sampled[name], values, np.nan) if name in self.sampled else values

    def rows_per_sample(self, name: str) -> int:
        """How many rows it is from one sample of column `name` to the next, in the median."""
        rows = np.flatnonzero(np.isfinite(self.own(name)))
        return int(np.median(np.diff(rows))) if len(rows) > 1 else 1

    @property
    def content_hash(self) -> str:
        """SHA-256 over time and columns, whatever the file and the run are called."""
        digest = hashlib.sha256(len(self.t).to_bytes(8, "little"))
        for name, values in [("", self.t), *sorted(self.columns.items())]:
            # One NaN and one zero, so that equal values give equal bytes.
            canonical = np.where(np.isnan(values), np.nan, values + 0.0).astype("<f8")
            digest.update(name.encode() + b"\0" + canonical.tobytes())
        return digest.hexdigest()


def gaps(t: Float[np.ndarray, "samples"], step: float | None = None) -> Bool[np.ndarray, "steps"]:
    """Which steps of `t` (from each sample to the next) exceed 3 times `step` [s], the median."""
    steps = np.diff(t)
    return steps > (GAP_STEPS + ROUNDING) * (np.median(steps) if step is None else step)


def paced(run: Run) -> Run:
    """`run` with the median of its first 20 samples' steps for its step.

    So that what is said of a sample rests on nothing that comes later, be it read from a file or
    as it arrives. Nine digits, so that runs of one rate have one step whatever their t[0] is.
    """
    return replace(run, pace=float(f"{np.median(np.diff(run.t[:PACE_SAMPLES])):.9g}"))


def segments(run: Run, names: Iterable[str]) -> list[slice]:
    """Longest stretches without a gap where all columns `names` are sampled, in order.

    A stretch has at least 2 samples; a gap is a time step above 3 times the step of the run.
    """
    usable = np.ones(len(run.t), dtype=bool)
    for name in names:
        usable &= np.isfinite(run.columns[name])
    linked = usable[:-1] & usable[1:] & ~gaps(run.t, run.step)  # sample k hangs together with k + 1
    edges = np.flatnonzero(np.diff(linked, prepend=False, append=False))
    return [slice(int(a), int(b) + 1) for a, b in edges.reshape(-1, 2)]


def cut(run: Run, part: slice) -> Run:
    """The samples `part` of `run`, under the same name."""
    columns = {name: values[part] for name, values in run.columns.items()}
    sampled = {name: cells[part] for name, cells in run.sampled.items()}
    return replace(run, t=run.t[part], columns=columns, sampled=sampled)


def joined(parts: Sequence[Run]) -> Run:
    """Parts of one run, in order, as one."""
    columns = {name: np.concatenate([p.columns[name] for p in parts]) for name in parts[0].columns}
    sampled = {name: np.concatenate([p.sampled[name] for p in parts]) for name in parts[0].sampled}
    t = np.concatenate([p.t for p in parts])
    return replace(parts[0], t=t, columns=columns, sampled=sampled)


def nearest(
    t: Float[np.ndarray, "rows"], times: Float[np.ndarray, "times"]
) -> Bool[np.ndarray, "rows"]:
    """Which of the rows `t` are the nearest to one of `times`; times outside of `t` have none."""
    times = times[(times >= t[0]) & (times <= t[-1])]
    after = np.searchsorted(t, times)
    before = np.maximum(after - 1, 0)
    found = np.zeros(len(t), dtype=bool)
    found[np.where(times - t[before] < t[after] - times, before, after)] = True
    return found


def as_sampled(
    run: Run,
    name: str,
    t: Float[np.ndarray, "rows"],
    values: Float[np.ndarray, "rows"],
) -> Float[np.ndarray, "rows"]:
    """`values` of column `name` at `t`, within `run`: NaN where they were filled in between."""
    if name not in run.sampled:
        return values
    return np.where(nearest(t, run.t[run.sampled[name]]), values, np.nan)
