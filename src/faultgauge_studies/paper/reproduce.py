"""The whole study over several seeds: every figure as median, smallest and largest."""

import json
import math
import multiprocessing
import os
import signal
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from faultgauge.progress import Step
from faultgauge.reporting.report import installed_versions
from faultgauge_studies.paper.claims.registry import ONCE
from faultgauge_studies.paper.experiment import Outcome, experiment

__all__ = ["QUICK_SEEDS", "SEEDS", "Reproduction", "as_json", "over_seeds", "reproduce"]

SEEDS, QUICK_SEEDS = 10, 2


class Reproduction(NamedTuple):
    """`results` as results.json holds them, the curves of the first seed, and the seeds."""

    results: dict[str, Any]
    first: Outcome
    seeds: tuple[int, ...]


def reproduce(
    seeds: Sequence[int],
    *,
    quick: bool = False,
    progress: Callable[[str], None] = lambda text: None,
) -> Reproduction:
    """Run the study for every seed, as many at a time as there are cores.

    The result depends on the seeds alone, not on how they were spread over the cores.
    """
    one = partial(experiment, quick=quick)
    workers = min(os.cpu_count() or 1, len(seeds))
    progress(Step(f"seeds done: 0 of {len(seeds)}", 0.0))
    # spawned, not forked: JAX has threads by now
    context = multiprocessing.get_context("spawn")
    outcomes: dict[int, Outcome] = {}
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_prepare) as pool:
        waiting = {pool.submit(one, seed): seed for seed in seeds}
        try:
            once = [claim.measure() for claim in (() if quick else ONCE)]
            for done in as_completed(waiting):
                outcomes[waiting[done]] = done.result()
                done_so_far = f"seeds done: {len(outcomes)} of {len(seeds)}"
                progress(Step(done_so_far, len(outcomes) / len(seeds)))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in multiprocessing.active_children():
                worker.terminate()  # a seed takes long, and nobody waits for it any more
            raise
    results = {
        "seeds": list(seeds),
        "quick": quick,
        "versions": dict(installed_versions()),
        **over_seeds([outcomes[seed].figures for seed in seeds]),
    }
    first = outcomes[seeds[0]]
    for figures, traces in once:
        results |= over_seeds([figures])
        first = first._replace(traces=first.traces | traces)
    return Reproduction(results, first, tuple(seeds))


def _prepare() -> None:
    """Workers leave interrupts to the parent. They share a cache of compiled programs; an entry
    still being written is made anew."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.filterwarnings("ignore", message="Error reading persistent compilation cache")


def over_seeds(figures: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Every number as {median, min, max}; null where it is infinite (never settled, say) or not
    defined. Whole numbers in a list are an axis, the same for every seed."""
    return {key: _over([figure[key] for figure in figures]) for key in figures[0]}


def _over(values: Sequence[Any]) -> Any:
    first = values[0]
    if isinstance(first, dict):
        return over_seeds(values)
    if isinstance(first, list):
        whole = all(isinstance(x, int) for x in first)
        return first if whole else [_range(each) for each in zip(*values, strict=True)]
    return _range(values)


def _range(values: Sequence[float]) -> dict[str, float | None]:
    figures = {"median": np.median(values), "min": np.min(values), "max": np.max(values)}
    return {name: float(x) if math.isfinite(x) else None for name, x in figures.items()}


def as_json(results: dict[str, Any]) -> str:
    return json.dumps(results, indent=1, allow_nan=False) + "\n"
