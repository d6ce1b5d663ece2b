"""Timing competitors side by side: on a shared machine only ratios from one run mean anything."""

import statistics
import time
from collections.abc import Callable

__all__ = ["medians"]


def medians(competitors: dict[str, Callable[[], int]], rounds: int) -> dict[str, float]:
    """Median seconds per unit of work. Each competitor does some work and says how many units.

    Round robin, so that whatever else the machine does hits all of them; one round before the
    first is not counted (compilation, caches).
    """
    seen: dict[str, list[float]] = {name: [] for name in competitors}
    for round_ in range(rounds + 1):
        for name, work in competitors.items():
            start = time.perf_counter()
            units = work()
            elapsed = time.perf_counter() - start
            if round_:
                seen[name].append(elapsed / units)
    return {name: statistics.median(times) for name, times in seen.items()}
