"""Logs in which one fault jumps from size to size, without a pause, as the load of a drive does.

The unit is a step. All steps of a log have one sign, and each differs from the one before by two
fifths of the larger at least.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from faultgauge.detection.decisions import Decision
from mismatch.case import Case, Injected
from mismatch.scoring import wilson

__all__ = ["Step", "drawn_stairs", "scored_stairs", "stair_figures"]

STEPS, FIRST, LASTS = 4, 0.12, 0.2  # steps of a log; of the log: before them, and each of them
APART = 0.4  # of the larger of two sizes: what they differ by, at least
CLOSE = 0.25  # of a step's size: what is told of it is no further off


@dataclass(frozen=True)
class Step:
    """One size of a fault under its right name. `told`: an event of that name holds in its middle;
    `sized`: with its size inside; `close`: with a size near it; `dated`: one that is close has the
    onset inside (None where none is)."""

    run: str
    fault: str
    injected: Injected
    told: bool
    sized: bool
    close: bool
    dated: bool | None


def drawn_stairs(
    case: Case, seed: int, samples: int, step: float
) -> tuple[str, tuple[Injected, ...]]:
    """(the fault of log `seed`, its sizes in the order of time)."""
    rng = np.random.default_rng([seed, STEPS])
    declared = case.plant.signals.fault_names
    known = [name for name in case.sizes if case.told_as.get(name, (name,))[0] in declared]
    name = known[seed % len(known)]
    sizes, found = case.sizes[name], list[float]()
    sign, most = float(rng.choice(sizes.signs)), min(2 * sizes.high, sizes.most)
    while len(found) < STEPS:
        size = float(rng.uniform(sizes.low, most))
        if not found or abs(size - found[-1]) >= APART * max(size, found[-1]):
            found.append(size)
    at = [step * int((FIRST + LASTS * k) * samples) for k in range(STEPS + 1)]
    return name, tuple(
        Injected(sign * size, *each) for size, each in zip(found, pairwise(at), strict=True)
    )


def scored_stairs(
    case: Case, decision: Decision, name: str, injected: Sequence[Injected]
) -> tuple[list[Step], int]:
    """(the steps of a judged log, how many of its events have another name)."""
    told, times = case.told_as.get(name, (name, 1.0))
    right = [event for event in decision.events if event.fault == told]
    steps = []
    for each in injected:
        size, middle = each.size * times, (each.onset + each.end) / 2
        own = [event for event in right if event.start <= middle <= event.end]
        sized = any(e.lo <= size <= e.hi for e in own if e.lo is not None and e.hi is not None)
        close = [e for e in own if e.size is not None and abs(e.size - size) <= CLOSE * abs(size)]
        dated = any(e.onset_lo <= each.onset <= e.onset_hi for e in close) if close else None
        steps.append(Step(decision.run.name, name, each, bool(own), sized, bool(close), dated))
    return steps, len(decision.events) - len(right)


def stair_figures(steps: Sequence[Step], false: int, logs: int) -> dict[str, Any]:
    """As plain JSON: shares of steps; `false` events of other names in all of the `logs`."""
    return {
        "told": wilson([each.told for each in steps]),
        "sized": wilson([each.sized for each in steps]),
        "close": wilson([each.close for each in steps]),
        "dated": wilson([each.dated for each in steps if each.dated is not None]),
        "false": false,
        "logs": logs,
    }
