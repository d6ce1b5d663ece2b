"""Logs whose signals are far from where they were in the logs that a model was fitted to: columns
that were swapped, another unit, another plant."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.plants.model import Model
from faultgauge.telemetry.runs import Run

__all__ = ["other_range"]

FAR = 1.0  # of a range, beyond its ends
NEAR = 0.25  # of a range, beyond its ends, within which another column may be meant
MOST = 0.5  # of the samples, at least
MOST_NAMES = 3  # in one sentence


class _Signal(NamedTuple):
    """A column: its samples, and where it lay in training."""

    name: str
    unit: str
    values: Float[np.ndarray, "samples"]
    usual: tuple[float, float]

    def share_beyond(self, usual: tuple[float, float], room: float) -> float:
        """The share of the samples that are farther from `usual` than `room` times its width."""
        width = usual[1] - usual[0]
        low, high = usual[0] - room * width, usual[1] + room * width
        return float(np.mean((self.values < low) | (self.values > high)))

    def could_be(self, other: "_Signal") -> bool:
        return self.share_beyond(other.usual, NEAR) < 1 - MOST

    @property
    def is_far(self) -> bool:
        return self.share_beyond(self.usual, FAR) >= MOST

    def __str__(self) -> str:
        low, high = self.values.min(), self.values.max()
        span = f"{self.name} is {low:.4g} to {high:.4g} {self.unit}".rstrip()
        return f"{span}, {self.usual[0]:.4g} to {self.usual[1]:.4g} where the model was fitted"


def other_range(model: Model, runs: Sequence[Run]) -> list[str]:
    """A sentence for every log of which half or more of a signal is farther from the training range
    than that is wide."""
    units, found = model.plant.signals.units, dict[str, str]()
    for run in runs:
        signals = [
            _Signal(name, units.get(name, ""), there, usual)
            for name, usual in _usual(model).items()
            if name in run.columns
            and (there := run.columns[name][np.isfinite(run.columns[name])]).size
        ]
        far = [each for each in signals if each.is_far]
        if far:
            found.setdefault(run.source, _sentence(run, far, signals))
    return list(found.values())


def _usual(model: Model) -> dict[str, tuple[float, float]]:
    """The training ranges of columns: of inputs and measured states that moved."""
    signals, envelope = model.plant.signals, model.record["envelope"]
    states = zip(signals.state_names, model.record["columns"]["states"], strict=True)
    columns = {state: name for state, (name, order) in states if name and order == 0}
    columns |= {name: name for name in signals.input_names}
    spans = {column: envelope[name] for name, column in columns.items() if name in envelope}
    return {column: (low, high) for column, (low, high) in spans.items() if high > low}


def _sentence(run: Run, far: list[_Signal], signals: list[_Signal]) -> str:
    told = "; ".join(map(str, far[:MOST_NAMES]))
    more = f"; and {len(far) - MOST_NAMES} more signals" if len(far) > MOST_NAMES else ""
    swapped = next(
        (
            (one.name, other.name)
            for one in far
            for other in signals
            if other is not one and one.could_be(other) and other.could_be(one)
        ),
        None,
    )
    advice = "check that it is the right column, in the right unit, of the same plant"
    if swapped is not None:
        advice = f"the columns {swapped[0]} and {swapped[1]} look swapped"
    return f"{run.source}: {told}{more}: {advice}"
