"""What runs beside a log and decides nothing: observers, and the healthy references of residuals.

A file is walked at once and a stream row by row, by the same code and the same compiled step. A
stretch begins once its first samples are known, 1, or those that derivatives (20) and hidden
states (50) are found from; nothing is said of the samples before, which told where it starts.
"""

from itertools import pairwise
from typing import Any, Protocol, runtime_checkable

import jax
import numpy as np
from jaxtyping import Float

from faultgauge.detection.rows.judged import samples_to_start, start_from_samples
from faultgauge.detection.rows.prepared import Prepared, StretchStart, in_a_row
from faultgauge.observers.follow import follow
from faultgauge.plants.model import Model
from faultgauge.telemetry.runs import gaps

__all__ = ["Along", "Track", "placed"]


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

    def begin(self, start: StretchStart, u: Float[np.ndarray, "inputs"]) -> tuple[Any, Any]:
        """(object with a pure `step`, its first state) of a stretch."""
        ...

    def samples(self, rows: Prepared) -> tuple[Float[np.ndarray, "samples ..."], ...]:
        """The arguments of `step` after the state; dt [s] is the third."""
        ...


class Said:
    """Of some rows: which of them were `answered`, how long [s] `since` their stretch began, and
    the answers to these, in order."""

    def __init__(self, count: int) -> None:
        self.answered = np.zeros(count, bool)
        self.since = np.full(count, np.nan)
        self.infos: list[Any] = []

    def joined(self) -> Any:
        """The answers as one; None where there are none."""
        return jax.tree.map(lambda *a: np.concatenate(a), *self.infos) if self.infos else None


class Along:
    """Runs one track along rows as they come, as many at once as there are."""

    def __init__(self, track: Track) -> None:
        self.track = track
        self.last: Prepared | None = None  # the row before, where the next may follow on it
        self.waiting: Prepared | None = None  # of a stretch that has not begun
        self.judge: Any = None
        self.state: Any = None
        self.begun = 0.0

    def push(self, rows: Prepared) -> Said:
        """What is said of `rows`."""
        run = rows.run
        said = Said(len(run.t))
        usable = np.ones(len(run.t), bool)
        for name in self.track.names:
            usable &= np.isfinite(run.columns[name])
        apart = np.append(False, gaps(run.t, run.step)) if len(run.t) > 1 else np.zeros(1, bool)
        if self.last is not None:
            apart[0] = gaps(np.append(self.last.run.t, run.t[0]), run.step)[0]
        linked = usable & np.append(self.last is not None, usable[:-1]) & ~apart
        first = np.flatnonzero(usable & ~linked)
        edges = np.unique(np.concatenate([[0], first, np.flatnonzero(~usable), [len(run.t)]]))
        for a, b in pairwise(edges.tolist()):
            if not linked[a]:
                self.last, self.waiting, self.judge = None, None, None
            if usable[a]:
                self._stretch(rows, slice(a, b), said)
        return said

    def _stretch(self, rows: Prepared, part: slice, said: Said) -> None:
        """The rows `part`, which follow on each other and on the last."""
        if self.judge is None and self.waiting is None:
            part = slice(part.start + self._opens(rows.cut(part)), part.stop)
        piece = rows.cut(part)
        if len(piece.u) and self.judge is None:
            piece, part = self._begin(piece, part)
        if len(piece.u) and self.judge is not None:
            self._answer(piece, part, said)
        self.last = rows.cut(slice(part.stop - 1, part.stop))

    def _opens(self, piece: Prepared) -> int:
        """How many rows come before the first that has all it must; where slow sensors are never
        sampled together, before all are under way."""
        complete = np.all([np.isfinite(piece.run.own(n)) for n in self.track.opening], axis=0)
        alive = np.all([np.isfinite(piece.run.columns[n]) for n in self.track.opening], axis=0)
        there = complete if complete.any() else alive
        return int(np.argmax(there)) if there.any() else len(piece.u)

    def _begin(self, piece: Prepared, part: slice) -> tuple[Prepared, slice]:
        """(the rows that are answered, their places): none while the start is not known."""
        before = 0 if self.waiting is None else len(self.waiting.u)
        whole = piece if self.waiting is None else in_a_row([self.waiting, piece])
        needed = samples_to_start(self.track.model, whole.run.columns)
        if len(whole.u) < needed:
            self.waiting = whole
            return piece.cut(slice(0, 0)), part
        start = start_from_samples(self.track.model, whole)
        given = self.track.samples(whole.cut(slice(0, needed)))
        self.judge, self.state = self.track.begin(start, given[0][0])
        known = needed - 1  # of the last of them it is not asked how the stretch starts
        if known:
            self.state, _ = follow(self.judge, self.state, [each[:known] for each in given])
        self.begun, self.waiting = float(whole.run.t[0]), None
        self.last = whole.cut(slice(known - 1, known)) if known else None
        first = known - before
        return piece.cut(slice(first, None)), slice(part.start + first, part.stop)

    def _answer(self, piece: Prepared, part: slice, said: Said) -> None:
        first = 0 if self.last is None else 1
        given = self.track.samples(piece if self.last is None else in_a_row([self.last, piece]))
        self.state, infos = follow(self.judge, self.state, [each[first:] for each in given])
        said.infos.append(infos)
        said.answered[part] = True
        said.since[part] = piece.run.t - self.begun


def placed(said: Said, values: Float[np.ndarray, "answered"]) -> Float[np.ndarray, "rows"]:
    """`values` of the rows that were answered, NaN for the others."""
    found = np.full(len(said.answered), np.nan)
    found[said.answered] = values
    return found
