"""What differs between runs: how far apart their own values lie of parameters that vary, and how
far off, for how long, a free run is that has the right ones. New runs are looked for around that.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from faultgauge.identification.samples import Samples, spread
from faultgauge.identification.unknowns import prior_width
from faultgauge.plants.plant import Plant
from faultgauge.plants.record import BetweenRuns
from faultgauge.plants.spec import Parameter

__all__ = ["SUREST", "between_runs"]

SUREST = 1e-3  # of an output's spread: no free run is taken for better than that
USUAL, USUAL_RUNS = 0.1, 2.0  # of a parameter: how far runs lie apart; how many runs that is worth


def between_runs(
    plant: Plant,
    training: Samples,
    error: float,
    lasting: float,
    per_run: Mapping[str, Mapping[str, float]],
) -> BetweenRuns:
    """What a fit tells of it: `per_run` are the fitted runs' own values, `error` is that of free
    runs on held-out data as a share of the outputs' spread, `lasting` so long [s]."""
    names, off = plant.signals.output_names, max(error, SUREST) * spread(training.y)
    apart = {p.name: _apart(p, [*per_run[p.name].values()]) for p in plant.constants if p.vary}
    return BetweenRuns(
        apart=apart, off=dict(zip(names, off.tolist(), strict=True)), lasting=lasting
    )


def _apart(parameter: Parameter, values: Sequence[float]) -> float:
    """One standard deviation of what few runs tell it by: the usual one counts as two more. Where
    the file gives no scale and one run is all there is, as little is known as before the fit."""
    own = np.log(values) if parameter.positive else np.asarray(values)
    usual = USUAL * (1.0 if parameter.positive else abs(parameter.value))
    worth = USUAL_RUNS if usual else 0.0
    squares = np.sum((own - np.mean(own)) ** 2) + worth * usual**2
    return float(np.sqrt(squares / (len(own) - 1 + worth))) if squares else prior_width(parameter)
