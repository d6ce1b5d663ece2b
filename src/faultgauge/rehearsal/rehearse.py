"""`rehearse`: put declared faults into healthy logs and ask the calibrated model."""

import pickle
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np

from faultgauge.crew.crew import Done, done
from faultgauge.errors import InputError
from faultgauge.plants.expression import unknown
from faultgauge.plants.model import Model
from faultgauge.plants.signals import Fault, Signals
from faultgauge.progress import Step
from faultgauge.rehearsal.design import (
    MIDDLE,
    Dose,
    RehearsalPlan,
    Subject,
    doses_of,
    plans,
    windows_of,
)
from faultgauge.rehearsal.injection import Injected, NotInjectable, inject
from faultgauge.rehearsal.judging import (
    Event,
    Judge,
    Judgement,
    check_calibrated,
    false_alarm_rate,
)
from faultgauge.rehearsal.result import InjectedFault, Rehearsal, Trial
from faultgauge.rehearsal.scoring import fault_results, large, pair_results
from faultgauge.rehearsal.shares import FOUND, poisson, wilson
from faultgauge.rehearsal.ways import Way, way_of
from faultgauge.telemetry import Run

__all__ = ["TRIALS", "rehearse", "score"]

TRIALS = 200  # logs that are judged
UNTOUCHED = 4  # at most one in so many of them is an untouched window
FORETOLD = 4  # windows, at most, in which sizes are foretold for onsets along them
CHUNK = 8  # logs that a worker judges at once
SAID = "said"
ONSETS = np.linspace(*MIDDLE, 7)  # shares of a window


