"""`evaluate`: how well a model follows logs by pure simulation."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Unpack

from faultgauge.identification.validation import evaluation
from faultgauge.identification.validation.evaluation import POOR_FREE_RUN, WARMUP, Prediction
from faultgauge.identification.validation.restarted import restarted
from faultgauge.plants.model import Model
from faultgauge.verbs.how import How, Reading, reads
from faultgauge.verbs.plants import model_of
from faultgauge.verbs.reading import runs_for_model, unlike_warnings
from faultgauge.verbs.result import Columns, Result

__all__ = ["Evaluation", "evaluate"]

FAR = 3.0  # times an output's spread: digits of such a run tell nothing


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation(Result):
    """How well a model's free runs follow logs.

    **Fields**

    - `scores`: `{"outputs": {NAME: {r2, rmse, nrmse}}, "runs": [...], "warnings": [...]}`, and
      `"ensemble"` where the model has members. A run whose free run does not follow an output has
      `"restarted": {"horizon_s", "outputs"}`: the same where it starts anew so often.
    - `predictions`: the free runs, beside what was measured; `warnings`: about the logs.
    """

    model: Model
    scores: dict[str, Any]
    predictions: list[Prediction]
    warnings: Sequence[str]

    @property
    def lines(self) -> list[str]:
        plant, lines = self.model.plant, []
        units = {output.name: output.unit for output in plant.signals.outputs}
        for run in self.scores["runs"]:
            for name, s in run["outputs"].items():
                if s["rmse"] is None:
                    own = [p for p in self.predictions if p.run == run["run"]]
                    said = evaluation.divergence(plant, own)
                else:
                    said = f"free-run RMSE {s['rmse']:.4g} {units[name]}{_share(s)}"
                lines.append(f"{run['run']}: {name}: {said}")
                lines += _anew(run, name, units[name])
        for name, s in self.scores.get("ensemble", {}).items():
            if s["rmse"] is None:
                lines.append(f"ensemble: {name}: a member's free run diverges")
                continue
            lines.append(
                f"ensemble: {name}: RMSE of the mean {s['rmse']:.4g} {units[name]}{_share(s)}, "
                f"the members spread by {s['spread']:.4g} {units[name]}"
            )
        return lines

    def as_dict(self) -> dict[str, Any]:
        return self.scores

    def columns(self) -> Columns:
        """A row per run and output."""
        rows = [
            {"run": run["run"], "output": name, **scores, "samples": run["samples"]}
            for run in self.scores["runs"]
            for name, scores in run["outputs"].items()
        ]
        return {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}

    def page(self) -> Any:
        from faultgauge.reporting.chapters import evaluation_report

        return evaluation_report(self.model, self.scores, self.predictions)

    def figures(self) -> Any:
        from faultgauge.reporting.chapters import evaluation_section

        return evaluation_section(self.model, self.scores, self.predictions).figures


def _anew(run: dict[str, Any], name: str, unit: str) -> list[str]:
    """What a prediction over a horizon errs by, where the free run was tried so."""
    s = run.get("restarted", {}).get("outputs", {}).get(name)
    if s is None or s["rmse"] is None:
        return []
    every = f"started anew every {run['restarted']['horizon_s']:.3g} s"
    return [f"{run['run']}: {name}: {every}: RMSE {s['rmse']:.4g} {unit}{_share(s)}"]


def _share(s: dict[str, float | None]) -> str:
    if s["r2"] is None or s["nrmse"] is None:
        return ""
    if s["nrmse"] > FAR:
        return f", {s['nrmse']:.2g} times its spread: that does not follow it"
    return f", R2 {100 * s['r2']:.4f} %, {100 * s['nrmse']:.2f} % of its spread"


@reads
def evaluate(
    model: Any,
    sources: Any,
    *,
    warmup: int = WARMUP,
    **reading: Unpack[Reading],
) -> Evaluation:
    """Score a model by pure simulation on logs.

    **Arguments**

    - `model`: a fitted model, or its file.
    - `sources`: logs: paths, data frames, dicts of arrays, runs, or a list of them (`read`, which
      also says what `time`, `time_format`, `map`, `where` and `resample` mean).
    - `warmup`: samples that set hidden start states and are not scored.

    Returns an `Evaluation`. Raises `InputError` for logs that cannot be read or scored.
    """
    known = model_of(model)
    runs = runs_for_model(known, sources, How(**reading))
    odd = unlike_warnings(known, runs)
    how = known.max_step, warmup, known.record.between
    found, predictions = evaluation.evaluate(known.plant, runs, *how)
    for run in found["runs"]:
        lost = [
            name
            for name, s in run["outputs"].items()
            if s["nrmse"] is None or s["nrmse"] >= POOR_FREE_RUN
        ]
        log = next(each for each in runs if each.name == run["run"])
        anew = restarted(known.plant, log, lost, *how) if lost else None
        if anew:
            run["restarted"] = {"horizon_s": anew.horizon, "outputs": anew.outputs}
    if known.members:
        plants = [known.plant, *known.members]
        found["ensemble"] = evaluation.evaluate_ensemble(plants, runs, *how)
    found["warnings"] = [*odd, *found["warnings"]]
    return Evaluation(known, found, predictions, found["warnings"])
