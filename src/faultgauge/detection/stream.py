"""`estimate` while telemetry arrives: the rows and events of a file, row by row.

What is said of a sample is the same to the bit, because the same walk says it. Four things cannot
be had without the future, and are not: columns of different rates are not brought onto common rows
(but the bank predicts an output between its samples), nor is a stream to the lower rate of its
model, one stream is one run, and `--reference free` is refused where an input is band-limited.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

import jax
import numpy as np
from jaxtyping import Bool

from faultgauge.detection.answer.estimation import Estimated, Observing
from faultgauge.detection.answer.misfit import FEWEST_JUDGED, Alarmed, Misfit, quiet
from faultgauge.detection.answer.unnamed import unnamed_alarms
from faultgauge.detection.bank.bank import FaultBank, build_fault_bank, evaluated_faults
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.decisions import Decision, Watching, unjudged
from faultgauge.detection.posterior.events import (
    UNKNOWN,
    Alarm,
    BankEvent,
    Judged,
    Unnamed,
    events,
    pause,
    telling,
)
from faultgauge.detection.posterior.uncalibrated import uncalibrated
from faultgauge.detection.posterior.verdicts import FAULT, STATUS, words
from faultgauge.detection.rows.intake import Intake, slow_outputs, with_taken
from faultgauge.detection.rows.judged import build_bank, check_observer
from faultgauge.detection.rows.prepared import prepared
from faultgauge.detection.rows.residual import Reference, Residuals, curved_inputs
from faultgauge.errors import InputError
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.clock import Clock
from faultgauge.telemetry.rates import align
from faultgauge.telemetry.resampling import same_rate
from faultgauge.telemetry.runs import PACE_SAMPLES, cut, joined, paced
from faultgauge.telemetry.stream import NAME, SOURCE, Sample

__all__ = ["Said", "Stream"]

Said: TypeAlias = Estimated | Decision | Alarm | BankEvent | Unnamed | Misfit


class Stream:
    """Judges one stream. `push` samples, `finish` at its end; both give what is ready to be said.

    The first 20 samples tell the time step; their rows come when the 20th does. Samples that are
    pushed at once are answered at once, to the same bits and many times as fast.
    """

    def __init__(self, model: Model, *, observer: str = "bank", reference: Reference = "free"):
        curved = curved_inputs(model) if reference == "free" else []
        if curved:
            raise InputError(
                f"--reference free: input {curved[0]!r} is band-limited, so its course between two "
                "samples is known 12 samples later only; use --reference observer on a stream."
            )
        if observer != "bank":
            check_observer(observer)
        self.model, self.observer = model, observer
        self.reference: Reference = reference
        self.first: list[Sample] = []
        self.pace: float | None = None  # once the first samples are there
        self.rate: float | None = None  # of the model, where that is the stream's
        self.answers: _Observers | _Unjudged | _Decided | None = None
        self.alarmed: Alarmed | None = Alarmed(NAME)  # until it is said
        self.last = 0.0
        self.clock: Clock | None = None  # once a sample is there

    @property
    def refused(self) -> list[str]:
        """Why faults are not estimated, once the first samples are there."""
        return list(self.answers.refused) if isinstance(self.answers, _Observers) else []

    def push(self, *samples: Sample) -> Iterator[Said]:
        """The rows of the `samples`, and then the alarms and events that they bring."""
        self.clock = samples[-1].clock if samples else self.clock
        if self.answers is not None:
            yield from self._said(samples)
            return
        self.first += samples
        if len(self.first) >= PACE_SAMPLES:
            yield from self._open()

    def finish(self) -> Iterator[Said]:
        """What is left to be said at the end of the stream."""
        if self.answers is None:
            if len(self.first) < 2:
                raise InputError(f"{SOURCE}: fewer than two samples came; send a header and rows.")
            yield from self._open()
        if isinstance(self.answers, _Decided):
            yield from self.answers.ongoing.over()
        if self.alarmed is not None:
            yield from self._misfit(self.last)

    def _open(self) -> Iterator[Said]:
        first = self.first[:PACE_SAMPLES]
        self._take_rate(paced(self._rows(first)))
        run = paced(self._rows(first))
        self._check_rates(run)
        self.pace = run.step
        kind = _Observers if self.observer != "bank" else _Decided
        if self.observer == "bank" and uncalibrated(self.model):
            kind = _Unjudged
        self.answers = kind(self, run)
        yield from self._said(self.first)
        self.first = []

    def _said(self, samples: Sequence[Sample]) -> Iterator[Said]:
        """What is said of rows, and whether the alarm is there from the beginning on."""
        assert self.answers is not None
        if not samples:
            return
        self.last = samples[-1].t
        for each in self.answers.push(self._rows(samples)):
            yield each
            if isinstance(each, Decision):
                yield from self._misfits(each)

    def _misfits(self, said: Decision) -> Iterator[Misfit]:
        """As of each row."""
        block = self._block()
        calm = quiet(said.posterior)
        for k, t in enumerate(said.run.t):
            if self.alarmed is None:
                return
            self.alarmed.add(said.status[k : k + 1], calm[k : k + 1])
            if self.alarmed.judged >= block:
                yield from self._misfit(float(t))

    def _misfit(self, t: float) -> Iterator[Misfit]:
        if self.alarmed is not None and self.alarmed.throughout:
            yield Misfit(NAME, t, self.alarmed.sentence())
            self.alarmed = None

    def _block(self) -> int:
        """Samples of a block of the calibration."""
        assert self.pace is not None
        found = self.model.calibration and self.model.calibration.bank
        return (
            max(int(np.ceil(found.block_s / self.pace)), FEWEST_JUDGED) if found else FEWEST_JUDGED
        )

    def _rows(self, samples: Sequence[Sample]) -> Run:
        names = samples[0].values
        columns = {name: np.array([sample.values[name] for sample in samples]) for name in names}
        t = np.array([sample.t for sample in samples])
        return Run(NAME, SOURCE, t, columns, self.pace, resampled=self.rate, clock=self.clock)

    def _take_rate(self, run: Run) -> None:
        """Refuses a stream that is faster than the rate of the model."""
        rate = self.model.resample
        if rate is None:
            return
        if same_rate(rate, 1 / run.step):
            self.rate = rate
        elif rate * run.step < 1:
            raise InputError(
                f"{SOURCE}: rows come at {1 / run.step:.4g} Hz and the model was fitted at "
                f"{rate:g} Hz (--resample), where the filter that brings them there needs rows "
                f"that are yet to come; send rows at {rate:g} Hz, or give the log as a file."
            )

    def _check_rates(self, run: Run) -> None:
        held = [each.name for each in self.model.plant.signals.inputs if each.hold == "zero"]
        aligned = align(run.t, run.columns, held)
        outputs = [name for name in self.model.plant.signals.output_names if name in run.columns]
        together = np.all([np.isfinite(run.columns[name]) for name in outputs], axis=0).any()
        predicted = set(outputs) if self.observer == "bank" and together else set[str]()
        if not (aligned.kept.all() and set(aligned.filled) <= predicted):
            slow = next((n for n in aligned.filled if n not in predicted), next(iter(run.columns)))
            raise InputError(
                f"{SOURCE}: column {slow!r} is sampled at times of its own; what lies between two "
                "of its samples is known after the second only, so send complete rows, or give "
                "the log as a file."
            )


class _Observers:
    """Observers alone."""

    def __init__(self, stream: Stream, run: Run) -> None:
        bank = build_bank(stream.model, [run], stream.observer)
        self.refused = list(bank.refused.values())
        self.observing = Observing(bank, run, stream.reference)

    def push(self, rows: Run) -> Iterator[Said]:
        yield self.observing.push(rows)


class _Unjudged:
    """A model that was not calibrated for the bank: residuals, and rows that say so."""

    def __init__(self, stream: Stream, run: Run) -> None:
        self.model = stream.model
        evaluated_faults(self.model.plant.signals)
        self.intake = Intake.of(self.model, run.step, slow_outputs(self.model, [run]))
        self.state = self.intake.init(run.step, averaged=run.resampled is not None)
        self.residuals = Residuals(self.model, run, stream.reference)

    def push(self, rows: Run) -> Iterator[Said]:
        given = prepared(self.model.plant.signals, rows)
        self.state, taken = self.intake.along(self.state, given)
        acting = with_taken(self.model, given, taken, outputs=False)
        yield unjudged(self.model, rows, acting, self.residuals.push(acting))


class _Decided:
    """The posterior."""

    def __init__(self, stream: Stream, run: Run) -> None:
        bank = build_fault_bank(stream.model, [run], noise_of(stream.model))
        self.watching, self.ongoing = Watching(bank, run), _Ongoing(bank)
        self.residuals = Residuals(stream.model, run, stream.reference)

    def push(self, rows: Run) -> Iterator[Said]:
        judged, decision = self.watching.push(rows)
        yield replace(decision, residuals=self.residuals.push(decision.acting))
        yield from self.ongoing.push(judged)


class _Ongoing:
    """What may become an event, or is one, is kept until it is over; then the same function finds
    events in it as in a whole log, and their onsets in what came before too."""

    def __init__(self, bank: FaultBank) -> None:
        self.bank, self.pause = bank, pause(bank)
        self.names = (*bank.model.plant.signals.fault_names, UNKNOWN)
        self.kept: list[Judged] = []
        self.calm = 0  # sampled rows in a row that speak of no fault
        self.told: set[str | None] = set()  # None: that an alarm has no name yet
        self.begun: float | None = None  # [s]

    def push(self, rows: Judged) -> Iterator[Alarm | BankEvent | Unnamed]:
        """Keep the rows that belong to what may be an event; tell alarms and events."""
        self.begun = float(rows.run.t[0]) if self.begun is None else self.begun
        speaks, sampled = self._speaks(rows), np.isfinite(rows.found.healthy)
        named = rows.verdict.named & telling(self.bank, rows.verdict)
        first = 0 if self.kept else None  # of those that are kept
        for k in range(len(speaks)):
            self.calm = 0 if speaks[k] else self.calm + sampled[k]
            if first is None and speaks[k]:
                first = k
            yield from self._alarms(rows, k, named[k])
            if self.calm > self.pause:
                self._keep(rows, first, k + 1)
                first = None
                yield from self.over()
        self._keep(rows, first, len(speaks))

    def _speaks(self, rows: Judged) -> Bool[np.ndarray, "rows"]:
        """Which rows speak of a fault."""
        found, detection = rows.found, self.bank.model.plant.signals.detection
        columns = np.concatenate([found.p, found.unknown[:, None]], axis=1)
        likely = np.any(np.nan_to_num(columns) >= detection.release, axis=1)
        p0 = np.clip(np.nan_to_num(found.healthy, nan=1.0), 1e-300, 1.0)
        over = p0 * (1 + np.exp(self.bank.level)) <= 1
        return likely | over | rows.verdict.alarm | rows.verdict.named.any(axis=1)

    def _alarms(self, rows: Judged, k: int, named: Bool[np.ndarray, "causes"]) -> Iterator[Alarm]:
        """Of what is `named` in row `k` for the first time, and of an alarm that begins there and
        has no name yet."""
        alarm = rows.verdict.status[k] == STATUS.index(FAULT)
        if alarm and not named.any() and not self.told:
            self.told.add(None)
            _, (reason,) = self._words(rows, slice(k, k + 1))
            yield Alarm(rows.run.name, None, float(rows.run.t[k]), None, reason)
        for cause in np.flatnonzero(named):
            name, found = self.names[cause], rows.found
            if name not in self.told:
                self.told.add(name)
                size = None if name == UNKNOWN else float(found.f[k, cause] / found.p[k, cause])
                yield Alarm(rows.run.name, name, float(rows.run.t[k]), size)

    def _keep(self, rows: Judged, first: int | None, stop: int) -> None:
        """The rows from `first` on, beside what is kept. Pieces are joined to at least as long
        ones, so that there are few, and a row is copied a few times only."""
        if first is None:
            return
        part = slice(first, stop)
        self.kept.append(Judged(cut(rows.run, part), *jax.tree.map(lambda a: a[part], rows[1:])))
        while len(self.kept) > 1 and len(self.kept[-2].run.t) <= len(self.kept[-1].run.t):
            self.kept[-2:] = [_joined(self.kept[-2:])]

    def over(self) -> Iterator[BankEvent | Unnamed]:
        """The events of what was kept, and its alarms without one."""
        if any(np.any(each.verdict.status == STATUS.index(FAULT)) for each in self.kept):
            kept = _joined(self.kept)
            found = events(self.bank, kept, self.begun)
            yield from found
            said = self._words(kept, slice(None))
            given = prepared(self.bank.model.plant.signals, kept.run)
            decision = Decision(kept.run, kept.found, {}, *said, found, given, given)
            yield from unnamed_alarms(self.bank, decision)
        self.kept, self.told = [], set()

    def _words(self, rows: Judged, part: slice) -> tuple[list[str], list[str]]:
        """(status, reason) of a part of the rows."""
        signals = self.bank.model.plant.signals
        regions = [region.covered for region in self.bank.regions]
        return words(signals, regions, rows.verdict.status[part], rows.verdict.reason[part])


def _joined(pieces: Sequence[Judged]) -> Judged:
    runs, *rest = zip(*pieces, strict=True)
    return Judged(joined(runs), *(jax.tree.map(lambda *a: np.concatenate(a), *e) for e in rest))
