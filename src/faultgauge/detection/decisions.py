"""`estimate`: one posterior per run, its events, and the columns of the table."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeAlias

import jax
import numpy as np
from jaxtyping import Float

from faultgauge.detection.bank.bank import FaultBank, build_fault_bank, evaluated_faults
from faultgauge.detection.bank.noise import noise_of
from faultgauge.detection.posterior.events import BankEvent, Judged, events
from faultgauge.detection.posterior.glitches import Glitch, Glitches
from faultgauge.detection.posterior.posterior import Posterior
from faultgauge.detection.posterior.uncalibrated import prior_of, uncalibrated
from faultgauge.detection.posterior.verdicts import NOT_JUDGED
from faultgauge.detection.rows.intake import with_taken
from faultgauge.detection.rows.prepared import Prepared, as_it_acts, prepared
from faultgauge.detection.rows.residual import Reference, residuals_of
from faultgauge.detection.watch import Row, Watch, WatchState
from faultgauge.plants.model import Model
from faultgauge.progress import Step
from faultgauge.telemetry import Run
from faultgauge.telemetry.clock import Clock
from faultgauge.telemetry.dead_time import check_delays
from faultgauge.telemetry.runs import paced
from faultgauge.telemetry.writing import stamp, stamps

__all__ = [
    "Decision",
    "Walk",
    "Watching",
    "as_dicts",
    "decide",
    "decide_runs",
    "table",
    "unjudged",
]

PART = 10_000  # rows after which it is said how far a walk is
# what takes a watch along the next rows: (its state after them, what is said of them)
Walk: TypeAlias = Callable[[Watch, WatchState, Prepared], tuple[WatchState, Row]]


@dataclass(frozen=True)
class Decision:
    """One run judged by the bank, made ready: `acting` has its inputs as they act, and `used` is
    what of that was believed, outputs but for those that stand still. Each of the `glitches` may
    be of the rows before: it is known once the next sample is there. `loose` is the standard
    deviation of every constant that the bank tracks where the run ends."""

    run: Run
    posterior: Posterior
    residuals: dict[str, Float[np.ndarray, "samples"]]
    status: list[str]
    reason: list[str]
    events: list[BankEvent]
    acting: Prepared
    used: Prepared
    glitches: Sequence[Glitch] = ()
    loose: Float[np.ndarray, "constants"] | None = None


def decide_runs(
    model: Model,
    runs: Sequence[Run],
    reference: Reference = "free",
    walk: Walk = Watch.along,
    progress: Callable[[str], None] | None = None,
) -> tuple[list[Decision], FaultBank | None]:
    """Judge `runs`; there is no bank, and every row is NOT_JUDGED, where `model` was not calibrated
    for it; `walk` is who runs the step. Raises `InputError` where no fault is declared that is not
    disabled."""
    runs = [paced(run) for run in runs]
    if uncalibrated(model):
        evaluated_faults(model.plant.signals)
        acting = [as_it_acts(model.plant.signals, run) for run in runs]
        r = [residuals_of(model, each, reference) for each in acting]
        return [unjudged(model, *each) for each in zip(runs, acting, r, strict=True)], None
    bank = build_fault_bank(model, runs, noise_of(model))
    if progress is not None:
        walk = _in_parts(walk, progress, sum(len(run.t) for run in runs))
    return [decide(bank, run, reference, walk) for run in runs], bank


def _in_parts(walk: Walk, progress: Callable[[str], None], total: int) -> Walk:
    """`walk`, which says how far it is; the parts that rows come in change no bit of it."""
    done = 0

    def along(watch: Watch, state: WatchState, rows: Prepared) -> tuple[WatchState, Row]:
        nonlocal done
        found = []
        for first in range(0, len(rows.u), PART):
            progress(Step(f"judging run {rows.run.name}", done / total))
            part = rows.cut(slice(first, first + PART))
            state, row = walk(watch, state, part)
            found.append(row)
            done += len(part.u)
        return state, jax.tree.map(lambda *each: np.concatenate(each), *found)

    return along


def unjudged(
    model: Model, run: Run, acting: Prepared, r: dict[str, Float[np.ndarray, "samples"]]
) -> Decision:
    """`run` where nothing was calibrated for the bank: its residuals `r` alone."""
    count = len(run.t)
    why = [uncalibrated(model)] * count
    return Decision(run, prior_of(model, run), r, [NOT_JUDGED] * count, why, [], acting, acting)


def decide(
    bank: FaultBank, run: Run, reference: Reference | None = "free", walk: Walk = Watch.along
) -> Decision:
    """Judge one run; without residuals where there is no `reference`."""
    signals = bank.model.plant.signals
    check_delays(run, {each.name: each.delay for each in signals.inputs})
    watching = Watching(bank, run, walk)
    judged, decision = watching.push(run)
    r = {} if reference is None else residuals_of(bank.model, decision.acting, reference)
    return replace(decision, residuals=r, events=events(bank, judged), loose=watching.loose())


class Watching:
    """The watch along one run or stream."""

    def __init__(self, bank: FaultBank, run: Run, walk: Walk = Watch.along) -> None:
        self.model, self.plant, self.walk = bank.model, bank.plant, walk
        self.watch = Watch(bank.model, tuple(run.columns), run.step, bank=bank)
        self.state = self.watch.init(averaged=run.resampled is not None)
        self.glitches = Glitches(bank)

    def push(self, rows: Run) -> tuple[Judged, Decision]:
        """The next `rows`, however many; residuals and events are left open."""
        given = prepared(self.watch.signals, rows)
        self.state, row = self.walk(self.watch, self.state, given)
        status, reason = self.watch.words(row.verdict)
        acting, used = (
            with_taken(self.model, given, row.taken, outputs=still) for still in (False, True)
        )
        beside = (each.astype(np.float32) for each in (row.sets, row.rivals, row.noisy))
        found = Judged(used.run, row.posterior, row.verdict, *beside)
        odd = self.glitches.push(used.run, row.posterior)
        return found, Decision(rows, row.posterior, {}, status, reason, [], acting, used, odd)

    def loose(self) -> Float[np.ndarray, "constants"]:
        """Standard deviation of every constant, in the likeliest branch."""
        state, xi = self.state.bank, self.plant.parts.xi
        lead = int(np.argmax(np.asarray(state.weight)[: self.watch.modes.branches]))
        W = np.asarray(self.plant.directions)
        return np.sqrt(np.diag(W @ np.asarray(state.belief.P)[lead, xi, xi] @ W.T))


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
    count, found = len(decision.run.t), decision.posterior
    rows: dict[str, Any] = {"run": [decision.run.name] * count, "t": decision.run.t}
    if clocked:
        rows["time"] = stamps(decision.run)
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


def as_dicts(events: Sequence[BankEvent], clock: Clock | None = None) -> list[dict[str, Any]]:
    """Events as plain JSON; their times in seconds and as the log's `clock` shows them."""
    return [
        {
            **asdict(event),
            **{
                f"{name}_clock": stamp(clock, t)
                for name, t in (("onset", event.onset), ("start", event.start), ("end", event.end))
            },
            "alternatives": [{"faults": f, "odds": o} for f, o in event.alternatives],
            "instead": dict(event.instead),
            "beside": dict(event.beside),
            "rivals": dict(event.rivals),
        }
        for event in events
    ]
