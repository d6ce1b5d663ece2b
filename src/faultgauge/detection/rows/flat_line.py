"""A sensor that stands on one value: stuck, or saturated at the end of its range.

What it reads then is no measurement, and a filter that takes it for one explains it by whatever
fault fits. So an output that repeats one value for more than twice as long as healthy logs ever did
counts as not sampled until it moves again (the flat-line test of QARTOD, "Manual for Real-Time
Quality Control", 2020; lengths of chance repeats are geometric, so twice the longest of N is as
rare as 1/N^2). It looks back only, so a stream is answered as a file is. An output whose own fault
is declared is left as it is: a stuck sensor is a fault of that kind, as large as what it hides.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from faultgauge.plants.model import Model
from faultgauge.telemetry import Run

__all__ = [
    "ROOM",
    "FlatLine",
    "FlatState",
    "is_standing",
    "longest_repeats",
    "standing_parts",
    "standing_still",
]

STANDS = " stands on one value: stuck or saturated"  # behind the name of an output
ROOM = 2  # times the longest repeat of healthy logs


def standing_still(name: str) -> str:
    """The reason of a sample at which output `name` is no measurement."""
    return f"{name}{STANDS}"


def is_standing(reason: str) -> bool:
    """Whether that is the `reason`."""
    return reason.endswith(STANDS)


def longest_repeats(model: Model, runs: Sequence[Run]) -> dict[str, int]:
    """For each output, the most samples on end that repeat one value."""
    found = {}
    for name in model.plant.signals.output_names:
        counts = [_longest(run.own(name)) for run in runs if name in run.columns]
        found[name] = max(counts, default=1)
    return found


def standing_parts(run: Run, name: str, most: float) -> list[tuple[float, float, float]]:
    """(from when [s], until when [s], the value) of every part of a column that repeats one value
    more than `most` times."""
    own = run.own(name)
    there = np.isfinite(own)
    t, known = run.t[there], own[there]
    edges = _edges(known)
    parts = [(a, b) for a, b in pairwise(edges.tolist()) if b - a > most]
    return [(float(t[a]), float(t[b - 1]), float(known[a])) for a, b in parts]


def _longest(values: Float[np.ndarray, "samples"]) -> int:
    """The most samples on end that repeat one value; empty cells are passed over."""
    return int(np.diff(_edges(values[np.isfinite(values)])).max(initial=1))


def _edges(known: Float[np.ndarray, "samples"]) -> Int[np.ndarray, "edges"]:
    """Where another value begins, and the end."""
    return np.flatnonzero(np.diff(known, prepend=np.nan, append=np.nan) != 0)


class FlatState(NamedTuple):
    """The last value of every output, and how often it has come in a row."""

    last: Float[Array, "outputs"]
    times: Int[Array, "outputs"]


class FlatLine(eqx.Module):
    """Follows the outputs; `most` is how often each may repeat a value, and an output that is
    `slow` stands still between its samples, too."""

    most: Float[np.ndarray, "outputs"]
    slow: tuple[bool, ...] = eqx.field(static=True)

    @staticmethod
    def of(model: Model, slow: Sequence[str] = (), *, sized: bool = True) -> "FlatLine":
        """As calibrated. `sized`: declared faults of outputs are estimated, as the bank does and
        observers do not."""
        signals = model.plant.signals
        faults = [f for f in signals.faults if f.monitor != "disabled"]
        own = {f.target for f in faults if sized and f.enters == "output"}
        known = model.calibration.repeats if model.calibration else {}
        most = [
            ROOM * known[n] if n in known and n not in own else np.inf for n in signals.output_names
        ]
        return FlatLine(np.array(most, float), tuple(n in slow for n in signals.output_names))

    def init(self) -> FlatState:
        return FlatState(jnp.full(len(self.most), jnp.nan), jnp.zeros(len(self.most), int))

    def step(
        self, state: FlatState, y: Float[Array, "outputs"]
    ) -> tuple[FlatState, tuple[Float[Array, "outputs"], Int[Array, ""]]]:
        """(the outputs with NaN for what is no measurement, 1 + the place of the first that stands
        still; 0: none)."""
        there = jnp.isfinite(y)
        count = jnp.where(there, jnp.where(y == state.last, state.times + 1, 1), state.times)
        last = jnp.where(there, y, state.last)
        flat = (count > self.most) & (there | np.array(self.slow, bool))
        standing = jnp.where(jnp.any(flat), jnp.argmax(flat) + 1, 0)
        return FlatState(last, count), (jnp.where(flat, jnp.nan, y), standing)