def rehearse(
    model: Model,
    runs: Sequence[Run],
    *,
    sizes: Mapping[str, float] | None = None,
    trials: int = TRIALS,
    scheduler: str | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Rehearsal:
    """What `model` finds of its declared faults in healthy `runs` that neither its fit nor its
    calibration has seen, at most `trials` logs being judged in all.

    Each run is cut into windows of at most 2000 samples. Into each window go, one at a time, every
    fault that is not disabled and can be put into a recorded log (`ways`), in 8 sizes from 0.25 to
    16 times the smallest one that the model foretells, or the one of `sizes` [the fault's unit],
    both signs where the limits allow them, from an onset at random on; pairs of faults at 4 and 8
    times; and nothing. Where `rate` is declared the fault grows at that rate, else it is there at
    once. A `scheduler` has the logs judged by its workers (`crew.crew`).

    Raises `InputError` for a model without calibration, where no fault can be rehearsed, for runs
    that are too short, for an unknown fault or a size of 0 in `sizes`, and for fewer than 2
    `trials`.
    """
    signals, sizes = model.plant.signals, sizes or {}
    check_calibrated(model)
    _check(signals, sizes, trials)
    windows, warnings = windows_of(runs)
    usual = sorted(windows, key=lambda each: len(each.t))[len(windows) // 2]
    progress("asking the model for its smallest faults")
    subjects, left_out = _subjects(model, usual, sizes)
    if not subjects:
        why = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise InputError(f"no fault can be rehearsed on these logs ({why}); declare others.")

    lab = _Lab(signals, windows, {each.fault.name: each for each in subjects})
    untouched = _spread(len(windows), max(trials // UNTOUCHED, 1))
    pairs = signals.max_simultaneous > 1 and not sizes
    planned = _planned(lab, subjects, trials - len(untouched), pairs)
    logs = [*((k, windows[k]) for k in untouched), *((p.window, lab.log(p)) for p in planned)]
    said = _judged(model, logs, scheduler, progress)
    along = _along(model, windows)
    calm, asked = said[: len(untouched)], said[len(untouched) :]
    scores = tuple(
        score(k, windows[plan.window].name, plan, each)
        for k, (plan, each) in enumerate(zip(planned, asked, strict=True))
    )
    return Rehearsal(
        plant=model.plant.spec.name,
        windows={each.name: len(each.t) for each in windows},
        faults=fault_results(subjects, scores, lab.refused, along),
        pairs=pair_results(scores),
        exact=wilson(sum(e.exact for e in large(scores)), len(large(scores))),
        false_alarms=poisson(sum(len(e.alarms) for e in calm), sum(e.hours for e in calm)),
        calibrated_rate=false_alarm_rate(model),
        left_out=left_out,
        trials=scores,
        warnings=(*_seen_before(model, runs), *warnings),
    )


@dataclass(frozen=True)
class _Lab:
    """Puts `subjects` into `windows`, and counts what these do not allow."""

    signals: Signals
    windows: Sequence[Run]
    subjects: Mapping[str, Subject]
    refused: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))

    def log(self, plan: RehearsalPlan) -> Run:
        """The window with the faults in it. Raises `NotInjectable`."""
        injected = []
        for dose, onset in zip(plan.doses, plan.onsets, strict=True):
            fault, way, *_ = self.subjects[dose.fault]
            injected.append(Injected(way, dose.size, onset, fault.rate))
        return inject(self.windows[plan.window], self.signals, injected)

    def allows(self, plan: RehearsalPlan) -> bool:
        """Whether the window allows the faults; counted where it does not allow a single one."""
        try:
            self.log(plan)
        except NotInjectable as reason:
            if len(plan.doses) == 1:
                self.refused[plan.doses[0].fault][str(reason)] += 1
            return False
        return True


def _planned(lab: _Lab, subjects: Sequence[Subject], room: int, pairs: bool) -> list[RehearsalPlan]:
    """At most `room` plans, window by window: logs of one are judged together. Raises `InputError`
    where no fault fits into any."""
    planned = plans(subjects, lab.windows, room, lab.allows, pairs=pairs)
    if not planned:
        why = "; ".join(f"{name}: {', '.join(reasons)}" for name, reasons in lab.refused.items())
        raise InputError(
            f"no fault fits into these logs ({why}); give logs farther from the limits."
        )
    return sorted(planned, key=lambda plan: plan.window)


def score(number: int, window: str, plan: RehearsalPlan, said: Judgement) -> Trial:
    """What `said` makes of the faults that `plan` put into `window`."""
    first = min(plan.onsets)
    after = [each for each in said.events if each.told >= first]
    return Trial(
        number,
        window,
        tuple(_answer(d, at, after) for d, at in zip(plan.doses, plan.onsets, strict=True)),
        tuple(dict.fromkeys(each.fault for each in after)),
        any(last >= first for _, last in said.alarms),
        len(said.events) - len(after),
        said.not_judged,
    )


def _answer(dose: Dose, onset: float, events: Sequence[Event]) -> InjectedFault:
    unasked = InjectedFault(dose.fault, dose.size, onset, dose.times)
    mine = [each for each in events if each.fault == dose.fault and each.told >= onset]
    if not mine:
        return unasked
    first = min(mine, key=lambda each: each.told)
    longest = max(mine, key=lambda each: each.end - each.told)
    low, high = longest.lo, longest.hi
    return replace(
        unasked,
        delay=first.told - onset,
        estimate=longest.size,
        size_covered=None if low is None or high is None else bool(low <= dose.size <= high),
        onset_covered=bool(first.onset_lo <= onset <= first.onset_hi),
    )


def _check(signals: Signals, sizes: Mapping[str, float], trials: int) -> None:
    if trials < 2:
        raise InputError(f"{trials} trials are too few: one untouched log and one with a fault.")
    for name, size in sizes.items():
        if name not in signals.fault_names:
            raise InputError(f"size of {unknown('fault', name, signals.fault_names)}.")
        if size == 0 or not np.isfinite(size):
            raise InputError(
                f"fault {name!r} of size {size:g} is none; give a size that is finite and not 0."
            )
        fault = signals.faults[signals.fault_names.index(name)]
        if not fault.min <= size <= fault.max:
            raise InputError(
                f"fault {name!r} of size {size:g} is outside its limits in the plant file, "
                f"{fault.min:g} to {fault.max:g}; give a size within them."
            )


def _subjects(
    model: Model, window: Run, sizes: Mapping[str, float]
) -> tuple[list[Subject], dict[str, str]]:
    """(the faults to rehearse, why the others are not); where `sizes` are given, those alone."""
    found: list[Subject] = []
    left_out: dict[str, str] = {}
    ways = dict[str, Way]()
    faults = [each for each in model.plant.signals.faults if not sizes or each.name in sizes]
    for fault in faults:
        way = _way(model, window, fault)
        if isinstance(way, Way):
            ways[fault.name] = way
        else:
            left_out[fault.name] = way
    smallest = Judge(model, [window]).smallest(window, 0.5)[0] if ways else {}
    for fault in (each for each in faults if each.name in ways):
        least = smallest[fault.name]
        doses = doses_of(fault, least, sizes.get(fault.name))
        if doses:
            found.append(Subject(fault, ways[fault.name], least, doses))
        else:
            left_out[fault.name] = (
                "its limits allow none of the sizes"
                if least is not None
                else f"the model foretells none that it would name in {len(window.t)} samples; "
                "give a size to try"
            )
    return found, left_out


def _way(model: Model, window: Run, fault: Fault) -> Way | str:
    """How `fault` gets into the window, or why it does not."""
    if fault.monitor == "disabled":
        return "disabled in the plant file"
    way = way_of(model, fault)
    if way is None:
        return f"a {fault.enters} fault, which cannot be put into a recorded log"
    return way if way.column in window.columns else f"the log has no column {way.column!r}"


def _along(model: Model, windows: Sequence[Run]) -> dict[str, float | None]:
    """The size of each fault that the model foretells it would name in 90 % of onsets as those of
    the trials are, in some of `windows`; None where none."""
    some = [windows[k] for k in _spread(len(windows), FORETOLD)]
    sizes = [each for run in some for each in Judge(model, [run]).smallest(run, *ONSETS)]
    found = {}
    for name in model.plant.signals.fault_names:
        own = [np.inf if size is None else size for each in sizes for size in (each[name],)]
        size = float(np.quantile(own, FOUND, method="higher"))  # none is the largest
        found[name] = size if np.isfinite(size) else None
    return found


def _spread(count: int, most: int) -> list[int]:
    """At most `most` of `count` windows, evenly."""
    return [int(k) for k in np.unique(np.linspace(0, count - 1, min(count, most)).round())]


@dataclass(frozen=True)
class _Logs:
    """Some logs of one window, which have one step: the `number` of the first of all."""

    number: int
    runs: Sequence[Run]

    @property
    def name(self) -> str:
        return str(self.number)


@dataclass(frozen=True)
class _Job:
    """Judges logs, wherever it is."""

    model: Model

    def __call__(self, piece: _Logs) -> Done:
        judge = Judge(self.model, piece.runs)
        return Done(piece.name, {SAID: pickle.dumps([judge(run) for run in piece.runs])})


def _judged(
    model: Model,
    logs: Sequence[tuple[int, Run]],
    scheduler: str | None,
    progress: Callable[[str], None],
) -> list[Judgement]:
    """What the model says of each of `logs`."""
    pieces, first = list[_Logs](), 0
    for _, group in groupby(logs, key=lambda each: each[0]):
        runs = [run for _, run in group]
        few = len(runs) if scheduler is None else CHUNK
        pieces += [_Logs(first + k, runs[k : k + few]) for k in range(0, len(runs), few)]
        first += len(runs)
    said: dict[int, list[Judgement]] = {}
    for each in done(scheduler, _Job(model), pieces, progress):
        said[int(each.name)] = pickle.loads(each.files[SAID])
        count = sum(map(len, said.values()))
        progress(Step(f"rehearsing: {count} of {len(logs)} logs judged", count / len(logs)))
    return [each for _, some in sorted(said.items()) for each in some]


def _seen_before(model: Model, runs: Sequence[Run]) -> list[str]:
    """A sentence for what the model was made with, which it knows better than new logs."""
    data = model.record.data
    known = {
        "the fit": {*data.fit, *data.validate_},
        "the calibration": {*(model.calibration.data if model.calibration else ())},
    }
    found = []
    for where, hashes in known.items():
        names = [run.name for run in runs if run.content_hash in hashes]
        if names:
            found.append(
                f"{', '.join(names)}: also used in {where}, so the rehearsal may look better than "
                "the model is; give other healthy logs if you can"
            )
    return found
