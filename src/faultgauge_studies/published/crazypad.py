"""CrazyPAD: which propeller of a hovering quadrotor is damaged, and by how much.

Fitted and calibrated on the five healthy flights of vehicle E8, then every flight is judged. The
damage is there from the first sample and the loop is closed: what shows is that the damaged motor
is commanded more, against how much trims differ between healthy flights. There is no true size;
what is known is which motor, and the order of the cuts. The healthy flights are judged as well, by
what they taught: their figures are no proof.
"""

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.stats import rankdata

from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.decisions import decide_runs
from faultgauge.detection.posterior.events import BankEvent
from faultgauge.detection.posterior.verdicts import NOT_JUDGED
from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.telemetry import Run
from faultgauge_studies.published.benchmark import plant_named
from faultgauge_studies.published.faulted_data import flights
from faultgauge_studies.published.spread import spread

__all__ = ["Answer", "Case", "Flights", "Trial", "answer_of", "case_of", "measure", "score"]

CUT = "M3"  # the propeller that was shortened
PLAIN = 3.0  # mm cut off in all, from which on the motor must be named
CERTAIN = 0.95  # p of a name that counts as certain
LONGEST_CUT = 10.0  # mm; longer is what is left of the propeller
HEALTHY, SHORTENED, TAPED, WEIGHT = "healthy", "cut", "tape", "weight"


@dataclass(frozen=True)
class Case:
    """What was done to the vehicle: `kind`, the damaged `motors`, how many mm were cut off in
    all (0 where nothing was)."""

    kind: str
    motors: tuple[str, ...]
    cut: float


@dataclass(frozen=True)
class Answer:
    """What was said of one flight.

    `named` is every motor with an event and the largest p of its events; `loss`, `lo` and `hi` are
    M3's estimate and interval at the end of the flight; `judged` is the share of rows that were.
    """

    flight: str
    case: Case
    named: dict[str, float]
    sizes: dict[str, tuple[float, float, float]]
    loss: float
    lo: float
    hi: float
    judged: float


@dataclass(frozen=True)
class Trial:
    """One seed: every answer, and how long fit, calibration and all judging took [s]."""

    seed: int
    answers: list[Answer]
    fit_s: float
    calibrate_s: float
    judge_s: float


@dataclass(frozen=True)
class Flights:
    """What `faultgauge benchmark crazypad` found."""

    trials: list[Trial]

    def as_dict(self) -> dict[str, Any]:
        """What `--json` prints."""
        scores = [score(trial.answers) for trial in self.trials]
        return {
            "benchmark": "crazypad",
            "scores": {
                name: spread([_number(each[name]) for each in scores]) for name in scores[0]
            },
            "seeds": [
                {"seed": trial.seed, "flights": [_plain(each) for each in trial.answers]}
                for trial in self.trials
            ],
            "fit_s": spread([trial.fit_s for trial in self.trials]),
            "calibrate_s": spread([trial.calibrate_s for trial in self.trials]),
            "judge_s": spread([trial.judge_s for trial in self.trials]),
        }

    def table(self) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
        """Header and a row per flight and seed, by kind and cut."""
        header = ("flight", "cut (mm)", "named", "loss named", "loss of M3", "judged (%)")
        rows = []
        for trial in self.trials:
            of = f", seed {trial.seed}" if len(self.trials) > 1 else ""
            for each in sorted(trial.answers, key=lambda a: (a.case.kind, a.case.cut, a.flight)):
                rows.append(
                    (
                        f"{each.flight}{of}",
                        f"{each.case.cut:g}" if each.case.cut else "",
                        ", ".join(each.named) or "none",
                        ", ".join(_interval(*size) for size in each.sizes.values()),
                        _interval(each.loss, each.lo, each.hi),
                        f"{100 * each.judged:.0f}",
                    )
                )
        return header, tuple(rows)

    @property
    def notes(self) -> tuple[str, ...]:
        """Each seed's scores in a sentence, and its times."""
        said = []
        for trial in self.trials:
            s = score(trial.answers)
            rank = "undefined" if s["spearman"] is None else f"{s['spearman']:.3f}"
            said.append(
                f"Seed {trial.seed}: M3 named in {s['plain_named']} of {s['plain']} flights with "
                f"{PLAIN:g} mm or more cut off; another motor in {s['cut_wrong']} of {s['cut']} "
                f"flights with a cut, in {s['tape_wrong']} of {s['tape']} with tape, in "
                f"{s['weight_wrong']} of {s['weight']} with a weight for certain, in "
                f"{s['healthy_wrong']} of {s['healthy']} healthy ones; Spearman of cut and "
                f"estimate {rank}. Fit {trial.fit_s:.0f} s, calibration {trial.calibrate_s:.0f} s, "
                f"judging {trial.judge_s:.0f} s."
            )
        return tuple(said)


