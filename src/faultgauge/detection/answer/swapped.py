"""Logs in which two columns of one unit look exchanged, though each stays in its range.

Two thermometers of one plant measure alike values, so that no range tells which is which. The
healthy model does: with the two columns exchanged its free run follows the log about as well as it
followed data that it was not fitted to, and as they are several times worse. A fault would have to
imitate the other sensor all along to look like that.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from faultgauge.detection.answer.pieces import typical_errors
from faultgauge.detection.decisions import Decision
from faultgauge.detection.posterior.verdicts import HEALTHY
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run

__all__ = ["swapped", "swapped_in"]

CLEARLY = 3.0  # times that the free run errs more as columns are than exchanged
AS_USUAL = 2.0  # times the free run's error on validation data, up to which it follows
WELL = 0.5  # of the rows of a log that are healthy, from which on it is not looked at
MOST_PAIRS = 20  # that are tried: one free run each


def swapped(model: Model, runs: Sequence[Run]) -> list[str]:
    """A sentence for each of `runs` that the healthy model follows with two columns of one unit
    exchanged, and not as they are."""
    usual = model.record.metrics.validation_free_run_nrmse
    if usual is None or not usual > 0:
        return []
    found = []
    for run in runs:
        pairs = _pairs(model, run)
        as_it_is = _off(model, run) if pairs else 0.0
        if as_it_is <= CLEARLY * usual:
            continue
        errors = {pair: _off(model, _exchanged(run, *pair)) for pair in pairs}
        best = min(errors, key=lambda pair: errors[pair])
        if errors[best] <= AS_USUAL * usual and CLEARLY * errors[best] < as_it_is:
            off = f"is {100 * as_it_is:.0f} % off" if np.isfinite(as_it_is) else "runs away"
            found.append(
                f"run {run.name}: the columns {' and '.join(best)} look swapped: as they are, the "
                f"healthy model's free run {off}, with the two exchanged {100 * errors[best]:.0f} "
                f"%; if they are, give --map {best[0]}={best[1]} --map {best[1]}={best[0]}"
            )
    return found


def swapped_in(model: Model, decisions: Sequence[Decision]) -> list[str]:
    """The same of those that were judged healthy in less than half of their rows: exchanged
    columns hardly look healthy, and nobody waits for a free run along sound logs."""
    odd = [one.run for one in decisions if one.status.count(HEALTHY) < WELL * len(one.status)]
    return swapped(model, odd)


def _pairs(model: Model, run: Run) -> list[tuple[str, str]]:
    signals = model.plant.signals
    units = {each.name: each.unit for each in (*signals.outputs, *signals.inputs)}
    there = [name for name in units if name in run.columns]
    return [(a, b) for a, b in combinations(there, 2) if units[a] == units[b]][:MOST_PAIRS]


def _exchanged(run: Run, first: str, second: str) -> Run:
    columns = run.columns | {first: run.columns[second], second: run.columns[first]}
    return replace(run, columns=columns)


def _off(model: Model, run: Run) -> float:
    """The free run's error as a share of each output's spread, over all outputs."""
    errors = list(typical_errors(model, run).values())
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else 0.0
