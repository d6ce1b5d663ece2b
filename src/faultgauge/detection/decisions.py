"""`estimate`: one posterior per run, its events, and the columns of the table."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import timedelta
from typing import Any

import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank import FaultBank, build_fault_bank, evaluated_faults
from faultgauge.detection.course import Rows, run_over
from faultgauge.detection.events import BankEvent, Judged, events
from faultgauge.detection.flat_line import FlatLine
from faultgauge.detection.noise import noise_of
from faultgauge.detection.posterior import Posterior, posterior_of, untrusted
from faultgauge.detection.probability import probability
from faultgauge.detection.residual import Reference, residuals
from faultgauge.detection.uncalibrated import prior_of, uncalibrated
from faultgauge.detection.verdicts import NOT_JUDGED, Verdicts
from faultgauge.identification.samples import in_effect
from faultgauge.plants.model import Model
from faultgauge.telemetry import Run
from faultgauge.telemetry.runs import paced

__all__ = [
    "Decision",
    "as_dicts",
    "decide",
    "decide_runs",
    "sentence",
    "table",
    "unjudged",
]


@dataclass(frozen=True)
class Decision:
    """One run judged by the bank."""

    run: Run
    posterior: Posterior
    residuals: dict[str, Float[np.ndarray, "samples"]]
    status: list[str]
    reason: list[str]
    events: list[BankEvent]


def decide_runs(
    model: Model, runs: Sequence[Run], reference: Reference = "free"
) -> tuple[list[Decision], FaultBank | None]:
    """Judge `runs`; there is no bank, and every row is NOT_JUDGED, where `model` was not calibrated
    for it. Raises `InputError` where no fault is declared that is not disabled."""
    runs = [paced(run) for run in runs]
    if uncalibrated(model):
        evaluated_faults(model.plant.signals)
        return [unjudged(model, run, residuals(model, run, reference)) for run in runs], None
    bank = build_fault_bank(model, runs, noise_of(model))
    return [decide(bank, run, reference) for run in runs], bank


def unjudged(model: Model, run: Run, r: dict[str, Float[np.ndarray, "samples"]]) -> Decision:
    """`run` where nothing was calibrated for the bank: its residuals `r` alone."""
    count = len(run.t)
    why = [uncalibrated(model)] * count
    return Decision(run, prior_of(model, run), r, [NOT_JUDGED] * count, why, [])


def decide(bank: FaultBank, run: Run, reference: Reference = "free") -> Decision:
    """Judge one run."""
    p = np.full(
        (len(run.t), len(bank.sets) + 1), np.nan, np.float32
    )  # halves what a long log takes

    used, standing = FlatLine(bank.model, sized=True).used(run)

    def noted() -> Iterator[Rows]:
        for rows in run_over(bank, used):
            p[rows.part] = rows.p
            yield rows

    found = posterior_of(bank, run, noted())
    verdict = Verdicts(bank).judge(used, found, standing)
    found = untrusted(bank, found, verdict.status)
    r = residuals(bank.model, run, reference)
    acting = in_effect(bank.model.plant.signals, used)
    said = events(bank, Judged(acting, found, verdict, p))
    return Decision(run, found, r, verdict.status, verdict.reason, said)


def table(decisions: Sequence[Decision], faults: Sequence[str]) -> dict[str, list[Any]]:
    """The columns that `estimate` writes, in order; None is an empty cell."""
    outputs = list(dict.fromkeys(name for each in decisions for name in each.residuals))
    clocked = any(each.run.clock for each in decisions)
    columns: dict[str, list[Any]] = {}
    for each in decisions:
        for name, values in _rows(each, faults, outputs, clocked).items():
            cells = values
            if isinstance(values, np.ndarray):
                cells = [None if value != value else value for value in values.tolist()]
            columns.setdefault(name, []).extend(cells)
    return columns


def _rows(
    decision: Decision, faults: Sequence[str], outputs: Sequence[str], clocked: bool
) -> dict[str, Any]:
    """One run's part of the table; with the log's own time where any run is `clocked`."""
    count, found, clock = len(decision.run.t), decision.posterior, decision.run.clock
    rows: dict[str, Any] = {"run": [decision.run.name] * count, "t": decision.run.t}
    if clocked:
        rows["time"] = [
            clock and (clock + timedelta(seconds=t)).isoformat() for t in decision.run.t.tolist()
        ]
    for name in outputs:
        rows[f"r_{name}"] = decision.residuals.get(name, np.full(count, np.nan))
    for k, name in enumerate(faults):
        rows |= {
            f"f_{name}": found.f[:, k],
            f"f_{name}_lo": found.lo[:, k],
            f"f_{name}_hi": found.hi[:, k],
            f"p_{name}": found.p[:, k],
        }
    rows |= {"p_healthy": found.healthy, "p_unknown": found.unknown}
    return rows | {"status": decision.status, "reason": decision.reason}


def sentence(event: BankEvent, unit: str) -> str:
    """ "leak +0.002 +- 1.7e-05 m/s from 4006 s, told at 4026 s, to 7198 s (p > 0.999, run a)" """
    when = f"from {event.onset:.6g} s, told at {event.start:.6g} s, to {event.end:.6g} s"
    if event.size is None or event.lo is None or event.hi is None:
        return f"a fault that is not declared {when} (run {event.run})"
    width = (event.hi - event.lo) / 2
    amount = f"{event.size:+.4g} +- {width:.2g} {unit}".rstrip()
    how = "passive, " if event.passive else ""
    return f"{event.fault} {amount} {when} ({how}p {probability(event.p)}, run {event.run})"


def as_dicts(events: Sequence[BankEvent]) -> list[dict[str, Any]]:
    """Events as plain JSON."""
    return [
        {
            **asdict(event),
            "alternatives": [{"faults": f, "odds": o} for f, o in event.alternatives],
            "instead": dict(event.instead),
            "beside": dict(event.beside),
        }
        for event in events
    ]
