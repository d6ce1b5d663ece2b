"""A campaign from its plan to its rows: chunk by chunk, each landed whole, and gone on with."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from faultgauge.campaigns.design import RunPlan, run_plans
from faultgauge.campaigns.folder import Folder
from faultgauge.campaigns.judging import made_model
from faultgauge.campaigns.outcome import Case, Row, row_of
from faultgauge.campaigns.result import Campaign
from faultgauge.campaigns.right import Right, right_of
from faultgauge.campaigns.runs import constants_of, healthy_run, log_of, schedules_of
from faultgauge.campaigns.schema import Plan, key_of
from faultgauge.campaigns.scoring import scored
from faultgauge.crew.chunk import versions
from faultgauge.crew.crew import Done, done
from faultgauge.detection.decisions import Walk
from faultgauge.detection.watch import Watch
from faultgauge.plants.model import Model, load_model, save_model
from faultgauge.progress import Step
from faultgauge.rehearsal.judging import Judge

__all__ = ["carry_out"]

CHUNK = 8  # runs that are landed at once
ROWS = "rows.json"


def carry_out(
    plan: Plan,
    out: Path,
    *,
    walk: Walk = Watch.along,
    scheduler: str | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Campaign:
    """Simulate and judge every run of `plan`, and keep what comes out in the folder `out`.

    A call that was ended goes on where it was with the same plan: its rows are the same, to the
    byte. `walk` is who runs the step along logs; a `scheduler` has the runs done by its workers
    (`crew.crew`), whose rows are the same, too. Raises `InputError` where `out` holds another
    campaign, where the model that judges cannot be had, and where a run leaves all bounds.
    """
    engine = "python" if walk is Watch.along else "c"
    key = key_of([plan.content, versions(), engine])
    folder = Folder(out, plan.name, key)
    model = _model(plan, folder, progress)
    right = right_of(plan, model.plant.signals.faults)
    runs = run_plans(plan)
    chunks = [runs[k : k + CHUNK] for k in range(0, len(runs), CHUNK)]
    key = key_of([key, hashlib.sha256(folder.model.read_bytes()).hexdigest()])
    left = [_Runs(k, runs) for k, runs in enumerate(chunks) if folder.rows(k, key) is None]
    count = len(runs) - sum(len(each.runs) for each in left)
    tell = _telling(progress, plan.name, len(runs))
    tell(count)
    for each in done(scheduler, _Job(key, plan, model, right, walk), left, progress):
        found = json.loads(each.files[ROWS])
        folder.land(int(each.name), key, found)
        count += len(found)
        tell(count)
    rows = list[Row]()
    for k in range(len(chunks)):
        found = folder.rows(k, key)
        assert found is not None
        rows += found
    return scored(plan, model, right, rows, folder.warnings)


def _telling(progress: Callable[[str], None], name: str, of: int) -> Callable[[int], None]:
    return lambda count: progress(Step(f"{name}: {count} of {of} runs", count / of))


@dataclass(frozen=True)
class _Runs:
    """Some runs, which are landed at once as the chunk of this `number`."""

    number: int
    runs: Sequence[RunPlan]

    @property
    def name(self) -> str:
        return str(self.number)


@dataclass(frozen=True)
class _Job:
    """Simulates and judges runs, wherever it is; a process makes what it needs for that once."""

    key: str
    plan: Plan
    model: Model
    right: Mapping[str, Right]
    walk: Walk

    def __call__(self, piece: _Runs) -> Done:
        if (who := (self.key, _Lab)) not in _labs:
            _labs.clear()
            _labs[who] = _Lab(self.plan, self.model, self.right, self.walk)
        rows = [_labs[who].row(run) for run in piece.runs]
        return Done(piece.name, {ROWS: json.dumps(rows, allow_nan=False).encode()})


_labs: dict[Any, "_Lab"] = {}  # the last one


def _model(plan: Plan, folder: Folder, progress: Callable[[str], None]) -> Model:
    """The model in the folder, made first where it is not there."""
    if not folder.model.is_file():
        model, warnings = made_model(plan, progress)
        folder.keep(warnings)
        save_model(model, folder.model)
    return load_model(folder.model)  # so that it is the same one for who goes on


class _Lab:
    """Simulates and judges."""

    def __init__(self, plan: Plan, model: Model, right: Mapping[str, Right], walk: Walk) -> None:
        self.plan, self.right = plan, right
        self.judge = Judge(model, [healthy_run(plan, plan.seed, "healthy")], walk)

    def row(self, run: RunPlan) -> Row:
        plan, right = self.plan, [self.right[each.name] for each in run.kinds]
        faults = schedules_of(plan, run)
        case = Case(run, faults, right, constants_of(plan, run.seed), self._foretold(run, right))
        return row_of(case, self.judge, self.judge.decide(log_of(plan, run, faults)))

    def _foretold(
        self, run: RunPlan, right: Sequence[Right]
    ) -> Sequence[Mapping[str, float | None]]:
        """By the same run without its faults, from each onset on."""
        if not any(k.constant and r.sized for k, r in zip(run.kinds, right, strict=True)):
            return [{} for _ in right]
        twin = log_of(self.plan, run, ())
        shares = [(each - twin.t[0]) / (twin.t[-1] - twin.t[0]) for each in run.onsets]
        return self.judge.smallest(twin, *shares)
