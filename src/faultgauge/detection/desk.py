"""The tracks that run along one stream, and their answers brought together row by row."""

import abc
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from faultgauge.detection.decisions import Decision
from faultgauge.detection.estimation import Estimated
from faultgauge.detection.events import Alarm, BankEvent
from faultgauge.detection.flat_line import FlatLine
from faultgauge.detection.live import Answer, Live, Track
from faultgauge.detection.misfit import Misfit
from faultgauge.detection.residual import HealthyReference, Reference
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.dead_time import shifted
from faultgauge.telemetry.runs import joined

__all__ = ["Desk", "Residuals", "Said"]

Residuals = dict[Reference, dict[str, Float[np.ndarray, "1"]]]  # of one row
Said = Estimated | Alarm | Decision | BankEvent | Misfit


class Desk(abc.ABC):
    """`push` a row, `finish` at the end; both give what is ready to be said.

    The first track is the estimator's, the others are the healthy `references`; `sized` as in
    `FlatLine`.
    """

    def __init__(
        self,
        model: Model,
        run: Run,
        track: Track,
        references: Sequence[Reference],
        *,
        sized: bool = True,
    ) -> None:
        self.model, self.pace = model, run.step
        self.flat = FlatLine(model, sized)
        self.standing: list[str] = []  # of the row that is being said
        self.healthy: dict[Reference, HealthyReference] = {
            name: HealthyReference.of(model, run, name) for name in references
        }
        tracks = [track, *self.healthy.values()]
        self.lives = [Live(each) for each in tracks]
        self.answers: list[deque[Answer | None]] = [deque() for _ in tracks]
        # rows as they came, as they act and are believed, and the output that stands still
        self.rows: deque[tuple[Run, Run, list[str]]] = deque()
        self.newest: Run | None = None
        self.window: list[Run] = []

    @abc.abstractmethod
    def said(
        self,
        row: Run,
        acting: Run,
        answer: Answer | None,
        r: Residuals,
    ) -> Iterator[Said]:
        """What the tracks' answers to a row mean."""

    @abc.abstractmethod
    def closed(self, newest: Run) -> Iterator[Said]:
        """What is left to be said after the last row."""

    def push(self, row: Run) -> Iterator[Said]:
        self.newest = row
        acting = self._in_effect(row)
        used, standing = self.flat.used(acting)
        self.rows.append((row, used, standing))
        given = [used, *[acting] * len(self.healthy)]
        for live, answers, each in zip(self.lives, self.answers, given, strict=True):
            answers.extend(live.push(each))
        yield from self._ready()

    def finish(self) -> Iterator[Said]:
        for live, answers in zip(self.lives, self.answers, strict=True):
            answers.extend(live.finish())
        yield from self._ready()
        if self.newest is not None:
            yield from self.closed(self.newest)

    def _ready(self) -> Iterator[Said]:
        while all(self.answers):
            row, acting, self.standing = self.rows.popleft()
            estimate, *references = [answers.popleft() for answers in self.answers]
            r: Residuals = {
                reference: self._residuals(healthy, row, answer)
                for (reference, healthy), answer in zip(
                    self.healthy.items(), references, strict=True
                )
            }
            yield from self.said(row, acting, estimate, r)

    def _residuals(
        self, healthy: HealthyReference, row: Run, answer: Answer | None
    ) -> dict[str, Float[np.ndarray, "1"]]:
        if answer is None:
            return {name: np.full(1, np.nan) for name in healthy.outputs}
        signals = self.model.plant.signals
        return {
            name: row.columns[name] - answer.infos.y[:, signals.output_names.index(name)]
            for name in healthy.outputs
        }

    def _in_effect(self, row: Run) -> Run:
        """`row` with its inputs as they act, from a window as long as the longest delay."""
        delayed = [each for each in self.model.plant.signals.inputs if each.delay]
        if not delayed:
            return row
        oldest = row.t[0] - max(each.delay for each in delayed) - self.pace
        self.window.append(row)
        while len(self.window) > 2 and self.window[1].t[0] < oldest:
            self.window.pop(0)
        acting = {each.name: np.full(1, np.nan) for each in delayed}
        if len(self.window) > 1:
            run = joined(self.window)
            acting = {
                each.name: shifted(run, each.name, each.delay, each.hold == "zero")[-1:]
                for each in delayed
            }
        return replace(row, columns=row.columns | acting)
