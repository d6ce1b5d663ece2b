"""What of a row is believed: inputs as they act, outputs but for those that stand still.

An input that reads far beyond its limits and all that training covered is no command and counts as
not sampled: one cell of -9999 would move the healthy model out of sight of the plant.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from faultgauge.detection.rows.delay_line import DelayLine, DelayState
from faultgauge.detection.rows.flat_line import FlatLine, FlatState
from faultgauge.detection.rows.judged import operating_points, rows_between
from faultgauge.detection.rows.prepared import Prepared
from faultgauge.observers.follow import follow
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run

__all__ = ["Intake", "IntakeState", "Taken", "slow_outputs", "with_taken"]


FAR = 100.0  # times the range of an input, beyond it


class IntakeState(NamedTuple):
    """Of dead times and flat lines; `step` [s] of the rows, and whether they are `averaged` over
    the intervals of a lower rate."""

    delayed: DelayState
    flat: FlatState
    step: Float[Array, ""]
    averaged: Bool[Array, ""]


class Taken(NamedTuple):
    """A row as it is used: `u` acting now, `y` with NaN for what is no measurement, `standing`
    1 + the place of an output that stands still (0: none)."""

    u: Float[Any, "*rows inputs"]
    y: Float[Any, "*rows outputs"]
    standing: Int[Any, "*rows"]


class Intake(eqx.Module):
    """Pure `init` and `step`; inputs below `low` or above `high` are none."""

    delays: DelayLine
    flat: FlatLine
    low: Float[np.ndarray, "inputs"]
    high: Float[np.ndarray, "inputs"]

    @staticmethod
    def of(model: Model, step: float, slow: Sequence[str] = (), *, sized: bool = True) -> "Intake":
        """For rows `step` [s] apart, of which the outputs `slow` are sampled in some alone;
        `sized` as in `FlatLine`."""
        delays = DelayLine.of(model.plant.signals, step)
        return Intake(delays, FlatLine.of(model, slow, sized=sized), *_commands(model))

    def init(self, step: float | np.ndarray | Array, averaged: bool = False) -> IntakeState:
        return IntakeState(
            self.delays.init(), self.flat.init(), jnp.asarray(step), jnp.asarray(averaged)
        )

    def step(
        self,
        state: IntakeState,
        t: Float[Array, ""],
        u: Float[Array, "inputs"],
        y: Float[Array, "outputs"],
    ) -> tuple[IntakeState, Taken]:
        """One row at `t` [s] as it came."""
        u = jnp.where((u < self.low) | (u > self.high), jnp.nan, u)
        delayed, u = self.delays.step(state.delayed, t, u, state.step, state.averaged)
        flat, (y, standing) = self.flat.step(state.flat, y)
        return state._replace(delayed=delayed, flat=flat), Taken(u, y, standing)

    def along(self, state: IntakeState, rows: Prepared) -> tuple[IntakeState, Taken]:
        """The next `rows`, however many; NumPy arrays."""
        return follow(self, state, (rows.run.t, rows.u, rows.y))


def _commands(model: Model) -> tuple[Float[np.ndarray, "inputs"], Float[np.ndarray, "inputs"]]:
    """(least, largest) that is a command. The range of an input goes from limit to limit of the
    plant file, and as far as training where there is none; a little beyond a limit acts as it."""
    inputs, u = model.plant.signals.inputs, operating_points(model).u
    if not len(u):
        return np.full(len(inputs), -np.inf), np.full(len(inputs), np.inf)
    limits = np.array([[each.min, each.max] for each in inputs], float).reshape(-1, 2).T
    low, high = np.where(np.isfinite(limits), limits, [u.min(axis=0), u.max(axis=0)])
    room = np.where(high > low, FAR * (high - low), np.inf)
    return low - room, high + room


def slow_outputs(model: Model, runs: Sequence[Run]) -> tuple[str, ...]:
    """Outputs that are sampled in some rows of `runs` alone."""
    found = [n for n in model.plant.signals.output_names if any(n in run.columns for run in runs)]
    return tuple(name for name in found if rows_between(runs, name) > 1)


def with_taken(model: Model, rows: Prepared, taken: Taken, *, outputs: bool) -> Prepared:
    """`rows` with their inputs as they act and, where `outputs`, without what is no
    measurement."""
    signals, columns = model.plant.signals, dict(rows.run.columns)
    for k, name in enumerate(signals.input_names):
        columns[name] = taken.u[:, k]
    for k, name in enumerate(signals.output_names):
        if outputs and name in columns:
            there = np.isfinite(rows.y[:, k])
            # what was filled in is as good as the sample before it
            still = (taken.standing == k + 1) & ~there
            columns[name] = np.where(np.isnan(taken.y[:, k]) & there | still, np.nan, columns[name])
    return Prepared(replace(rows.run, columns=columns), taken.u, taken.y if outputs else rows.y)
