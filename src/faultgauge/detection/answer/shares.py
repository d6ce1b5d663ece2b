"""How much of a run was judged: in all, fault by fault, and where not and why."""

import re
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.verdicts import FAULT, HEALTHY, OUTSIDE
from faultgauge.detection.words import listed, number
from faultgauge.telemetry import Run

__all__ = ["WHOLE", "Shares", "Silent", "shares_of", "with_values"]

WHOLE = 0.95  # share of a log from which on all of it counts as judged: a start is always held off


class Silent(NamedTuple):
    """Rows in a row that were not judged for one reason, `start` to `end` [s], and their share of
    the run."""

    start: float
    end: float
    share: float
    reason: str


class Shares(NamedTuple):
    """`judged` is the share of a run's rows that have a status; `faults` the share of them in which
    each declared fault would have shown, in the order of the plant file."""

    judged: float
    faults: tuple[float, ...]
    silent: tuple[Silent, ...]

    def as_dict(self, smallest: dict[str, float | None]) -> dict[str, Any]:
        """As plain JSON, beside the `smallest` size of each fault that would have been told."""
        faults = zip(smallest.items(), self.faults, strict=True)
        said: dict[str, Any] = {
            "judged_share": self.judged,
            "silent": [
                {"from": each.start, "to": each.end, "share": each.share, "reason": each.reason}
                for each in self.silent
            ],
        }
        if self.faults:
            said["faults"] = {
                name: {"judged_share": share, "smallest": size} for (name, size), share in faults
            }
        return said


def shares_of(decision: Decision) -> Shares:
    """What was judged of one run."""
    t, found = decision.run.t, decision.posterior
    judged = np.isin(decision.status, [HEALTHY, FAULT])
    told = np.nan_to_num(found.p) > 0.5
    shown = (found.seen.any(axis=2) | told) & judged[:, None]
    silent = []
    # a reason stands on healthy rows too, where one fault would not show
    reasons = np.where(judged, np.array(None), np.array(decision.reason, object))
    edges = np.flatnonzero(reasons[1:] != reasons[:-1]) + 1
    for a, b in pairwise([0, *edges.tolist(), len(t)]):
        if reasons[a] is not None:
            why = with_values(decision.run, reasons[a], slice(a, b))
            silent.append(Silent(float(t[a]), float(t[b - 1]), (b - a) / len(t), why))
    return Shares(float(judged.mean()), tuple(shown.mean(axis=0).tolist()), tuple(silent))


def with_values(run: Run, reason: str, rows: slice | list[int]) -> str:
    """`reason`; where it says that columns are outside of something in `rows`, with what they were
    there."""
    if OUTSIDE not in reason:
        return reason
    said = []
    for name, column in run.columns.items():
        values = column[rows][np.isfinite(column[rows])]
        if len(values) and re.search(rf"(?<!\w){re.escape(name)}(?!\w)", reason):
            low, high = number(values.min()), number(values.max())
            said.append(f"{name} was {low}" + f" to {high}" * (low != high))
    return f"{reason}; {listed(said)}" if said else reason
