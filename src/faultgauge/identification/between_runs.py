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
USUAL = 0.1  # of a parameter: how far runs lie apart
TIMES = 10.0  # which may as well be so many times as far, or as little
REACH, POINTS = 6.0, 4001  # standard deviations to either side, and places there


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
    """The median of what n runs leave of one standard deviation s of theirs,

        p(s) ~ s^-(n-1) exp(-Q / 2 s^2) * exp(-(ln s - ln usual)^2 / 2 ln(TIMES)^2) / s,

    Q being their squared distances from their mean. Where the file gives no scale and one run is
    all there is, as little is known as before the fit."""
    own = np.log(values) if parameter.positive else np.asarray(values)
    usual = USUAL * (1.0 if parameter.positive else abs(parameter.value))
    squares, free = float(np.sum((own - np.mean(own)) ** 2)), len(own) - 1
    if not usual:
        return float(np.sqrt(squares / free)) if squares else prior_width(parameter)
    scale = np.log(TIMES)
    logs = np.log(usual) + scale * np.linspace(-free * scale - REACH, REACH, POINTS)
    weights = -free * logs - squares / 2 * np.exp(-2 * logs)
    weights -= ((logs - np.log(usual)) / scale) ** 2 / 2
    below = np.cumsum(np.exp(weights - weights.max()))
    return float(np.exp(np.interp(0.5, (below - np.diff(below, prepend=0) / 2) / below[-1], logs)))
