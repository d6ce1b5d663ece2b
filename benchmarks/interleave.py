"""Timing competitors side by side: on a shared machine only ratios from one run mean anything."""

import time
from collections.abc import Callable, Mapping

__all__ = ["Absent", "Times", "interleaved"]

Times = dict[str, list[float]]


class Absent(str):
    """In place of a competitor: why it is not there."""


def interleaved(
    competitors: Mapping[str, Callable[[], int] | Absent], rounds: int
) -> tuple[Times, dict[str, str]]:
    """(seconds per unit of work in every round, by name; who is absent, and why). Each competitor
    does some work and says how many units.

    Round robin, so that whatever else the machine does hits all of them; one round before the
    first is not counted (compilation, caches).
    """
    absent = {name: str(each) for name, each in competitors.items() if isinstance(each, Absent)}
    there = {n: each for n, each in competitors.items() if not isinstance(each, Absent)}
    seen: Times = {name: [] for name in there}
    for round_ in range(rounds + 1):
        for name, work in there.items():
            start = time.perf_counter()
            units = work()
            elapsed = time.perf_counter() - start
            if round_:
                seen[name].append(elapsed / units)
    return seen, absent
