"""`estimate` while telemetry arrives: the rows and events of a file, row by row.

What is said of a sample is the same to the bit, because the same compiled step and the same
judgement say it. Three things cannot be had without the future, and are not: columns of different
rates are not brought onto common rows, one stream is one run, and `--reference free` is refused
where an input is band-limited.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from faultgauge.detection.episode import Alarm, Episode
from faultgauge.detection.estimation import (
    Event,
    Judgement,
    judged,
)
from faultgauge.detection.judged import Bank, Estimates, build_bank, check_observer
from faultgauge.detection.live import Answer, Live
from faultgauge.detection.residual import HealthyReference, Reference, curved_inputs
from faultgauge.errors import InputError
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.dead_time import shifted
from faultgauge.telemetry.rates import align
from faultgauge.telemetry.runs import PACE_SAMPLES, joined, paced
from faultgauge.telemetry.stream import SOURCE, Sample

__all__ = ["Online", "Said"]

NAME = "stream"


Said = Judgement | Alarm | Event


class Online:
    """Judges one stream. `push` a sample, `finish` at its end; both give what is ready to be said.

    The first 20 samples tell the time step that observers are designed for; their rows come when
    the 20th does.
    """

    def __init__(self, model: Model, *, observer: str = "eso", reference: Reference = "free"):
        curved = curved_inputs(model) if reference == "free" else []
        if curved:
            raise InputError(
                f"--reference free: input {curved[0]!r} is band-limited, so its course between two "
                "samples is known 12 samples later only; use --reference observer on a stream."
            )
        check_observer(observer)
        self.model, self.observer = model, observer
        self.reference: Reference = reference
        self.first: list[Sample] = []
        self.desk: _Desk | None = None

    @property
    def bank(self) -> Bank | None:
        """The observers, once the first samples are there."""
        return None if self.desk is None else self.desk.bank

    def push(self, sample: Sample) -> Iterator[Said]:
        """Judgements of one row each, alarms and events, in the order of time."""
        if self.desk is not None:
            yield from self.desk.push(_rows([sample], self.desk.pace))
            return
        self.first.append(sample)
        if len(self.first) == PACE_SAMPLES:
            yield from self._open()

    def finish(self) -> Iterator[Said]:
        """What is left to be said at the end of the stream."""
        if self.desk is None:
            if len(self.first) < 2:
                raise InputError(f"{SOURCE}: fewer than two samples came; send a header and rows.")
            yield from self._open()
        assert self.desk is not None
        yield from self.desk.finish()

    def _open(self) -> Iterator[Said]:
        run = paced(_rows(self.first, None))
        self._check_rates(run)
        self.desk = _Desk(self.model, run, self.observer, self.reference)
        for sample in self.first:
            yield from self.desk.push(_rows([sample], run.pace))

    def _check_rates(self, run: Run) -> None:
        held = [each.name for each in self.model.plant.signals.inputs if each.hold == "zero"]
        aligned = align(run.t, run.columns, held)
        if aligned.filled or not aligned.kept.all():
            slow = aligned.filled[0] if aligned.filled else next(iter(run.columns))
            raise InputError(
                f"{SOURCE}: column {slow!r} is sampled at times of its own; what lies between two "
                "of its samples is known after the second only, so send complete rows, or give "
                "the log as a file."
            )


class _Desk:
    """The tracks of one stream and what is made of their answers."""

    def __init__(self, model: Model, run: Run, observer: str, reference: Reference) -> None:
        self.model, self.pace = model, run.step
        self.bank = build_bank(model, [run], observer)
        self.healthy: dict[Reference, HealthyReference] = {
            reference: HealthyReference.of(model, run, reference)
        }
        if not self.bank.designs and "observer" not in self.healthy:
            self.healthy["observer"] = HealthyReference.of(model, run, "observer")
        self.reference = reference
        tracks = [self.bank, *self.healthy.values()]
        self.lives = [Live(track) for track in tracks]
        self.answers: list[deque[Answer | None]] = [deque() for _ in tracks]
        self.rows: deque[Run] = deque()
        self.newest: Run | None = None
        self.window: list[Run] = []
        self.episode = Episode(self.bank)

    def push(self, row: Run) -> Iterator[Said]:
        self.rows.append(row)
        self.newest = row
        acting = self._in_effect(row)
        for live, answers in zip(self.lives, self.answers, strict=True):
            answers.extend(live.push(acting))
        yield from self._ready()

    def finish(self) -> Iterator[Said]:
        for live, answers in zip(self.lives, self.answers, strict=True):
            answers.extend(live.finish())
        yield from self._ready()
        if self.newest is not None:
            yield from self.episode.close(self.newest)

    def _ready(self) -> Iterator[Said]:
        while all(self.answers):
            row = self.rows.popleft()
            estimate, *references = [answers.popleft() for answers in self.answers]
            estimates = self._estimates(row, estimate)
            r = {
                reference: self._residuals(healthy, row, answer)
                for (reference, healthy), answer in zip(
                    self.healthy.items(), references, strict=True
                )
            }
            values = {}
            if self.model.calibration is not None:
                values = estimates.f if self.bank.designs else r["observer"]
            judgement = replace(judged(self.bank, estimates, values, r[self.reference]), events=[])
            yield judgement
            yield from self.episode.push(judgement, values)

    def _estimates(self, row: Run, answer: Answer | None) -> Estimates:
        names = list(self.bank.designs)
        if answer is None:
            nothing = {name: np.full(1, np.nan) for name in names}
            no = np.zeros(1, bool)
            return Estimates(row, nothing, dict(nothing), no, no)
        outputs = self.model.plant.signals.output_names
        f = {name: info.f for name, info in zip(names, answer.infos, strict=True)}
        innovation = {
            name: info.innovation[:, outputs.index(self.bank.designs[name].output)]
            for name, info in zip(names, answer.infos, strict=True)
        }
        settled = self.bank.has_settled(np.array([answer.since])) & answer.unforeseen
        return Estimates(row, f, innovation, np.ones(1, bool), settled)

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


def _rows(samples: Sequence[Sample], pace: float | None) -> Run:
    columns = {
        name: np.array([sample.values[name] for sample in samples]) for name in samples[0].values
    }
    return Run(NAME, SOURCE, np.array([sample.t for sample in samples]), columns, pace)
