"""How much of a run hindsight judged, and where not and why.

It holds back nothing after a start or a gap and leaves nothing undecided, so that it judges more
than was judged online; it knows no more of rows without samples or outside of what training
covered. What lies between a fault's last row and where it was seen to be gone is in no window.
"""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from jaxtyping import Bool

from faultgauge.detection.answer.shares import Shares, Silent, with_values
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.verdicts import FAULT, STALE, is_unheard

__all__ = ["hindsight_shares", "readable"]

# reasons of rows that could be read
NOTHING_SHOWS = "no declared fault of any size to be expected would show"
ENDING = "where a fault ended"
TOO_FEW = "too few samples after a start or a gap"


def readable(decision: Decision) -> Bool[np.ndarray, "rows"]:
    """Rows that hindsight can read: with samples, and inside the training envelope or under an
    alarm that began there. Between the samples of a slow sensor as online."""
    status, reason = decision.status, decision.reason
    unheard = [s == STALE or is_unheard(r) for s, r in zip(status, reason, strict=True)]
    return (decision.posterior.inside | (np.array(status) == FAULT)) & ~np.array(unheard)


def hindsight_shares(decision: Decision, windows: Sequence[tuple[float, float, bool]]) -> Shares:
    """Of the `windows` of a run, each from its first row to its last [s], and whether anything
    would have shown in it."""
    t, rows = decision.run.t, readable(decision)
    inside, shows = np.zeros(len(t), bool), np.zeros(len(t), bool)
    for first, last, showing in windows:
        part = (t >= first) & (t <= last)
        inside |= part
        shows |= part & showing
    judged = rows & shows
    why = np.where(inside, NOTHING_SHOWS, TOO_FEW).astype(object)
    why[~rows] = np.array(decision.reason, object)[~rows]
    why[judged] = None
    ends, silent = [event.end for event in decision.events], []
    for reason, part in groupby(range(len(t)), key=lambda k: why[k]):
        if reason is not None:
            at = list(part)
            first, last = float(t[at[0]]), float(t[at[-1]])
            ending = reason == TOO_FEW and any(first <= end <= last for end in ends)
            said = ENDING if ending else with_values(decision.run, reason, at)
            silent.append(Silent(first, last, len(at) / len(t), said))
    return Shares(float(judged.mean()), (), tuple(silent))
