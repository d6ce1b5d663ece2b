"""One benchmark from its records to its scores: every seed fitted, timed and simulated."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from faultgauge.identification.fit import fit
from faultgauge.identification.validation.evaluation import Prediction, predict
from faultgauge.plants.model import Model
from faultgauge.progress import Step, within
from faultgauge_studies.published.benchmark import Benchmark, Records, plant_of, records
from faultgauge_studies.published.peers import jax_sysid
from faultgauge_studies.published.spread import spread

__all__ = ["Found", "Trial", "as_dict", "error_of", "mean_of", "measure"]

FITTED = 0.95  # of the work of a seed


@dataclass(frozen=True)
class Trial:
    """One seed: the model, how long its fit took [s], its errors and free runs by split.

    The prediction is the mean over the model's ensemble; `alone` is the error of its best member.
    """

    seed: int
    model: Model
    fit_s: float
    rmse: dict[str, float]
    alone: dict[str, float]
    predictions: dict[str, list[Prediction]]
    warnings: list[str]


@dataclass(frozen=True)
class Found:
    """Everything that one run of a benchmark found."""

    benchmark: Benchmark
    records: Records
    trials: list[Trial]
    peers: dict[str, Any]


def measure(
    chosen: Benchmark,
    seeds: Sequence[int],
    progress: Callable[[str], None] = lambda text: None,
) -> Found:
    """Fit and score `chosen` with every seed, one after another, then the peer in the same run.

    Raises `InputError` where the data are absent.
    """
    held = records(chosen)
    trials = []
    for seed in seeds:
        begin = f"{chosen.title}, seed {seed}"

        def told(text: str, begin: str = begin) -> None:
            progress(Step(f"{begin}: {text}", text.share if isinstance(text, Step) else 0.0))

        first, last = len(trials) / len(seeds), (len(trials) + 1) / len(seeds)
        trials.append(_trial(chosen, held, seed, within(told, first, last)))
    return Found(chosen, held, trials, {"jax_sysid": jax_sysid(chosen, held, seeds, progress)})


def _trial(chosen: Benchmark, held: Records, seed: int, progress: Callable[[str], None]) -> Trial:
    plant = plant_of(chosen)
    begun = time.perf_counter()
    model, account = fit(
        plant,
        held.train,
        seed=seed,
        refine=True,
        ensemble=True,
        progress=within(progress, 0.0, FITTED),
    )
    fit_s = time.perf_counter() - begun
    rmse, alone, predictions = {}, {}, {}
    for split in held.splits:
        progress(Step(f"simulating {split.name}", FITTED))
        members = [
            predict(member, [split.test], model.max_step, split.window)
            for member in (model.plant, *model.members)
        ]
        alone[split.name] = error_of(chosen, members[0])
        predictions[split.name] = mean_of(members)
        rmse[split.name] = error_of(chosen, predictions[split.name])
    return Trial(seed, model, fit_s, rmse, alone, predictions, list(account.warnings))


def mean_of(members: Sequence[Sequence[Prediction]]) -> list[Prediction]:
    """The members' free runs of the same stretches, averaged sample by sample."""
    return [
        same[0]._replace(
            predicted=np.mean([each.predicted for each in same], axis=0),
            x=np.mean([each.x for each in same], axis=0),
        )
        for same in zip(*members, strict=True)
    ]


def error_of(chosen: Benchmark, predictions: Sequence[Prediction]) -> float:
    """RMSE over what was sampled, in the benchmark's unit; infinite where a free run diverges."""
    parts = []
    for each in predictions:
        measured = each.measured[each.warmup :]
        parts.append((measured - each.predicted[each.warmup :])[np.isfinite(measured)])
    with np.errstate(over="ignore", invalid="ignore"):
        error = chosen.scale * float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
    return error if np.isfinite(error) else np.inf


def as_dict(found: Found) -> dict[str, Any]:
    """What `--json` prints: errors in the benchmark's unit, None where a free run diverges."""
    splits = {}
    for split in found.records.splits:
        best = split.published
        splits[split.name] = {
            "rmse": spread([trial.rmse[split.name] for trial in found.trials]),
            "best_member": spread([trial.alone[split.name] for trial in found.trials]),
            "published_best": None if best is None else best.rmse,
            "published_by": None if best is None else best.by,
        }
    return {
        "benchmark": found.benchmark.name,
        "unit": found.benchmark.unit,
        "splits": splits,
        "fit_s": spread([trial.fit_s for trial in found.trials]),
        "peers": found.peers,
    }
