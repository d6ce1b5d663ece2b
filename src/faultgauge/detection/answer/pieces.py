"""The error of the healthy model's free run over a log, begun anew at every piece of it.

Pieces are as long as what a fit holds out of a run: through all of a log the model of a plant that
integrates is carried off by errors of no account.
"""

import itertools
from dataclasses import replace

import numpy as np

from faultgauge.detection.bank.fidelity import LONGEST_PIECE
from faultgauge.errors import InputError
from faultgauge.identification.holdout import LAST_SHARE
from faultgauge.identification.validation.evaluation import WARMUP, evaluate
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run, cut

__all__ = ["typical_errors"]

SHORTEST = 2 * WARMUP  # samples of a piece


def typical_errors(model: Model, run: Run) -> dict[str, float]:
    """By output that moves, the median error of the pieces as a share of its standard deviation in
    the log; nothing where no two samples are in a row."""
    run = cut(run, slice(0, LONGEST_PIECE))
    try:
        scored, _ = evaluate(
            model.plant, _pieces(run), model.max_step, between=model.record.between
        )
    except InputError:
        return {}
    found = {}
    for name in model.plant.signals.output_names:
        parts = [e["outputs"][name]["rmse"] for e in scored["runs"] if name in e["outputs"]]
        spread = float(np.nanstd(run.columns[name])) if parts else 0.0
        if spread > 0:
            blown_up = np.inf
            typical = np.median([blown_up if each is None else each for each in parts])
            found[name] = float(typical) / spread
    return found


def _pieces(run: Run) -> list[Run]:
    """`run` in parts as long as what a fit holds out of one, and long enough to be scored."""
    count = max(1, min(round(1 / LAST_SHARE), len(run.t) // SHORTEST))
    edges = np.linspace(0, len(run.t), count + 1).astype(int)
    return [
        replace(cut(run, slice(a, b)), name=f"{run.name}, part {k}")
        for k, (a, b) in enumerate(itertools.pairwise(edges.tolist()), 1)
    ]
