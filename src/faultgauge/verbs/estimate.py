"""`estimate`: which fault, how big, since when, how sure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Unpack

from faultgauge.detection import decisions
from faultgauge.detection.answer import estimation, misfit
from faultgauge.detection.answer.estimation import Estimated
from faultgauge.detection.answer.evidence import Evidence
from faultgauge.detection.answer.evidence import evidence as evidence_of
from faultgauge.detection.answer.shares import shares_of
from faultgauge.detection.answer.standing import standing_in
from faultgauge.detection.answer.swapped import swapped_in
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.calibration.drift import Drift, drifts
from faultgauge.detection.decisions import Decision, Walk
from faultgauge.detection.onset import retrospective
from faultgauge.detection.onset.retrospective import Retrospect
from faultgauge.detection.posterior.events import UNKNOWN, BankEvent
from faultgauge.detection.rows.judged import Bank
from faultgauge.detection.rows.residual import Reference
from faultgauge.detection.watch import Watch
from faultgauge.errors import InputError
from faultgauge.plants.model import Model
from faultgauge.reporting.words import answer, drift, glitches, hindsight, reliance
from faultgauge.reporting.words.unjudged import observer_sentence, unjudged_sentence
from faultgauge.verbs.how import How, Reading, reads
from faultgauge.verbs.plants import model_of
from faultgauge.verbs.reading import runs_for_model, unlike_warnings
from faultgauge.verbs.result import Columns, Result

__all__ = ["Answer", "Estimates", "estimate", "glitched", "need_bank"]


@dataclass(frozen=True, eq=False, repr=False)
class Answer(Result):
    """What the bank says of runs.

    **Fields**

    - `events`: every fault that was told, with onset, size, their intervals and probability.
    - `rows`: the table that `estimate --out` writes, a list per column: residuals, estimates with
      intervals, probabilities, a status and a reason for every sample.
    - `judged`: the share of its samples that could be judged, by run.
    - `sentences`: an answer per event, alarm and undecided end, or one that there is no fault; then
      hindsight, where it was asked for, and slow changes.
    - `drifting`: slow changes of the healthy plant; `warnings`: about the logs.
    - `model`, `decisions` (a run each) and `bank`, None where the model was not calibrated for it.
    """

    model: Model
    decisions: list[Decision]
    bank: FaultBank | None
    drifting: list[Drift]
    warnings: Sequence[str]
    smooth: bool = False
    _windows: dict[int, Evidence] = field(default_factory=dict)

    @cached_property
    def events(self) -> list[BankEvent]:
        """What happened, by run and onset."""
        return [event for each in self.decisions for event in each.events]

    @cached_property
    def rows(self) -> Columns:
        """The decisions, a row per sample: the table of the command."""
        return decisions.table(self.decisions, self.model.plant.signals.fault_names)

    @property
    def judged(self) -> dict[str, float]:
        """The share of the rows of every run, by its name, that was judged."""
        return {each.run.name: shares_of(each).judged for each in self.decisions}

    @property
    def lines(self) -> list[str]:
        """The answers in a few lines, then what is beside them."""
        if self.bank is None:
            return self._answers
        return [*answer.first_screen(self.bank, self.decisions), *self._beside]

    @property
    def sentences(self) -> list[str]:
        return [*self._answers, *self._beside]

    @cached_property
    def _answers(self) -> list[str]:
        if self.bank is None:
            return [unjudged_sentence(self.model)]
        return answer.answers(self.bank, self.decisions)

    @property
    def _beside(self) -> list[str]:
        """Hindsight, where it was asked for, and drifts."""
        seen = []
        if self.bank is not None and self.smooth:
            seen = hindsight.sentences(self.bank, self.decisions, self.hindsight())
        return [*seen, *drift.sentences(self.drifting)]

    def hindsight(self) -> list[Retrospect]:
        """Cause, size and onset as the whole log tells them, window by window."""
        return self._hindsight

    @cached_property
    def _hindsight(self) -> list[Retrospect]:
        if self.bank is None:
            return []
        bank = self.bank
        return [seen for each in self.decisions for seen in retrospective.retrospect(bank, each)]

    def evidence(self, event: BankEvent) -> Evidence:
        """The shortest part of its run (`.run`) over which the bank gives the same answer again.

        Raises `InputError` for an event that is none of `events`.
        """
        if self.bank is None or event not in self.events:
            raise InputError("this event is none of the answer's; give one of its `.events`.")
        k = self.events.index(event)
        if k not in self._windows:
            decided = next(each for each in self.decisions if event in each.events)
            self._windows[k] = evidence_of(self.bank, decided, event)
        return self._windows[k]

    def as_dict(self) -> dict[str, Any]:
        events = [] if self.bank is None else answer.as_dicts(self.bank, self.decisions)
        found: dict[str, Any] = {
            "answer": self._answers,
            "doubt": reliance.doubt(self.model),
            "events": events,
        }
        if self.smooth:
            found["retrospective"] = retrospective.as_dicts(self.hindsight())
        names = self.model.plant.signals.fault_names
        runs = answer.runs_as_dicts(self.bank, self.decisions, names)
        if self.smooth and self.bank is not None:
            for one in self.decisions:
                whole = retrospective.shares_in_hindsight(one, self.hindsight())
                runs[one.run.name]["hindsight"] = whole.as_dict({})
        return found | {
            "drift": drift.as_dicts(self.drifting),
            "warnings": list(self.warnings),
            "runs": runs,
        }

    def columns(self) -> Columns:
        return self.rows

    def page(self) -> Any:
        """With the evidence of the headline's event, of those that it was asked for of, and of the
        first; what the model and its calibration are is folded behind them."""
        from faultgauge.reporting.decision_chapter import decision_report, unjudged_report
        from faultgauge.reporting.model_chapter import with_model
        from faultgauge.reporting.report import with_sentences

        if self.bank is None:
            page = unjudged_report(self.model, self.decisions, self._answers[0])
            return with_model(page, self.model)
        seen = self.hindsight() if self.smooth else []
        asked = [self.events[k] for k in self._windows]
        windows = [
            self.evidence(e) for _, e in answer.shown_first(self.bank, self.decisions, asked)
        ]
        page = decision_report(self.bank, self.decisions, seen, windows)
        page = with_model(page, self.model, self.bank)
        reason = reliance.doubt(self.model)
        why = [f"{reason[0].upper()}{reason[1:]}."] if reason else []
        return with_sentences(page, [*why, *drift.sentences(self.drifting)])

    def figures(self) -> Any:
        """The estimate of the fault that was told for the longest time, where one was; else what
        each fault is given, and the residuals."""
        from faultgauge.reporting.decision_chapter import decision_figures

        if self.bank is None:
            return self.page().sections[0].figures
        named = [
            (event.end - event.start, k, event.fault)
            for k, each in enumerate(self.decisions)
            for event in each.events
            if event.fault != UNKNOWN
        ]
        if not named:
            return decision_figures(self.bank, self.decisions[0], {})
        _, k, fault = max(named, key=lambda each: each[0])
        shown = decision_figures(self.bank, self.decisions[k], {})
        first = 1 + self.model.plant.signals.fault_names.index(fault)
        return [shown[first], *shown[:first], *shown[first + 1 :]]


@dataclass(frozen=True, eq=False, repr=False)
class Estimates(Result):
    """What an observer alone says of every fault: estimates and no decision.

    `estimated` holds them run by run, `rows` is the table that `estimate --out` writes, `bank` the
    observers; `odd` says what is odd about the logs, `warnings` also of which fault there is no
    estimate, and why.
    """

    model: Model
    estimated: list[Estimated]
    bank: Bank
    reference: Reference
    odd: Sequence[str]
    warnings: Sequence[str]

    @property
    def events(self) -> list[BankEvent]:
        """None: an observer alone decides nothing."""
        return []

    @cached_property
    def rows(self) -> Columns:
        """The estimates, a row per sample: the table of the command."""
        return estimation.table(self.estimated, self.model.plant.signals.fault_names)

    @property
    def judged(self) -> dict[str, float]:
        """0 for every run."""
        return {each.run.name: 0.0 for each in self.estimated}

    def evidence(self, event: BankEvent) -> Evidence:
        """Raises `InputError`: there are no events."""
        raise InputError("an observer alone tells no event; the bank does.")

    @property
    def lines(self) -> list[str]:
        return [observer_sentence(self.model)]

    def as_dict(self) -> dict[str, Any]:
        return {"answer": self.lines, "events": [], "drift": [], "warnings": list(self.odd)}

    def columns(self) -> Columns:
        return self.rows

    def page(self) -> Any:
        from faultgauge.reporting.chapters import estimate_report
        from faultgauge.reporting.model_chapter import with_model

        page = estimate_report(self.model, self.estimated, self.bank, self.reference)
        return with_model(page, self.model)

    def figures(self) -> Any:
        return self.page().sections[0].figures


@reads
def estimate(
    model: Any,
    sources: Any,
    *,
    observer: str = "bank",
    reference: Reference = "free",
    smooth: bool = False,
    walk: Walk = Watch.along,
    progress: Callable[[str], None] = lambda text: None,
    **reading: Unpack[Reading],
) -> Answer | Estimates:
    """Estimate faults in logs, in physical units.

    **Arguments**

    - `model`: a calibrated model, or its file. One that was not calibrated gives rows that are
      NOT_JUDGED, and a sentence that says so.
    - `sources`: the logs: paths, data frames, dicts of arrays, runs, or a list of them (`read`,
      which also says what `time`, `time_format`, `map`, `where` and `resample` mean).
    - `observer`: `"bank"` decides; the name of an observer, `"eso"`, gives its estimates alone.
    - `reference`: the healthy reference of the residuals: `"free"`, `"measured"`, `"observer"`.
    - `smooth`: say also what the whole log tells, with hindsight.
    - `walk`: who runs the step along a log: `faultgauge.export.engine.Engine(folder)` runs it as C.
    - `progress`: is told what is being done; a text that is a `faultgauge.progress.Step` has the
      `share` that is done.

    Returns an `Answer`: `print` it, and see its `events`, `rows`, `hindsight()`, `evidence(event)`,
    `plot()`, `report(path)`; with another observer `Estimates`. Raises `InputError` for logs that
    cannot be read and where no fault is declared that can be judged.
    """
    need_bank(observer, {"smooth": smooth})
    known = model_of(model)
    runs = runs_for_model(known, sources, How(**reading))
    warnings = unlike_warnings(known, runs)
    if observer != "bank":
        estimated, observers = estimation.estimate(
            known, runs, observer=observer, reference=reference
        )
        said = [*warnings, *observers.refused.values()]
        return Estimates(known, estimated, observers, reference, warnings, said)
    decided, bank = decisions.decide_runs(known, runs, reference, walk, progress)
    progress("looking for slow changes")
    warnings += misfit.alarmed_throughout(decided)
    warnings += [] if bank is None else swapped_in(known, decided)
    warnings += standing_in(known, decided)
    warnings += glitched(decided)
    reason = None if bank is None else reliance.doubt(known)
    warnings += [reason] if reason else []
    drifting = [] if bank is None else drifts(bank, decided)
    found = Answer(known, decided, bank, drifting, warnings, smooth)
    if smooth:
        progress("weighing what the whole log tells")
        found.hindsight()
    return found


def glitched(decided: Sequence[Decision]) -> list[str]:
    """What is said of samples that nothing explains."""
    each = [(f"run {d.run.name}", d.glitches, d.run.clock, d.run.step) for d in decided]
    return [text for one in each for text in glitches.sentences(*one)]


def need_bank(observer: str, given: dict[str, bool]) -> None:
    """Raises `InputError` where something is `given`, by its name, that only the bank has."""
    for name in (name for name, there in given.items() if there and observer != "bank"):
        raise InputError(
            f"{name} rests on the bank's hypotheses, which --observer {observer} does not "
            "weigh; leave one of the two out."
        )
