"""A run made ready once: what walks and filters along it are given, and where they start."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.identification.samples import in_effect
from faultgauge.plants.model import Model
from faultgauge.plants.plant import Plant
from faultgauge.plants.signals import Signals
from faultgauge.telemetry import Run
from faultgauge.telemetry.runs import cut, joined

__all__ = ["Prepared", "StretchStart", "as_it_acts", "in_a_row", "prepared"]


class StretchStart(NamedTuple):
    """Where a stretch starts by `model`; `plant` has the run's own values of parameters that vary.

    `samples` are those that hidden states and such values were found from; 0 where there is none.
    """

    model: Model
    plant: Plant
    x: Float[np.ndarray, "states"]
    samples: int


@dataclass(frozen=True, eq=False)
class Prepared:
    """`u` and `y` of all rows of `run`, in the plant's order and units; y is NaN between the
    samples of a slow sensor, and without a column. `starts` that were found, by the time [s] of
    their row and the number of rows that they were found from, are shared by all parts."""

    run: Run
    u: Float[np.ndarray, "samples inputs"]
    y: Float[np.ndarray, "samples outputs"]
    starts: dict[tuple[float, int], StretchStart] = field(default_factory=dict)

    def cut(self, part: slice) -> "Prepared":
        """The rows `part`."""
        return Prepared(cut(self.run, part), self.u[part], self.y[part], self.starts)


def prepared(signals: Signals, run: Run) -> Prepared:
    """`run` with the arrays of `signals`."""
    nothing = np.full(len(run.t), np.nan)
    u = [run.columns[name] for name in signals.input_names]
    y = [run.own(n) if n in run.columns else nothing for n in signals.output_names]
    return Prepared(
        run, np.stack(u, axis=1) if u else np.zeros((len(run.t), 0)), np.stack(y, axis=1)
    )


def as_it_acts(signals: Signals, log: Run) -> Prepared:
    """`log` with its inputs as they act. Raises `InputError` for one no longer than a delay."""
    return prepared(signals, in_effect(signals, log))


def in_a_row(parts: Sequence[Prepared]) -> Prepared:
    """Parts of one run, in order, as one."""
    u, y = (np.concatenate([getattr(part, name) for part in parts]) for name in ("u", "y"))
    return Prepared(joined([part.run for part in parts]), u, y)
