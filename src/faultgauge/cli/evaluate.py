"""`faultgauge evaluate`"""

from pathlib import Path
from typing import Annotated

import typer

from faultgauge.cli import options
from faultgauge.cli.writing import READS

__all__ = ["evaluate"]


def evaluate(
    model: Annotated[Path, typer.Argument(help="Model file."), READS],
    logs: options.Logs,
    warmup: Annotated[
        int,
        typer.Option("--warmup", min=0, help="Samples that set hidden start states, not scored."),
    ] = 50,
    time: options.Time = None,
    map: options.Map = None,
    where: options.Where = None,
    resample: options.Resample = None,
    report: options.ReportFile = None,
    json: options.Json = False,
) -> None:
    """Score a model by pure simulation on logs."""
    from faultgauge.identification.evaluation import divergence, evaluate_ensemble
    from faultgauge.identification.evaluation import evaluate as score
    from faultgauge.plants.model import load_model

    fitted = load_model(model)
    runs, odd = options.read_logs_for(fitted, logs, time, map, where, resample)
    with options.narrate("simulating"):
        found, predictions = score(fitted.plant, runs, fitted.max_step, warmup)
        if fitted.members:
            plants = [fitted.plant, *fitted.members]
            found["ensemble"] = evaluate_ensemble(plants, runs, fitted.max_step, warmup)
    options.warn(found["warnings"])
    found["warnings"] = [*odd, *found["warnings"]]
    if report is not None:
        from faultgauge.reporting.chapters import evaluation_report
        from faultgauge.reporting.report import write

        write(evaluation_report(fitted, found, predictions), report)
    if json:
        options.print_json(found)
        return
    units = {output.name: output.unit for output in fitted.plant.signals.outputs}
    for run in found["runs"]:
        for name, s in run["outputs"].items():
            if s["rmse"] is None:
                own = [p for p in predictions if p.run == run["run"]]
                options.tell(f"{run['run']}: {name}: {divergence(fitted.plant, own)}")
                continue
            options.tell(
                f"{run['run']}: {name}: free-run RMSE {s['rmse']:.4g} {units[name]}{_share(s)}"
            )
    for name, s in found.get("ensemble", {}).items():
        if s["rmse"] is None:
            print(f"ensemble: {name}: a member's free run diverges")
            continue
        print(
            f"ensemble: {name}: RMSE of the mean {s['rmse']:.4g} {units[name]}{_share(s)}, "
            f"the members spread by {s['spread']:.4g} {units[name]}"
        )


def _share(s: dict[str, float | None]) -> str:
    return "" if s["r2"] is None else f", R2 {s['r2']:.4%}, {s['nrmse']:.2%} of its spread"
