"""A run: one uninterrupted recording of one unit, possibly with holes in it."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

__all__ = ["Run", "cut", "gaps", "segments"]

GAP_STEPS = 3.0
ROUNDING = 1e-3  # of a step: Unix time in float64 is good to 2e-7 s, logs to six digits to less


@dataclass(frozen=True, eq=False)
class Run:
    """Signals of one run, sampled together.

    `t` is in seconds and strictly increasing; `columns` are in the units of the log, NaN where
    nothing was sampled; `source` is the file as the user gave it and `name` is unique among the
    runs read together.
    """

    name: str
    source: str
    t: Float[np.ndarray, "samples"]
    columns: dict[str, Float[np.ndarray, "samples"]]

    @property
    def step(self) -> float:
        """Median time step, s."""
        return float(np.median(np.diff(self.t)))

    @property
    def content_hash(self) -> str:
        """SHA-256 over time and columns, whatever the file and the run are called."""
        digest = hashlib.sha256(len(self.t).to_bytes(8, "little"))
        for name, values in [("", self.t), *sorted(self.columns.items())]:
            # One NaN and one zero, so that equal values give equal bytes.
            canonical = np.where(np.isnan(values), np.nan, values + 0.0).astype("<f8")
            digest.update(name.encode() + b"\0" + canonical.tobytes())
        return digest.hexdigest()


def gaps(t: Float[np.ndarray, "samples"]) -> Bool[np.ndarray, "steps"]:
    """Which steps of `t` (from each sample to the next) exceed 3 times the median step."""
    steps = np.diff(t)
    return steps > (GAP_STEPS + ROUNDING) * np.median(steps)


def segments(run: Run, names: Iterable[str]) -> list[slice]:
    """Longest stretches without a gap where all columns `names` are sampled, in order.

    A stretch has at least 2 samples; a gap is a time step above 3 times the median of the run.
    """
    usable = np.ones(len(run.t), dtype=bool)
    for name in names:
        usable &= np.isfinite(run.columns[name])
    joined = usable[:-1] & usable[1:] & ~gaps(run.t)  # sample k hangs together with k + 1
    edges = np.flatnonzero(np.diff(joined, prepend=False, append=False))
    return [slice(int(a), int(b) + 1) for a, b in edges.reshape(-1, 2)]


def cut(run: Run, part: slice) -> Run:
    """The samples `part` of `run`, under the same name."""
    columns = {name: values[part] for name, values in run.columns.items()}
    return Run(run.name, run.source, run.t[part], columns)