def case_of(flight: str) -> Case:
    """What the name of a flight says of it, as `cut_propeller_M3_2mm_1.5mm_43.5mm_log00`."""
    if flight.startswith("normal"):
        return Case(HEALTHY, (), 0.0)
    motors = tuple(re.findall(r"M[1-4]", flight))
    if flight.startswith("cut"):
        lengths = [float(each) for each in re.findall(r"_([\d.]+)mm", flight)]
        return Case(SHORTENED, motors, sum(each for each in lengths if each < LONGEST_CUT))
    return Case(TAPED, motors, 0.0) if flight.startswith("tape") else Case(WEIGHT, (), 0.0)


def score(answers: Sequence[Answer]) -> dict[str, int | float | None]:
    """Counts of flights by case, of those that went wrong, and Spearman's rank correlation of the
    cut and the estimate of M3's loss over all flights with a cut; None where it is undefined."""
    cuts = [a for a in answers if a.case.kind == SHORTENED]
    plain = [a for a in cuts if a.case.cut >= PLAIN]
    found: dict[str, int | float | None] = {
        "plain": len(plain),
        "plain_named": sum(CUT in a.named for a in plain),
    }
    for kind in (SHORTENED, TAPED, WEIGHT, HEALTHY):
        own = [a for a in answers if a.case.kind == kind]
        least = CERTAIN if kind == WEIGHT else 0.0
        found[kind] = len(own)
        found[f"{kind}_wrong"] = sum(_wrong(each, least) for each in own)
    found["spearman"] = _rank_correlation([a.case.cut for a in cuts], [a.loss for a in cuts])
    return found


def answer_of(
    flight: str,
    events: Sequence[BankEvent],
    status: Sequence[str],
    estimate: Float[np.ndarray, "samples three"],
) -> Answer:
    """What was said of a flight: its events, and M3's estimate with its interval over time."""
    named: dict[str, float] = {}
    sizes: dict[str, tuple[float, float, float]] = {}
    for event in events:
        if event.size is None or event.lo is None or event.hi is None:
            continue  # undeclared: no name
        motor = _motor(event.fault)
        if event.p > named.get(motor, 0.0):
            named[motor] = event.p
            sizes[motor] = (event.size, event.lo, event.hi)
    there = estimate[np.isfinite(estimate).all(axis=1)]
    loss, lo, hi = there[-1].tolist() if len(there) else (0.0, 0.0, 1.0)
    judged = float(np.mean(np.array(status) != NOT_JUDGED))
    return Answer(flight, case_of(flight), named, sizes, loss, lo, hi, judged)


def measure(seeds: Sequence[int], progress: Callable[[str], None] = lambda text: None) -> Flights:
    """Judge all flights with every seed. Raises `InputError` where the data are absent, or the
    healthy flights do not calibrate."""
    runs, plant = flights(), plant_named("crazypad")
    return Flights([_trial(plant, runs, seed, progress) for seed in seeds])


def _trial(
    plant: GrayBoxPlant, runs: dict[str, Run], seed: int, progress: Callable[[str], None]
) -> Trial:
    begin = f"CrazyPAD, seed {seed}"
    healthy = [run for name, run in runs.items() if case_of(name).kind == HEALTHY]
    times = [time.perf_counter()]
    model, _ = fit(plant, healthy, seed=seed, progress=lambda text: progress(f"{begin}: {text}"))
    times.append(time.perf_counter())
    progress(f"{begin}: calibrating")
    model = calibrate(model, healthy).model
    times.append(time.perf_counter())
    answers, cut = [], [_motor(each) for each in plant.signals.fault_names].index(CUT)
    for name, run in runs.items():
        progress(f"{begin}: {name}")
        (decision,), _ = decide_runs(model, [run])
        found = decision.posterior
        estimate = np.stack([found.f[:, cut], found.lo[:, cut], found.hi[:, cut]], axis=1)
        answers.append(answer_of(name, decision.events, decision.status, estimate))
    times.append(time.perf_counter())
    fit_s, calibrate_s, judge_s = (b - a for a, b in pairwise(times))
    return Trial(seed, answers, fit_s, calibrate_s, judge_s)


def _wrong(answer: Answer, least: float) -> bool:
    """Whether a motor that is whole is named with p of `least` or more."""
    return any(p >= least for name, p in answer.named.items() if name not in answer.case.motors)


def _rank_correlation(cuts: Sequence[float], losses: Sequence[float]) -> float | None:
    if len(set(cuts)) < 2 or len(set(losses)) < 2:
        return None
    return float(np.corrcoef(rankdata(cuts), rankdata(losses))[0, 1])


def _motor(fault: str) -> str:
    return fault.removeprefix("loss_").upper()


def _interval(size: float, lo: float, hi: float) -> str:
    return f"{size:.3f} ({lo:.3f} to {hi:.3f})"


def _number(value: int | float | None) -> float:
    return np.nan if value is None else float(value)


def _plain(each: Answer) -> dict[str, Any]:
    return {
        "flight": each.flight,
        "kind": each.case.kind,
        "cut_mm": each.case.cut,
        "named": each.named,
        "sizes": {motor: list(size) for motor, size in each.sizes.items()},
        "loss_m3": [each.loss, each.lo, each.hi],
        "judged_share": each.judged,
    }
