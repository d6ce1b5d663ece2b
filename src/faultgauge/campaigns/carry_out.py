"""A campaign from its plan to its rows: chunk by chunk, each landed whole, and gone on with."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from importlib import metadata
from pathlib import Path

from faultgauge.campaigns.design import RunPlan, run_plans
from faultgauge.campaigns.folder import Folder
from faultgauge.campaigns.judging import made_model
from faultgauge.campaigns.outcome import Case, Row, row_of
from faultgauge.campaigns.result import Campaign
from faultgauge.campaigns.right import Right, right_of
from faultgauge.campaigns.runs import constants_of, healthy_run, log_of, schedules_of
from faultgauge.campaigns.schema import Plan, key_of
from faultgauge.campaigns.scoring import scored
from faultgauge.detection.decisions import Walk
from faultgauge.detection.watch import Watch
from faultgauge.plants.model import Model, load_model, save_model
from faultgauge.progress import Step
from faultgauge.rehearsal.judging import Judge

__all__ = ["carry_out"]

CHUNK = 8  # runs that are landed at once
VERSIONS = ("faultgauge", "jax", "numpy")  # another of these may give other bits


def carry_out(
    plan: Plan,
    out: Path,
    *,
    walk: Walk = Watch.along,
    progress: Callable[[str], None] = lambda text: None,
) -> Campaign:
    """Simulate and judge every run of `plan`, and keep what comes out in the folder `out`.

    A call that was ended goes on where it was with the same plan: its rows are the same, to the
    byte. `walk` is who runs the step along logs. Raises `InputError` where `out` holds another
    campaign, where the model that judges cannot be had, and where a run leaves all bounds.
    """
    versions = {name: metadata.version(name) for name in VERSIONS}
    engine = "python" if walk is Watch.along else "c"
    key = key_of([plan.content, versions, engine])
    folder = Folder(out, plan.name, key)
    model = _model(plan, folder, progress)
    right = right_of(plan, model.plant.signals.faults)
    runs = run_plans(plan)
    chunks = [runs[k : k + CHUNK] for k in range(0, len(runs), CHUNK)]
    key = key_of([key, hashlib.sha256(folder.model.read_bytes()).hexdigest()])
    lab: _Lab | None = None
    rows = list[Row]()
    for k, chunk in enumerate(chunks):
        progress(Step(f"{plan.name}: {len(rows)} of {len(runs)} runs", len(rows) / len(runs)))
        found = folder.rows(k, key)
        if found is None:
            lab = lab or _Lab(plan, model, right, walk)
            folder.land(k, key, [lab.row(run) for run in chunk])
            found = folder.rows(k, key)
            assert found is not None
        rows += found
    return scored(plan, model, right, rows, folder.warnings)


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
