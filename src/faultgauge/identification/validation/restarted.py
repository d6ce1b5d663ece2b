"""Free runs that start anew: the error of a prediction over a horizon.

Where a plant integrates or is unstable, the small errors of a free run add up, and its error over a
whole log says little about the model. The same model started anew every half, quarter, ... of the
log says how far ahead it can be trusted: the longest such horizon over which the outputs are
followed, or the shortest there is.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from faultgauge.errors import InputError
from faultgauge.identification.validation.evaluation import POOR_FREE_RUN, evaluate
from faultgauge.plants.plant import Plant
from faultgauge.plants.record import BetweenRuns
from faultgauge.telemetry import Run, cut

__all__ = ["SHORTEST_PIECE", "Restarted", "pieces", "restarted"]

SHORTEST_PIECE = 200  # samples: a few times what finds its start


class Restarted(NamedTuple):
    """Scores `{OUTPUT: {r2, rmse, nrmse}}` of free runs that start anew every `horizon` (s)."""

    horizon: float
    outputs: dict[str, dict[str, float | None]]


def pieces(run: Run, parts: int, longest: int | None = None) -> list[Run]:
    """So many equal `parts` of `run`, or of its first `longest` samples."""
    edges = np.linspace(0, min(len(run.t), longest or len(run.t)), parts + 1).astype(int)
    return [cut(run, slice(a, b)) for a, b in pairwise(edges.tolist())]


def restarted(
    plant: Plant,
    run: Run,
    outputs: Sequence[str],
    max_step: float,
    warmup: int,
    between: BetweenRuns | None,
) -> Restarted | None:
    """Over the longest horizon over which `outputs` are followed, or the shortest there is; None
    where `run` is too short to start anew."""
    found, parts = None, 2
    while len(run.t) >= parts * SHORTEST_PIECE:
        named = [replace(piece, name=str(k)) for k, piece in enumerate(pieces(run, parts))]
        try:
            scores = evaluate(plant, named, max_step, warmup, between)[0]["outputs"]
        except InputError:  # no piece has enough samples without a gap
            break
        own = {name: scores[name] for name in outputs if name in scores}
        found = Restarted(float(run.t[-1] - run.t[0]) / parts, own)
        if all(_follows(each) for each in own.values()):
            break
        parts *= 2
    return found


def _follows(scores: dict[str, float | None]) -> bool:
    return scores["nrmse"] is not None and scores["nrmse"] < POOR_FREE_RUN
