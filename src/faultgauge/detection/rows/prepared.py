"""A run made ready once: what walks and filters along it are given, row by row."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from faultgauge.identification.samples import in_effect
from faultgauge.plants.signals import Signals
from faultgauge.telemetry import Run
from faultgauge.telemetry.runs import cut, joined

__all__ = ["Prepared", "as_it_acts", "in_a_row", "prepared"]


@dataclass(frozen=True, eq=False)
class Prepared:
    """`u` and `y` of all rows of `run`, in the plant's order and units; y is NaN between the
    samples of a slow sensor, and without a column."""

    run: Run
    u: Float[np.ndarray, "samples inputs"]
    y: Float[np.ndarray, "samples outputs"]

    def cut(self, part: slice) -> "Prepared":
        """The rows `part`."""
        return Prepared(cut(self.run, part), self.u[part], self.y[part])


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
