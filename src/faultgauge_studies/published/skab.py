"""SKAB by the protocol of its list of results: 34 experiments, each judged by its own beginning.

The first 400 rows of a file are fitted and calibrated on, the rest is scored, all files pooled.
A row is an alarm where its status is FAULT. What is NOT_JUDGED counts as no alarm, and its share
stands beside the scores; the scores of the judged rows alone are given as well.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool

from faultgauge.detection.calibration.calibration import calibrate
from faultgauge.detection.decisions import decide_runs
from faultgauge.detection.posterior.verdicts import FAULT, NOT_JUDGED
from faultgauge.errors import InputError
from faultgauge.identification.fit import fit
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.telemetry import Run, cut
from faultgauge_studies.published.benchmark import plant_named
from faultgauge_studies.published.faulted_data import SENSORS, Experiment, water_loop
from faultgauge_studies.published.skab_baselines import t_squared, t_squared_q
from faultgauge_studies.published.spread import spread

__all__ = ["PUBLISHED", "Score", "Statuses", "Trial", "WaterLoop", "judge", "measure", "score"]

TRAIN = 400  # rows
BASELINES = {"T-squared": t_squared, "T-squared + Q": t_squared_q}
NAMES = ("f1", "far_percent", "mar_percent")


class Score(NamedTuple):
    """Per row: F1; false alarm rate, of the rows without an anomaly, and missed alarm rate, of
    those with one [%]. NaN where there are no such rows."""

    f1: float
    far_percent: float
    mar_percent: float


PUBLISHED = {  # from the set's list of results
    "Conv-AE": Score(0.78, 13.6, 28.0),
    "MSET": Score(0.78, 39.7, 14.1),
    "T-squared + Q": Score(0.76, 26.6, 24.9),
    "T-squared": Score(0.66, 19.2, 42.6),
}


class Statuses(NamedTuple):
    """The scored rows of one experiment: their statuses, why its log was refused ("" otherwise),
    and how long fit and calibration, and the judging, took [s]."""

    status: list[str]
    refused: str
    learning_s: float
    judging_s: float


@dataclass(frozen=True)
class Trial:
    """One seed over all experiments."""

    seed: int
    pooled: Score
    judged_only: Score
    not_judged: float
    refused: dict[str, str]
    learning_s: float
    judging_s: float


@dataclass(frozen=True)
class WaterLoop:
    """What `faultgauge benchmark skab` found."""

    trials: list[Trial]
    baselines: dict[str, Score]
    rows: int

    def as_dict(self) -> dict[str, Any]:
        """What `--json` prints."""
        return {
            "benchmark": "skab",
            "rows": self.rows,
            "faultgauge": {
                **self._spread("pooled"),
                "not_judged": spread([trial.not_judged for trial in self.trials]),
            },
            "faultgauge_judged_rows": self._spread("judged_only"),
            "baselines": {name: each._asdict() for name, each in self.baselines.items()},
            "published": {name: each._asdict() for name, each in PUBLISHED.items()},
            "refused": {f"seed {trial.seed}": trial.refused for trial in self.trials},
            "learning_s": spread([trial.learning_s for trial in self.trials]),
            "judging_s": spread([trial.judging_s for trial in self.trials]),
        }

    def table(self) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
        """Header and rows: ours, in all and where judged, then the baselines and published ones."""
        header = ("", "F1", "FAR (%)", "MAR (%)", "not judged (%)")
        rows = []
        for trial in self.trials:
            of = f", seed {trial.seed}" if len(self.trials) > 1 else ""
            rows.append((f"faultgauge{of}", *_cells(trial.pooled), f"{100 * trial.not_judged:.1f}"))
            rows.append((f"its judged rows{of}", *_cells(trial.judged_only), ""))
        rows += [(f"{name}, run here", *_cells(each), "") for name, each in self.baselines.items()]
        rows += [(f"{name}, published", *_cells(each), "") for name, each in PUBLISHED.items()]
        return header, tuple(rows)

    @property
    def notes(self) -> tuple[str, ...]:
        """Protocol, refusals, times."""
        said = [
            "The first 400 rows of each file train, the rest is scored, all files pooled; "
            "NOT_JUDGED counts as no alarm."
        ]
        for trial in self.trials:
            said += [f"{name} not judged: {why}" for name, why in trial.refused.items()]
            said.append(
                f"Seed {trial.seed}: fit and calibration {trial.learning_s:.0f} s, judging "
                f"{trial.judging_s:.0f} s."
            )
        return tuple(said)

    def _spread(self, which: str) -> dict[str, dict[str, float | None]]:
        scores = [getattr(trial, which) for trial in self.trials]
        return {name: spread([getattr(each, name) for each in scores]) for name in NAMES}


def score(alarm: Bool[np.ndarray, "rows"], anomalous: Bool[np.ndarray, "rows"]) -> Score:
    """F1 = 2 TP / (2 TP + FP + FN), FAR = FP / (FP + TN), MAR = FN / (FN + TP)."""
    tp, fp = int(np.sum(alarm & anomalous)), int(np.sum(alarm & ~anomalous))
    fn, tn = int(np.sum(~alarm & anomalous)), int(np.sum(~alarm & ~anomalous))

    def share(part: int, whole: int) -> float:
        return part / whole if whole else np.nan

    return Score(
        share(2 * tp, 2 * tp + fp + fn), 100 * share(fp, fp + tn), 100 * share(fn, fn + tp)
    )


def measure(seeds: Sequence[int], progress: Callable[[str], None] = lambda text: None) -> WaterLoop:
    """Judge all experiments with every seed. Raises `InputError` where the data are absent."""
    experiments = water_loop()
    scored = {name: each.anomalous[TRAIN:] for name, each in experiments.items()}
    anomalous = np.concatenate(list(scored.values()))
    baselines = {}
    for name, alarms in BASELINES.items():
        found = [alarms(*_rows(each)) for each in experiments.values()]
        baselines[name] = score(np.concatenate(found), anomalous)
    plant = plant_named("skab")
    trials = [_trial(plant, experiments, anomalous, seed, progress) for seed in seeds]
    return WaterLoop(trials, baselines, len(anomalous))


def judge(plant: GrayBoxPlant, run: Run, seed: int) -> Statuses:
    """Fit and calibrate on the first 400 rows of `run`, judge the rest."""
    first, rest = cut(run, slice(0, TRAIN)), cut(run, slice(TRAIN, len(run.t)))
    begun = time.perf_counter()
    try:
        model, _ = fit(plant, [first], seed=seed)
        model = calibrate(model, [first]).model
        learned = time.perf_counter()
        (decision,), _ = decide_runs(model, [rest])
    except InputError as refusal:
        spent = time.perf_counter() - begun
        return Statuses([NOT_JUDGED] * len(rest.t), str(refusal), spent, 0.0)
    return Statuses(decision.status, "", learned - begun, time.perf_counter() - learned)


def _trial(
    plant: GrayBoxPlant,
    experiments: dict[str, Experiment],
    anomalous: Bool[np.ndarray, "rows"],
    seed: int,
    progress: Callable[[str], None],
) -> Trial:
    found = {}
    for name, each in experiments.items():
        progress(f"SKAB, seed {seed}: {name}")
        found[name] = judge(plant, each.run, seed)
    status = np.concatenate([each.status for each in found.values()])
    alarm, judged = status == FAULT, status != NOT_JUDGED
    return Trial(
        seed,
        score(alarm, anomalous),
        score(alarm[judged], anomalous[judged]),
        float(np.mean(~judged)),
        {name: each.refused for name, each in found.items() if each.refused},
        sum(each.learning_s for each in found.values()),
        sum(each.judging_s for each in found.values()),
    )


def _rows(each: Experiment) -> tuple[np.ndarray, np.ndarray]:
    """All sensors of the first 400 rows, and of the rest."""
    values = np.stack([each.run.columns[name] for name in SENSORS], axis=1)
    return values[:TRAIN], values[TRAIN:]


def _cells(each: Score) -> tuple[str, str, str]:
    return f"{each.f1:.3f}", f"{each.far_percent:.1f}", f"{each.mar_percent:.1f}"
