"""A pure step beside a stream: one answer per row, in order, the same as beside a file.

A stretch can begin only once its first samples are known: two, or those that derivatives (20) and
hidden states (50) are found from. Its first answers come then, together; every other at once.
"""

from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import numpy as np
from jaxtyping import Float

from faultgauge.detection.judged import Past, Start, samples_to_start, start_from_samples
from faultgauge.observers.follow import follow
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.runs import gaps, joined

__all__ = ["Answer", "Live", "Track"]


@runtime_checkable
class Track(Protocol):
    """What runs along a log, stretch by stretch: a bank of observers, a healthy reference."""

    @property
    def model(self) -> Model: ...

    @property
    def names(self) -> tuple[str, ...]:
        """The columns that a stretch must have sampled."""
        ...

    @property
    def opening(self) -> tuple[str, ...]:
        """The columns that its first sample must have."""
        ...

    def begin(
        self, start: Start, u: Float[np.ndarray, "inputs"], past: Past | None = None
    ) -> tuple[Any, Any]:
        """(object with a pure `step`, its first state) of a stretch; `past` it the one before."""
        ...

    def samples(self, run: Run, part: slice) -> tuple[Float[np.ndarray, "samples ..."], ...]:
        """The arguments of `step` after the state; dt [s] is the third."""
        ...


class Answer(NamedTuple):
    """What was said of one sample: `infos` of one row, the time [s] since its stretch began, and
    whether the start of the stretch was found without it."""

    infos: Any
    since: float
    unforeseen: bool


class Live:
    """Runs one track along a stream of rows (runs of one sample)."""

    def __init__(self, track: Track) -> None:
        self.track = track
        self.waiting: list[Run] = []  # joined to each other; their stretch has not begun
        self.judge: Any = None
        self.state: Any = None
        self.begun = 0.0
        self.last: Run | None = None  # the row before, where the next may follow on it
        self.past: tuple[Any, Any, float] | None = None  # judge, state, when their stretch ended

    def push(self, row: Run) -> list[Answer | None]:
        """Answers that are ready now, the oldest first; None for a row that is in no stretch."""
        usable = all(np.isfinite(row.columns[name][0]) for name in self.track.names)
        if not usable:
            return [*self.finish(), None]
        ready: list[Answer | None] = []
        if self.last is not None and gaps(np.append(self.last.t, row.t), row.pace)[0]:
            ready = self.finish()
        before, self.last = self.last, row
        if self.judge is not None:
            assert before is not None
            return [*ready, *self._answers(joined([before, row]), 1, 0)]
        if not self.waiting and not self._opens(row):
            return [*ready, None]
        self.waiting.append(row)
        if len(self.waiting) >= samples_to_start(self.track.model, row.columns):
            ready += self._begin()
        return ready

    def finish(self) -> list[Answer | None]:
        """The answers that are still due when the stretch ends here."""
        due: list[Answer | None] = [None] * len(self.waiting)  # one sample makes no stretch
        if len(self.waiting) > 1:
            due = self._begin()
        if self.judge is not None and self.last is not None:
            self.past = self.judge, self.state, float(self.last.t[0])
        self.waiting, self.judge, self.last = [], None, None
        return due

    @property
    def latest(self) -> Any:
        """What runs along the stretch, or ran along the last one."""
        return self.judge if self.past is None or self.judge is not None else self.past[0]

    def _opens(self, row: Run) -> bool:
        return all(np.isfinite(row.columns[name][0]) for name in self.track.opening)

    def _begin(self) -> list[Answer | None]:
        run = joined(self.waiting)
        start = start_from_samples(self.track.model, run, slice(0, len(run.t)))
        u = self.track.samples(run, slice(0, 1))[0]
        past = None
        if self.past is not None:
            judge, state, ended = self.past
            past = Past(judge, state, float(run.t[0] - ended))
        self.judge, self.state = self.track.begin(start, u[0], past)
        self.begun, self.waiting = float(run.t[0]), []
        return self._answers(run, 0, start.samples)

    def _answers(self, run: Run, first: int, known: int) -> list[Answer | None]:
        """Step through the samples of `run` from `first` on."""
        given = self.track.samples(run, slice(0, len(run.t)))
        self.state, infos = follow(self.judge, self.state, [each[first:] for each in given])
        return [
            Answer(_row(infos, k), float(run.t[first + k]) - self.begun, k >= known)
            for k in range(len(run.t) - first)
        ]


def _row(infos: Any, k: int) -> Any:
    return jax.tree.map(lambda values: values[k : k + 1], infos)
