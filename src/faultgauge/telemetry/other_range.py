"""Logs whose signals are far from where they were in the logs that a model was fitted to: columns
that were swapped, another unit, another plant."""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.plants.model import Model
from faultgauge.plants.signals import spoken
from faultgauge.telemetry.runs import Run

__all__ = ["other_range"]

FAR = 1.0  # of a range, beyond its ends
MOST = 0.5  # of the samples, at least
UNLIKE, LIKE = 0.5, 0.25  # of a range, by which the ends of two differ together
NEARLY_ALL = (0.01, 0.99)  # of the samples lie between
MOST_NAMES = 3  # in one sentence


class _Signal(NamedTuple):
    """A column: its samples, and where it lay in training."""

    name: str
    unit: str
    values: Float[np.ndarray, "samples"]
    usual: tuple[float, float]

    @property
    def is_far(self) -> bool:
        """Whether most samples are farther from the training range than that is wide."""
        low, high = self.usual
        room = FAR * (high - low)
        return float(np.mean((self.values < low - room) | (self.values > high + room))) >= MOST

    def apart(self, usual: tuple[float, float]) -> float:
        """By how much of the range `usual` the ends of this one differ from it."""
        ends = np.quantile(self.values, NEARLY_ALL)
        return float(np.abs(ends - usual).sum()) / (usual[1] - usual[0])

    def could_be(self, other: "_Signal") -> bool:
        """Whether it is where the other was, and not where it was itself."""
        return self.apart(self.usual) > UNLIKE and self.apart(other.usual) < LIKE

    def __str__(self) -> str:
        low, high = self.values.min(), self.values.max()
        span = f"{self.name} is {low:.4g} to {high:.4g} {spoken(self.unit)}".rstrip()
        return f"{span}, {self.usual[0]:.4g} to {self.usual[1]:.4g} where the model was fitted"


def other_range(model: Model, runs: Sequence[Run]) -> list[str]:
    """A sentence for every log of which half or more of a signal is farther from the training range
    than that is wide, or of which two signals are where the other one was."""
    units, found = model.plant.signals.units, dict[str, str]()
    for run in runs:
        signals = [
            _Signal(name, units.get(name, ""), there, usual)
            for name, usual in _usual(model).items()
            if name in run.columns
            and (there := run.columns[name][np.isfinite(run.columns[name])]).size
        ]
        far = [each for each in signals if each.is_far]
        pairs = ((a, b) for a, b in combinations(signals, 2) if a.could_be(b) and b.could_be(a))
        swapped = next(pairs, ())
        if far or swapped:
            found.setdefault(run.source, _sentence(run.source, far, swapped))
    return list(found.values())


def _usual(model: Model) -> dict[str, tuple[float, float]]:
    """The training ranges of columns: of inputs and measured states that moved."""
    signals, envelope = model.plant.signals, model.record.envelope
    states = zip(signals.state_names, model.record.columns.states, strict=True)
    columns = {state: name for state, (name, order) in states if name and order == 0}
    columns |= {name: name for name in signals.input_names}
    spans = {column: envelope[name] for name, column in columns.items() if name in envelope}
    # a record may hold whole numbers
    return {
        column: (float(low), float(high)) for column, (low, high) in spans.items() if high > low
    }


def _sentence(source: str, far: Sequence[_Signal], swapped: Sequence[_Signal]) -> str:
    told = swapped or far
    more = f"; and {len(told) - MOST_NAMES} more signals" if len(told) > MOST_NAMES else ""
    advice = "check that it is the right column, in the right unit, of the same plant"
    if swapped:
        advice = f"the columns {' and '.join(each.name for each in swapped)} look swapped"
    return f"{source}: {'; '.join(map(str, told[:MOST_NAMES]))}{more}: {advice}"
