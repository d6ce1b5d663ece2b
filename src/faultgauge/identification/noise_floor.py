"""The noise of every measured column, whatever the model: what no fit can get below."""

from collections.abc import Sequence

import numpy as np

from faultgauge.plants.signals import Signals
from faultgauge.telemetry import Run
from faultgauge.telemetry.derivatives import noise_sd
from faultgauge.telemetry.stuck import stuck_stretches

__all__ = ["FEWEST", "noise_floor"]

FEWEST = 20  # samples of a run that tell its noise


def noise_floor(signals: Signals, runs: Sequence[Run]) -> dict[str, dict[str, float | str | None]]:
    """`{COLUMN: {"sd", "unit"}}` of outputs and measured states: the standard deviation of white
    noise in the column's own samples, the median over `runs`; None where all are too short."""
    units = {each.name: each.unit for each in (*signals.states, *signals.outputs)}
    found = {}
    for name in [name for name in units if any(name in run.columns for run in runs)]:
        levels = [_level(run, name, signals.input_names) for run in runs if name in run.columns]
        told = [level for level in levels if level is not None]
        found[name] = {"sd": float(np.median(told)) if told else None, "unit": units[name]}
    return found


def _level(run: Run, name: str, inputs: Sequence[str]) -> float | None:
    """By third differences, and no less than what rounding to the column's resolution makes,
    q / sqrt(12): third differences of a coarse one are mostly 0."""
    values = run.own(name)
    used = np.isfinite(values)
    for each in inputs:
        used &= np.isfinite(run.columns[each])
    for stretch in stuck_stretches(run, name):
        used[stretch] = False
    if used.sum() < FEWEST:
        return None
    x = values[used]
    resolution = float(np.min(np.diff(np.unique(x)), initial=np.ptp(x)))
    return max(noise_sd(x, [run.columns[each][used] for each in inputs]), resolution / 12**0.5)
