"""Logs in which one declared fault follows another: each acts for a while, and then none does.

A log has room for four faults at most; each acts for half of its room, and ends before the next
begins. The unit is the window of one fault, and the pauses between them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.events import BankEvent
from mismatch.case import Case, Injected
from mismatch.scoring import wilson

__all__ = ["Window", "drawn_windows", "scored_windows", "window_figures"]

MOST = 4  # faults of a log
FIRST = 0.12  # of the log before any of them
LATER = 0.2  # of a fault's room, at most, before it
LATE = 0.05  # of the log: an event that is told so long after its fault is over is of that


@dataclass(frozen=True)
class Window:
    """One fault of a log under its right name. `exact`: its events, and no others, are told of its
    time; `named`: one of them is; `sized` and `dated` are None where it is not. `open`: the share
    of its rows that are under alarm."""

    run: str
    fault: str
    injected: Injected
    exact: bool
    named: bool
    sized: bool | None
    dated: bool | None
    open: float


def drawn_windows(case: Case, seed: int, samples: int, step: float) -> dict[str, Injected]:
    """The faults of log `seed`, in the order of time."""
    rng = np.random.default_rng([seed, MOST])
    declared = case.plant.signals.fault_names
    known = [name for name in case.sizes if _right_name(case, name)[0] in declared]
    order = [known[k] for k in rng.permutation(len(known))][:MOST]
    room, found = (1 - FIRST) / len(order), dict[str, Injected]()
    for k, name in enumerate(order):
        sizes = case.sizes[name]
        size = float(rng.uniform(sizes.low, sizes.high)) * float(rng.choice(sizes.signs))
        onset = int((FIRST + room * (k + LATER * rng.uniform())) * samples)
        end = onset + int(room / 2 * samples)
        found[name] = Injected(size, onset * step, end * step)
    return found


def scored_windows(
    case: Case, decision: Decision, injected: Mapping[str, Injected]
) -> tuple[list[Window], int]:
    """(the windows of a judged log, how many events are of none of them)."""
    windows, of_some = list[Window](), set[int]()
    for name, each in injected.items():
        of_it = [k for k, event in enumerate(decision.events) if _meets(decision, event, each)]
        of_some.update(of_it)
        told, times = _right_name(case, name)
        right = Injected(each.size * times, each.onset, each.end)
        windows.append(_scored(decision, [decision.events[k] for k in of_it], told, right))
    return windows, len(decision.events) - len(of_some)


def _right_name(case: Case, name: str) -> tuple[str, float]:
    return case.told_as.get(name, (name, 1.0))


def _meets(decision: Decision, event: BankEvent, fault: Injected) -> bool:
    late = LATE * float(decision.run.t[-1] - decision.run.t[0])
    begins = min(event.start, event.onset_lo)
    return event.end >= fault.onset and begins <= fault.end and event.start <= fault.end + late


def _scored(
    decision: Decision, events: Sequence[BankEvent], name: str, injected: Injected
) -> Window:
    right = [event for event in events if event.fault == name]
    t = decision.run.t
    inside = (t >= injected.onset) & (t <= injected.end)
    alarm = float(np.mean(np.array(decision.status)[inside] == "FAULT"))
    sized = dated = None
    if right:
        last = max(right, key=lambda event: event.end)
        if last.lo is not None and last.hi is not None:
            sized = last.lo <= injected.size <= last.hi
        dated = any(event.onset_lo <= injected.onset <= event.onset_hi for event in right)
    exact = bool(right) and len(right) == len(events)
    return Window(decision.run.name, name, injected, exact, bool(right), sized, dated, alarm)


def window_figures(windows: Sequence[Window], false: int, logs: int) -> dict[str, Any]:
    """As plain JSON: shares of windows, and of those whose fault is named; `false` events in all
    of the `logs`."""
    return {
        "exact": wilson([each.exact for each in windows]),
        "named": wilson([each.named for each in windows]),
        "alarmed": wilson([each.open > 0 for each in windows]),
        "sized": wilson([each.sized for each in windows if each.sized is not None]),
        "dated": wilson([each.dated for each in windows if each.dated is not None]),
        "false": false,
        "logs": logs,
    }
