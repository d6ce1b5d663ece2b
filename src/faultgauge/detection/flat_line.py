"""A sensor that stands on one value: stuck, or saturated at the end of its range.

What it reads then is no measurement, and a filter that takes it for one explains it by whatever
fault fits. So an output that repeats one value for more than twice as long as healthy logs ever did
counts as not sampled until it moves again (the flat-line test of QARTOD, "Manual for Real-Time
Quality Control", 2020; lengths of chance repeats are geometric, so twice the longest of N is as
rare as 1/N^2). It looks back only, so a stream is answered as a file is. An output whose own fault
is declared is left as it is: a stuck sensor is a fault of that kind, as large as what it hides.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from faultgauge.plants.model import Model
from faultgauge.telemetry import Run

__all__ = ["FlatLine", "longest_repeats", "standing_still"]

ROOM = 2  # times the longest repeat of healthy logs


def standing_still(name: str) -> str:
    """The reason of a sample at which output `name` is no measurement."""
    return f"{name} stands on one value: stuck or saturated"


def longest_repeats(model: Model, runs: Sequence[Run]) -> dict[str, int]:
    """For each output, the most samples on end that repeat one value."""
    found = {}
    for name in model.plant.signals.output_names:
        counts = [_repeats(run.own(name))[0] for run in runs if name in run.columns]
        found[name] = max((int(each.max(initial=1)) for each in counts), default=1)
    return found


class FlatLine:
    """Follows the outputs of one run; keeps what it needs from call to call.

    `sized`: declared faults of outputs are estimated, as the bank does and observers do not.
    """

    def __init__(self, model: Model, sized: bool) -> None:
        faults = [f for f in model.plant.signals.faults if f.monitor != "disabled"]
        own = {f.target for f in faults if sized and f.enters == "output"}
        known = (model.calibration or {}).get("repeats", {})
        self.most = {n: ROOM * c for n, c in known.items() if n not in own}
        self.last: dict[str, tuple[float, int]] = dict.fromkeys(self.most, (np.nan, 0))

    def used(self, run: Run) -> tuple[Run, list[str]]:
        """(the next samples, `run`, with NaN for what is no measurement; of every sample the
        first output that is none, or "")."""
        columns, standing = dict(run.columns), np.full(len(run.t), "", object)
        for name in [name for name in self.most if name in columns]:
            counts, self.last[name] = _repeats(run.own(name), *self.last[name])
            if name in run.sampled:  # what was filled in is as good as the sample before it
                counts = counts[
                    np.maximum.accumulate(np.where(counts > 0, np.arange(len(counts)), 0))
                ]
            flat = counts > self.most[name]
            columns[name] = np.where(flat, np.nan, columns[name])
            standing[flat & (standing == "")] = name
        return replace(run, columns=columns), standing.tolist()


def _repeats(
    values: Float[np.ndarray, "samples"], last: float = np.nan, count: int = 0
) -> tuple[Int[np.ndarray, "samples"], tuple[float, int]]:
    """(how often each value has come in a row, after `last` has `count` times; what goes on).

    Empty cells are passed over, and counted 0.
    """
    rows = np.flatnonzero(np.isfinite(values))
    counts = np.zeros(len(values), int)
    if not len(rows):
        return counts, (last, count)
    known = values[rows]
    same = np.concatenate([[known[0] == last], known[1:] == known[:-1]])
    begin = np.maximum.accumulate(np.where(same, -1, np.arange(len(known))))
    counts[rows] = np.arange(len(known)) - np.maximum(begin, 0) + 1 + np.where(begin < 0, count, 0)
    return counts, (float(known[-1]), int(counts[rows[-1]]))
