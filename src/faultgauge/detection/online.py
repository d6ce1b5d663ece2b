"""`estimate` while telemetry arrives: the rows and events of a file, row by row.

What is said of a sample is the same to the bit, because the same compiled step and the same
judgement say it. Four things cannot be had without the future, and are not: columns of different
rates are not brought onto common rows (but the bank predicts an output between its samples), nor is
a stream to the lower rate of its model, one stream is one run, and `--reference free` is refused
where an input is band-limited.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from faultgauge.detection.decisions import Decision
from faultgauge.detection.desk import Desk, Residuals, Said
from faultgauge.detection.estimation import said_of
from faultgauge.detection.judged import Bank, Estimates, build_bank, check_observer
from faultgauge.detection.live import Answer
from faultgauge.detection.misfit import FEWEST, Alarmed, Misfit
from faultgauge.detection.online_bank import BankDesk, UnjudgedDesk
from faultgauge.detection.residual import Reference, curved_inputs
from faultgauge.detection.uncalibrated import uncalibrated
from faultgauge.errors import InputError
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.rates import align
from faultgauge.telemetry.resampling import same_rate
from faultgauge.telemetry.runs import PACE_SAMPLES, paced
from faultgauge.telemetry.stream import SOURCE, Sample

__all__ = ["Online", "Said"]

NAME = "stream"


class Online:
    """Judges one stream. `push` a sample, `finish` at its end; both give what is ready to be said.

    The first 20 samples tell the time step that observers are designed for; their rows come when
    the 20th does.
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
        self.rate: float | None = None  # of the model, where that is the stream's
        self.desk: Desk | None = None
        self.alarmed: Alarmed | None = Alarmed(NAME)  # until it is said

    @property
    def bank(self) -> Bank | None:
        """The observers, once the first samples are there."""
        return self.desk.bank if isinstance(self.desk, _Observers) else None

    def push(self, sample: Sample) -> Iterator[Said]:
        """Judgements of one row each, alarms and events, in the order of time."""
        if self.desk is not None:
            yield from self._watched(self.desk.push(self._rows([sample], self.desk.pace)))
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
        yield from self._watched(self.desk.finish())
        if self.alarmed is not None and self.desk.newest is not None:
            yield from self._misfit(float(self.desk.newest.t[0]))

    def _open(self) -> Iterator[Said]:
        self._take_rate(paced(self._rows(self.first, None)))
        run = paced(self._rows(self.first, None))
        self._check_rates(run)
        if self.observer == "bank":
            desk = UnjudgedDesk if uncalibrated(self.model) else BankDesk
            self.desk = desk(self.model, run, self.reference)
        else:
            self.desk = _Observers(self.model, run, self.observer, self.reference)
        for sample in self.first:
            yield from self._watched(self.desk.push(self._rows([sample], run.pace)))

    def _watched(self, said: Iterator[Said]) -> Iterator[Said]:
        """What is said, and whether the alarm is there from the beginning on."""
        for each in said:
            yield each
            if self.alarmed is not None and isinstance(each, Decision):
                self.alarmed.add(each.status)
                if self.alarmed.judged >= self._block():
                    yield from self._misfit(float(each.run.t[0]))

    def _misfit(self, t: float) -> Iterator[Misfit]:
        if self.alarmed is not None and self.alarmed.throughout:
            yield Misfit(NAME, t, self.alarmed.sentence())
            self.alarmed = None

    def _block(self) -> int:
        """Samples of a block of the calibration: ten correlation times."""
        assert self.desk is not None
        found = (self.model.calibration or {}).get("bank", {})
        return max(int(np.ceil(found.get("block_s", 0.0) / self.desk.pace)), FEWEST)

    def _rows(self, samples: Sequence[Sample], pace: float | None) -> Run:
        names = samples[0].values
        columns = {name: np.array([sample.values[name] for sample in samples]) for name in names}
        t = np.array([sample.t for sample in samples])
        return Run(NAME, SOURCE, t, columns, pace, resampled=self.rate)

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


class _Observers(Desk):
    """A bank of observers."""

    def __init__(self, model: Model, run: Run, observer: str, reference: Reference) -> None:
        self.bank = build_bank(model, [run], observer)
        super().__init__(model, run, self.bank, [reference], sized=False)
        self.reference: Reference = reference

    def said(
        self,
        row: Run,
        acting: Run,
        answer: Answer | None,
        r: Residuals,
    ) -> Iterator[Said]:
        yield said_of(self.bank, self._estimates(row, answer), r[self.reference])

    def closed(self, newest: Run) -> Iterator[Said]:
        yield from ()

    def _estimates(self, row: Run, answer: Answer | None) -> Estimates:
        names = list(self.bank.designs)
        if answer is None:
            nothing = {name: np.full(1, np.nan) for name in names}
            no = np.zeros(1, bool)
            return Estimates(row, nothing, dict(nothing), no, no, self.standing)
        outputs = self.model.plant.signals.output_names
        f = {name: info.f for name, info in zip(names, answer.infos, strict=True)}
        innovation = {
            name: info.innovation[:, outputs.index(self.bank.designs[name].output)]
            for name, info in zip(names, answer.infos, strict=True)
        }
        settled = self.bank.has_settled(np.array([answer.since])) & answer.unforeseen
        return Estimates(row, f, innovation, np.ones(1, bool), settled, self.standing)
