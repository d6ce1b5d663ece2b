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

from faultgauge.detection.bank import FaultBank, build_fault_bank, evaluated_faults
from faultgauge.detection.decisions import Decision, Watching, unjudged
from faultgauge.detection.estimation import Estimated, Observing
from faultgauge.detection.events import (
    UNKNOWN,
    Alarm,
    BankEvent,
    Judged,
    events,
    pause,
    telling,
)
from faultgauge.detection.intake import Intake, slow_outputs, with_taken
from faultgauge.detection.judged import build_bank, check_observer
from faultgauge.detection.misfit import FEWEST, Alarmed, Misfit
from faultgauge.detection.noise import noise_of
from faultgauge.detection.residual import Reference, Residuals, curved_inputs
from faultgauge.detection.uncalibrated import uncalibrated
from faultgauge.detection.verdicts import log_odds
from faultgauge.errors import InputError
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.rates import align
from faultgauge.telemetry.resampling import same_rate
from faultgauge.telemetry.runs import PACE_SAMPLES, joined, paced
from faultgauge.telemetry.stream import SOURCE, Sample

__all__ = ["Said", "Stream"]

NAME = "stream"

Said: TypeAlias = Estimated | Decision | Alarm | BankEvent | Misfit


class Stream:
    """Judges one stream. `push` a sample, `finish` at its end; both give what is ready to be said.

    The first 20 samples tell the time step; their rows come when the 20th does.
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

    @property
    def refused(self) -> list[str]:
        """Why faults are not estimated, once the first samples are there."""
        return list(self.answers.refused) if isinstance(self.answers, _Observers) else []

    def push(self, sample: Sample) -> Iterator[Said]:
        """Rows, alarms and events, in the order of time."""
        if self.answers is not None:
            yield from self._said(sample)
            return
        self.first.append(sample)
        if len(self.first) == PACE_SAMPLES:
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
        self._take_rate(paced(self._rows(self.first)))
        run = paced(self._rows(self.first))
        self._check_rates(run)
        self.pace = run.step
        kind = _Observers if self.observer != "bank" else _Decided
        if self.observer == "bank" and uncalibrated(self.model):
            kind = _Unjudged
        self.answers = kind(self, run)
        for sample in self.first:
            yield from self._said(sample)

    def _said(self, sample: Sample) -> Iterator[Said]:
        """What is said of a row, and whether the alarm is there from the beginning on."""
        assert self.answers is not None
        self.last = sample.t
        for each in self.answers.push(self._rows([sample])):
            yield each
            if self.alarmed is not None and isinstance(each, Decision):
                self.alarmed.add(each.status)
                if self.alarmed.judged >= self._block():
                    yield from self._misfit(sample.t)

    def _misfit(self, t: float) -> Iterator[Misfit]:
        if self.alarmed is not None and self.alarmed.throughout:
            yield Misfit(NAME, t, self.alarmed.sentence())
            self.alarmed = None

    def _block(self) -> int:
        """Samples of a block of the calibration."""
        assert self.pace is not None
        found = (self.model.calibration or {}).get("bank", {})
        return max(int(np.ceil(found.get("block_s", 0.0) / self.pace)), FEWEST)

    def _rows(self, samples: Sequence[Sample]) -> Run:
        names = samples[0].values
        columns = {name: np.array([sample.values[name] for sample in samples]) for name in names}
        t = np.array([sample.t for sample in samples])
        return Run(NAME, SOURCE, t, columns, self.pace, resampled=self.rate)

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

    def push(self, row: Run) -> Iterator[Said]:
        yield self.observing.push(row)


class _Unjudged:
    """A model that was not calibrated for the bank: residuals, and rows that say so."""

    def __init__(self, stream: Stream, run: Run) -> None:
        self.model = stream.model
        evaluated_faults(self.model.plant.signals)
        self.intake = Intake.of(self.model, run.step, slow_outputs(self.model, [run]))
        self.state = self.intake.init(run.step, averaged=run.resampled is not None)
        self.residuals = Residuals(self.model, run, stream.reference)

    def push(self, row: Run) -> Iterator[Said]:
        self.state, taken = self.intake.along(self.model, self.state, row)
        acting = with_taken(self.model, row, taken, outputs=False)
        yield unjudged(self.model, row, acting, self.residuals.push(acting))


class _Decided:
    """The posterior."""

    def __init__(self, stream: Stream, run: Run) -> None:
        bank = build_fault_bank(stream.model, [run], noise_of(stream.model))
        self.watching, self.ongoing = Watching(bank, run), _Ongoing(bank)
        self.residuals = Residuals(stream.model, run, stream.reference)
        self.inputs = stream.model.plant.signals.input_names

    def push(self, row: Run) -> Iterator[Said]:
        judged, decision = self.watching.push(row)
        inputs = {name: decision.used.columns[name] for name in self.inputs}
        r = self.residuals.push(replace(row, columns=row.columns | inputs))
        yield replace(decision, residuals=r)
        yield from self.ongoing.push(judged)


class _Ongoing:
    """What may become an event, or is one, is kept until it is over; then the same function finds
    events in it as in a whole log, and their onsets in what came before too."""

    def __init__(self, bank: FaultBank) -> None:
        self.bank = bank
        self.kept: list[Judged] = []
        self.calm = 0  # sampled rows in a row that speak of no fault
        self.told: set[str] = set()
        self.begun: float | None = None  # [s]

    def push(self, row: Judged) -> Iterator[Alarm | BankEvent]:
        """Keep the row where it belongs to what may be an event; tell alarms and events."""
        bank, (run, found, verdict, _) = self.bank, row
        self.begun = float(run.t[0]) if self.begun is None else self.begun
        release = bank.model.plant.signals.detection.release
        columns = np.append(found.p[0], found.unknown[0])
        speaks = verdict.named.any() or np.any(np.nan_to_num(columns) >= release)
        speaks |= float(log_odds(found.healthy)[0]) >= bank.level
        sampled = np.isfinite(found.healthy[0])
        self.calm = 0 if speaks else self.calm + sampled
        if speaks or self.kept:
            self.kept.append(row)
        names = (*bank.model.plant.signals.fault_names, UNKNOWN)
        for k in np.flatnonzero(verdict.named[0] & telling(bank, verdict)[0]):
            if names[k] not in self.told:
                self.told.add(names[k])
                size = float(found.f[0, k] / found.p[0, k]) if names[k] != UNKNOWN else None
                yield Alarm(run.name, names[k], float(run.t[0]), size)
        if self.calm > pause(bank):
            yield from self.over()

    def over(self) -> Iterator[BankEvent]:
        """The events of what was kept."""
        if any(each.verdict.named.any() for each in self.kept):
            runs, *rest = zip(*self.kept, strict=True)
            whole = [jax.tree.map(lambda *a: np.concatenate(a), *each) for each in rest]
            yield from events(self.bank, Judged(joined(runs), *whole), self.begun)
        self.kept, self.told = [], set()
