"""One case from its logs to its figures: fitted once, calibrated once, then judged log by log."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations, cycle, islice
from typing import Any

import numpy as np

from faultgauge.detection.answer.smallest import smallest_along
from faultgauge.detection.bank.bank import FaultBank
from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.decisions import decide_runs
from faultgauge.detection.rows.prepared import as_it_acts
from faultgauge.errors import InputError
from faultgauge.identification.fit import fit
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from mismatch.case import Case, Injected
from mismatch.scoring import Trial, figures, scored
from mismatch.stairs import Step, drawn_stairs, scored_stairs, stair_figures
from mismatch.windows import Window, drawn_windows, scored_windows, window_figures

__all__ = ["calibrated", "healthy_logs", "measure", "without_discrepancy"]

CALIBRATIONS = 5  # logs
FIT, CALIBRATE, HEALTHY, FAULTY, WINDOWS, STAIRS = range(
    6
)  # the first number of a log's seed; then 0 to N - 1
EARLIEST, LATEST = 0.25, 0.6  # of the log: where onsets lie
SHORTEST, LONGEST = 0.15, 0.25  # of the log: every third log's faults are over after so long
RULES = ("engineering", "x4", "x8")
BATCH = 10  # logs judged at a time
IN_TURN = 3  # logs with one fault to each with several in turn

Faults = tuple[str, ...]


@dataclass(frozen=True)
class Draw:
    """What a test log shall hold: its faults, and how they are sized."""

    faults: Faults
    rule: str


def without_discrepancy() -> dict[str, Any]:
    """How to switch model error off, THE ONE PLACE that knows. Raises `SystemExit` where
    `calibrate` has no such switch."""
    if "discrepancy" not in inspect.signature(calibrate).parameters:
        raise SystemExit("calibrate has no option `discrepancy`: there is nothing to switch off.")
    return {"discrepancy": False}


def predicted_smallest(bank: FaultBank, run: Run, fault: int) -> float | None:
    """The smallest size the model itself says it would tell; THE ONE PLACE that asks."""
    return smallest_along(bank, as_it_acts(bank.model.plant.signals, run))[fault]


def calibrated(
    plant: Any, fitted: Sequence[Run], healthy: Sequence[Run], options: Mapping[str, Any]
) -> tuple[Model, list[str]]:
    """A model from logs, by the verbs that a user calls, and their warnings."""
    model, report = fit(plant, fitted)
    found = calibrate(model, healthy, **options)
    return found.model, [*report.warnings, *found.warnings]


def healthy_logs(case: Case) -> tuple[list[Run], list[Run]]:
    """(logs to fit, logs to calibrate on)."""
    fitted = [case.log(f"fit {k}", _rng(FIT, k)) for k in range(case.fits)]
    return fitted, [case.log(f"calibrate {k}", _rng(CALIBRATE, k)) for k in range(CALIBRATIONS)]


def measure(
    case: Case,
    faulty: int,
    healthy: int,
    options: Mapping[str, Any],
    progress: Callable[[str], None],
) -> dict[str, Any]:
    """The case's figures and trials as plain JSON, or why there are none."""
    progress(f"{case.name}: fitting and calibrating")
    fitted, sound = healthy_logs(case)
    try:
        model, warnings = calibrated(case.plant, fitted, sound, options)
    except InputError as refusal:
        return {"case": case.name, "refused": str(refusal)}
    logs = [case.log(f"healthy {k}", _rng(HEALTHY, k)) for k in range(healthy)]
    quiet, bank = _judge(case, model, logs, [""] * healthy, [{}] * healthy, progress)
    smallest = _smallest(case, bank, logs[0])
    sized = [injections(case, each, smallest, k) for k, each in enumerate(draws(case, faulty))]
    rules, injected = [rule for rule, _ in sized], [each for _, each in sized]
    logs = [
        case.log(f"faulty {k}", _rng(FAULTY, k), each.items()) for k, each in enumerate(injected)
    ]
    trials, _ = _judge(case, model, logs, rules, injected, progress)
    several = max(faulty // IN_TURN, 1)
    windows = _windows(case, model, several, progress)
    return {
        "case": case.name,
        "warnings": warnings,
        "smallest": smallest,
        **figures(quiet, trials),
        "windows": windows,
        "stairs": _stairs(case, model, several, progress),
        "trials": [asdict(each) for each in (*quiet, *trials)],
    }


def draws(case: Case, count: int) -> list[Draw]:
    """`count` of every set of faults with every rule of sizes, in a random order that repeats;
    singles and pairs take turns."""
    rng = np.random.default_rng(0)
    singles: list[Faults] = [(name,) for name in case.sizes]
    groups = [singles, list(combinations(case.sizes, 2))] if case.pairs else [singles]
    shuffled = []
    for group in groups:
        every = [Draw(faults, rule) for faults in group for rule in RULES]
        shuffled.append(cycle([every[k] for k in rng.permutation(len(every))]))
    return [next(turn) for turn in islice(cycle(shuffled), count)]


def injections(
    case: Case, draw: Draw, smallest: Mapping[str, float | None], seed: int
) -> tuple[str, dict[str, Injected]]:
    """Size, sign, onset and end of every fault of a log, and the rule that sized them. It is
    "engineering" too where the model predicts no smallest size, and "largest" where a multiple of
    it makes no sense and the largest sensible size stands for it."""
    rng, lasting = (np.random.default_rng([FAULTY, seed, part]) for part in (1, 2))
    truth = case.truth(_rng(FAULTY, seed))
    samples, rule, found = len(truth.noise), draw.rule, dict[str, Injected]()
    for name in draw.faults:
        sizes = case.sizes[name]
        size = float(rng.uniform(sizes.low, sizes.high))
        told, times = case.told_as.get(name, (name, 1.0))
        least = smallest.get(told)  # None of what is not declared
        if draw.rule != RULES[0] and least is None:
            rule = RULES[0]
        elif draw.rule != RULES[0] and least is not None:
            wanted = int(draw.rule[1:]) * least / times
            size = min(wanted, sizes.most)
            rule = rule if size == wanted else "largest"
        at = int(rng.uniform(EARLIEST, LATEST) * samples)
        lasts = int(lasting.uniform(SHORTEST, LONGEST) * samples) if seed % 3 == 2 else samples
        size, end = float(rng.choice(sizes.signs)) * size, (at + lasts) * truth.step
        found[name] = Injected(size, at * truth.step, end)
    return rule, found


def _smallest(case: Case, bank: FaultBank | None, run: Run) -> dict[str, float | None]:
    names = case.plant.signals.fault_names
    if bank is None:
        return dict.fromkeys(names)
    return {name: predicted_smallest(bank, run, k) for k, name in enumerate(names)}


def _judge(
    case: Case,
    model: Model,
    runs: Sequence[Run],
    rules: Sequence[str],
    injected: Sequence[Mapping[str, Injected]],
    progress: Callable[[str], None],
) -> tuple[list[Trial], FaultBank | None]:
    found, bank, names = list[Trial](), None, case.plant.signals.fault_names
    for first in range(0, len(runs), BATCH):
        part = slice(first, first + BATCH)
        decisions, bank = decide_runs(model, runs[part])
        for decision, rule, each in zip(decisions, rules[part], injected[part], strict=True):
            found.append(scored(decision, names, _by_right_name(case, each), rule))
        progress(f"{case.name}: {len(found)} of {len(runs)} {runs[0].name.split()[0]}")
    return found, bank


def _windows(
    case: Case, model: Model, count: int, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Figures of `count` logs in which one fault follows another."""
    found, false = list[Window](), 0
    for k in range(count):
        truth = case.truth(_rng(WINDOWS, k))
        injected = drawn_windows(case, k, len(truth.noise), truth.step)
        run = case.log(f"windows {k}", _rng(WINDOWS, k), injected.items())
        (decision,), _ = decide_runs(model, [run])
        some, others = scored_windows(case, decision, injected)
        found, false = [*found, *some], false + others
        progress(f"{case.name}: {k + 1} of {count} logs with several faults in turn")
    return {**window_figures(found, false, count), "each": [asdict(each) for each in found]}


def _stairs(
    case: Case, model: Model, count: int, progress: Callable[[str], None]
) -> dict[str, Any]:
    """Figures of `count` logs in which one fault jumps from size to size; the faults take turns."""
    found, false = list[Step](), 0
    for k in range(count):
        truth = case.truth(_rng(STAIRS, k))
        name, injected = drawn_stairs(case, k, len(truth.noise), truth.step)
        run = case.log(f"stairs {k}", _rng(STAIRS, k), [(name, each) for each in injected])
        (decision,), _ = decide_runs(model, [run])
        some, others = scored_stairs(case, decision, name, injected)
        found, false = [*found, *some], false + others
        progress(f"{case.name}: {k + 1} of {count} logs with a fault that jumps")
    return {**stair_figures(found, false, count), "each": [asdict(each) for each in found]}


def _by_right_name(case: Case, injected: Mapping[str, Injected]) -> dict[str, Injected]:
    """The faults under the names, and in the sizes, in which they are rightly told."""
    found = {}
    for name, each in injected.items():
        told, times = case.told_as.get(name, (name, 1.0))
        found[told] = Injected(each.size * times, each.onset, each.end)
    return found


def _rng(*seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)
