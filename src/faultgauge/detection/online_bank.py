"""`estimate` by the bank while telemetry arrives: the rows and events of a file, row by row."""

from collections.abc import Iterator, Sequence
from dataclasses import fields

import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank import build_fault_bank, evaluated_faults
from faultgauge.detection.course import Course, Rows
from faultgauge.detection.decisions import Decision, unjudged
from faultgauge.detection.desk import Desk, Residuals, Said
from faultgauge.detection.events import UNKNOWN, Alarm, Judged, events, pause
from faultgauge.detection.live import Answer
from faultgauge.detection.noise import noise_of
from faultgauge.detection.posterior import Posterior, posterior_of, untrusted
from faultgauge.detection.residual import HealthyReference, Reference
from faultgauge.detection.verdicts import Verdict, Verdicts, log_odds
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.runs import joined

__all__ = ["BankDesk", "UnjudgedDesk"]

WHOLE = slice(0, 1)

Row = tuple[Run, Posterior, Verdict, Float[np.ndarray, "1 modes"]]


class UnjudgedDesk(Desk):
    """A stream whose model was not calibrated for the bank: residuals, and rows that say so."""

    def __init__(self, model: Model, run: Run, reference: Reference) -> None:
        evaluated_faults(model.plant.signals)
        super().__init__(model, run, HealthyReference.of(model, run, reference), [reference])
        self.reference: Reference = reference

    def said(self, row: Run, acting: Run, answer: Answer | None, r: Residuals) -> Iterator[Said]:
        yield unjudged(self.model, row, r[self.reference])

    def closed(self, newest: Run) -> Iterator[Said]:
        yield from ()


class BankDesk(Desk):
    """The bank along one stream.

    What may become an event, or is one, is kept until it is over; then the same function finds
    events in it as in a whole log, and their onsets in what came `before` too.
    """

    def __init__(self, model: Model, run: Run, reference: Reference) -> None:
        self.fault_bank = build_fault_bank(model, [run], noise_of(model))
        self.course = Course(self.fault_bank, tuple(run.columns))
        super().__init__(model, run, self.course, [reference])
        self.reference: Reference = reference
        self.verdicts = Verdicts(self.fault_bank)
        self.kept: list[Row] = []
        self.calm = 0  # sampled rows in a row that speak of no fault
        self.told: set[str] = set()

    def said(
        self,
        row: Run,
        acting: Run,
        answer: Answer | None,
        r: Residuals,
    ) -> Iterator[Said]:
        rows = [] if answer is None else [self._rows(acting, answer)]
        found = posterior_of(self.fault_bank, row, rows)
        verdict = self.verdicts.judge(acting, found, self.standing)
        found = untrusted(self.fault_bank, found, verdict.status)
        yield Decision(row, found, r[self.reference], verdict.status, verdict.reason, [])
        modes = len(self.fault_bank.sets) + 1
        p = rows[0].p.astype(np.float32) if rows else np.full((1, modes), np.nan, np.float32)
        yield from self._keep((acting, found, verdict, p))

    def closed(self, newest: Run) -> Iterator[Said]:
        yield from self._over()

    def _rows(self, acting: Run, answer: Answer) -> Rows:
        u = self.course.samples(acting, WHOLE)[0]
        since = np.array([answer.since])
        foreseen = np.array([not answer.unforeseen])
        return self.course.rows(WHOLE, answer.infos, u, since, foreseen)

    def _keep(self, said: Row) -> Iterator[Said]:
        """Keep the row where it belongs to what may be an event; tell alarms and events."""
        bank, (row, found, verdict, _) = self.fault_bank, said
        release = bank.model.plant.signals.detection.release
        columns = np.append(found.p[0], found.unknown[0])
        speaks = verdict.named.any() or np.any(np.nan_to_num(columns) >= release)
        speaks |= log_odds(found.healthy)[0] >= bank.level
        sampled = np.isfinite(found.healthy[0])
        self.calm = 0 if speaks else self.calm + sampled
        if speaks or self.kept:
            self.kept.append(said)
        names = (*bank.model.plant.signals.fault_names, UNKNOWN)
        for k in np.flatnonzero(verdict.named[0]):
            if names[k] not in self.told:
                self.told.add(names[k])
                size = float(found.f[0, k] / found.p[0, k]) if names[k] != UNKNOWN else None
                yield Alarm(row.name, names[k], float(row.t[0]), size)
        if self.calm > pause(self.fault_bank):
            yield from self._over()

    def _over(self) -> Iterator[Said]:
        if any(verdict.named.any() for _, _, verdict, _ in self.kept):
            rows = _joined(self.kept)
            yield from events(self.fault_bank, rows)
        self.kept, self.told = [], set()


def _joined(rows: Sequence[Row]) -> Judged:
    runs, founds, verdicts, p = zip(*rows, strict=True)
    found = Posterior(
        **{
            each.name: np.concatenate([getattr(one, each.name) for one in founds])
            for each in fields(Posterior)
        }
    )
    verdict = Verdict(
        [each.status[0] for each in verdicts],
        [each.reason[0] for each in verdicts],
        np.concatenate([each.alarm for each in verdicts]),
        np.concatenate([each.named for each in verdicts]),
    )
    return Judged(joined(list(runs)), found, verdict, np.concatenate(p))
