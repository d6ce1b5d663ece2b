"""Stretches where a sensor is stuck: one value, exactly, while it should have moved."""

from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from faultgauge.telemetry.runs import Run

__all__ = ["stuck_stretches"]

LONGER = 10.0  # times the longest usual stretch on one value
FEWEST = 20  # samples of a stuck stretch, and usual stretches that it is compared with
BEFORE = 5  # steps before a stretch that tell a sudden stop from one that came to rest
SUDDEN = 0.25  # of the usual step


def stuck_stretches(run: Run, name: str) -> list[slice]:
    """Stretches of `run` in which column `name` is stuck, as samples of the run.

    Empty cells are passed over, and filled ones: a sensor that comes back on the same value was
    stuck throughout.

    The lengths of all stretches on one value must fall into two classes, ten times apart: many
    short ones, as noise, motion or coarse steps make them, and at most a few long ones. Held
    inputs have one class. A long one counts only if the column stopped there in full motion (a
    drive that comes to rest slows down first) and another column changes meanwhile.
    """
    rows = np.flatnonzero(np.isfinite(run.columns[name]) & run.sampled.get(name, True))
    values = run.columns[name][rows]
    edges = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1], [True]]))
    limit = _limit(np.diff(edges)) if rows.size else None
    if limit is None:
        return []
    moves = np.abs(np.diff(values))
    usual = float(np.median(moves[moves > 0]))
    found = [
        slice(int(rows[a]), int(rows[b - 1]) + 1)
        for a, b in pairwise(edges.tolist())
        if b - a > limit and _suddenly(moves, a, b, usual)
    ]
    return [stretch for stretch in found if _others_move(run, name, stretch)]


def _limit(lengths: Int[np.ndarray, "stretches"]) -> int | None:
    """The length that parts usual stretches from stuck ones; None if there is but one class."""
    ordered = np.sort(lengths)
    if len(ordered) <= FEWEST:
        return None
    ratios = ordered[1:] / ordered[:-1]
    ratios[: FEWEST - 1] = 1.0  # so many stretches must be usual
    widest = int(np.argmax(ratios))
    long = ordered[widest + 1]
    few = len(ordered) - widest - 1 <= len(ordered) // FEWEST
    return int(ordered[widest]) if ratios[widest] >= LONGER and long >= FEWEST and few else None


def _suddenly(moves: Float[np.ndarray, "steps"], start: int, end: int, usual: float) -> bool:
    """Whether the column was in motion just before the stretch, or just after one at the start."""
    around = moves[max(start - BEFORE, 0) : start] if start else moves[end - 1 : end - 1 + BEFORE]
    return float(np.mean(around)) >= SUDDEN * usual


def _others_move(run: Run, name: str, stretch: slice) -> bool:
    for other, values in run.columns.items():
        part = values[stretch]
        part = part[np.isfinite(part)]
        if other != name and part.size and np.ptp(part) > 0:
            return True
    return False
