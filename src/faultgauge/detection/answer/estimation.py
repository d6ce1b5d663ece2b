"""`estimate --observer NAME`: what an observer alone says of every fault, and how far that holds.

It decides nothing: which fault it is, whether there is one and since when is the posterior's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.posterior.verdicts import NOT_JUDGED
from faultgauge.detection.rows.along import Along, placed
from faultgauge.detection.rows.flat_line import standing_still
from faultgauge.detection.rows.intake import Intake, slow_outputs, with_taken
from faultgauge.detection.rows.judged import Bank, build_bank
from faultgauge.detection.rows.prepared import prepared
from faultgauge.detection.rows.residual import Reference, Residuals
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.runs import paced
from faultgauge.telemetry.writing import stamps

__all__ = ["ALONE", "Estimated", "Observing", "estimate", "intervals_in", "table"]

ALONE = "an observer alone gives an estimate, no decision"


@dataclass(frozen=True)
class Estimated:
    """One run, one row per sample: an estimate of every fault, NaN where there is none, and half
    the width of its 95 % interval where one was calibrated; `settled` outside of a hold-off."""

    run: Run
    residuals: dict[str, Float[np.ndarray, "samples"]]
    f: dict[str, Float[np.ndarray, "samples"]]
    half_width: dict[str, float]
    settled: Bool[np.ndarray, "samples"]
    reason: list[str]


def estimate(
    model: Model,
    runs: Sequence[Run],
    *,
    observer: str = "eso",
    reference: Reference = "free",
) -> tuple[list[Estimated], Bank]:
    """Estimates of every declared fault along `runs`, each by an observer of its own.

    `reference` chooses the healthy reference of the residual columns. Raises `InputError`
    where no declared fault can be estimated from the columns at hand.
    """
    runs = [paced(run) for run in runs]
    bank = build_bank(model, runs, observer)
    return [Observing(bank, run, reference).push(run) for run in runs], bank


def intervals_in(model: Model) -> dict[str, float]:
    """Half the 95 % interval of each fault, as `calibrate --observer` found it; else empty."""
    known = model.calibration
    channels = known.channels if known is not None and known.channels is not None else {}
    return {name: float(each.interval) for name, each in channels.items()}


class Observing:
    """The observers of a bank along one run or stream, and beside them a healthy reference."""

    def __init__(self, bank: Bank, run: Run, reference: Reference) -> None:
        self.bank, model = bank, bank.model
        self.intake = Intake.of(model, run.step, slow_outputs(model, [run]), sized=False)
        self.state = self.intake.init(run.step, run.resampled is not None)
        self.observers = Along(bank)
        self.residuals = Residuals(model, run, reference)

    def push(self, rows: Run) -> Estimated:
        """What is estimated at the next `rows`, however many."""
        model, signals = self.bank.model, self.bank.model.plant.signals
        given = prepared(signals, rows)
        self.state, taken = self.intake.along(self.state, given)
        said = self.observers.push(with_taken(model, given, taken, outputs=True))
        infos = said.joined()
        nothing = np.full(len(rows.t), np.nan)
        f = dict.fromkeys(signals.fault_names, nothing)
        for k, name in enumerate(self.bank.designs):
            f[name] = placed(said, infos[k].f) if infos is not None else nothing
        settled = said.answered & self.bank.has_settled(said.since)
        reason = [
            standing_still(signals.output_names[still - 1])
            if still
            else "not sampled"
            if not answered
            else ALONE
            if ready
            else "settling after a start or a gap"
            for still, answered, ready in zip(taken.standing, said.answered, settled, strict=True)
        ]
        r = self.residuals.push(with_taken(model, given, taken, outputs=False))
        return Estimated(rows, r, f, intervals_in(model), settled, reason)


def table(estimated: Sequence[Estimated], faults: Sequence[str]) -> dict[str, list[Any]]:
    """The columns that `estimate` writes, in order; None is an empty cell."""
    columns: dict[str, list[Any]] = {"run": [], "t": []}
    clocked = any(each.run.clock for each in estimated)
    outputs = list(dict.fromkeys(name for each in estimated for name in each.residuals))
    for each in estimated:
        count = len(each.run.t)
        nothing = np.full(count, np.nan)
        rows: dict[str, Any] = {"run": [each.run.name] * count, "t": each.run.t}
        if clocked:
            rows["time"] = stamps(each.run)
        for name in outputs:
            rows[f"r_{name}"] = each.residuals.get(name, nothing)
        for name in faults:
            width = each.half_width.get(name, np.nan)
            rows |= {
                f"f_{name}": each.f[name],
                f"f_{name}_lo": each.f[name] - width,
                f"f_{name}_hi": each.f[name] + width,
                f"p_{name}": nothing,
            }
        rows |= {"p_healthy": nothing, "p_unknown": nothing}
        rows |= {"status": [NOT_JUDGED] * count, "reason": each.reason}
        for name, values in rows.items():
            cells = values
            if isinstance(values, np.ndarray):
                cells = [None if value != value else value for value in values.tolist()]
            columns.setdefault(name, []).extend(cells)
    return columns
