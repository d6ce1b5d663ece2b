"""Which run has what: every point of the grid, or drawn at random, from the campaign's seed."""

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple, TypeAlias

import numpy as np

from faultgauge.campaigns.schema import Kind, Plan

__all__ = ["RunPlan", "healthy_seeds", "run_plans"]

RUNS, HEALTHY, DRAWN, JUDGE = range(4)  # streams of numbers: what one takes moves no other
LARGEST = 2**31  # below it: seeds of runs

# kinds, sizes, onsets, noise
Case: TypeAlias = tuple[tuple[Kind, ...], tuple[float, ...], tuple[float, ...], float]


class RunPlan(NamedTuple):
    """A run: its faults with their sizes and onsets [s], the factor of the noise, and the seed of
    all that is random in it."""

    number: int
    kinds: tuple[Kind, ...]
    sizes: tuple[float, ...]
    onsets: tuple[float, ...]
    noise: float
    seed: int


def run_plans(plan: Plan) -> list[RunPlan]:
    """All runs, those without a fault first. No two share a seed, so that they are independent."""
    cases = [*_healthy(plan), *(_drawn(plan) if plan.random else _grid(plan))]
    return [RunPlan(k, *case, _seed(plan, k)) for k, case in enumerate(cases)]


def healthy_seeds(plan: Plan, count: int) -> list[int]:
    """Of runs to fit and to calibrate on."""
    rng = np.random.default_rng([plan.seed, JUDGE])
    return [int(each) for each in rng.integers(LARGEST, size=count)]


def _seed(plan: Plan, number: int) -> int:
    return int(np.random.default_rng([plan.seed, RUNS, number]).integers(LARGEST))


def _healthy(plan: Plan) -> Iterator[Case]:
    for number in range(plan.healthy):
        rng = np.random.default_rng([plan.seed, HEALTHY, number])
        values = plan.noise.values
        noise = plan.noise.draw(rng) if plan.random else values[number % len(values)]
        yield (), (), (), noise


def _grid(plan: Plan) -> Iterator[Case]:
    """Faults of a pair begin together."""
    for kinds in plan.kinds:
        sizes = product(*((0.0,) if k.size is None else k.size.values for k in kinds))
        axes = sizes, plan.onset.values, plan.noise.values, range(plan.seeds)
        for size, onset, noise, _ in product(*axes):
            yield kinds, size, (onset,) * len(kinds), noise


def _drawn(plan: Plan) -> Iterator[Case]:
    """Kinds in turn; every fault of a pair has an onset of its own."""
    for number in range(plan.runs):
        rng = np.random.default_rng([plan.seed, DRAWN, number])
        kinds = plan.kinds[number % len(plan.kinds)]
        sizes = tuple(0.0 if each.size is None else each.size.draw(rng) for each in kinds)
        onsets = tuple(plan.onset.draw(rng) for _ in kinds)
        yield kinds, sizes, onsets, plan.noise.draw(rng)
