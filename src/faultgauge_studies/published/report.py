"""The report of one benchmark: our errors beside published and peer ones, and the free runs."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from faultgauge.reporting.report import Report, Section, Table
from faultgauge.reporting.svg import Figure
from faultgauge.reporting.time_figures import Panel, free_run, panels
from faultgauge_studies.published.benchmark import Split
from faultgauge_studies.published.peers import fitted_on
from faultgauge_studies.published.run import Found, as_dict

__all__ = ["benchmark_report", "score_rows", "section"]

RULES = (
    "Pure simulation: the model runs on the test run's inputs alone. Measured test outputs are "
    "used for the initial state only, from the first samples stated, which are not scored. "
    "No fit sees the test data; every seed is a whole fit."
)
PIECES = 100  # of a test run: the error over time is its RMS over each


def benchmark_report(found: Found) -> Report:
    """The report of `faultgauge benchmark`."""
    content = as_dict(found)
    count = f"{len(found.trials)} seed{'s' if len(found.trials) > 1 else ''}"
    summary = tuple(
        f"{name}: RMSE {_span(split['rmse'])} {found.benchmark.unit} over {count}"
        + (
            "."
            if split["published_best"] is None
            else f"; best published {split['published_best']:g} ({split['published_by']})."
        )
        for name, split in content["splits"].items()
    )
    return Report(f"Benchmark: {found.benchmark.title}", summary, (section(found),))


def section(found: Found) -> Section:
    """One benchmark: its table, and for every split the first seed's free run and its error."""
    sources = {split.published for split in found.records.splits if split.published is not None}
    peer = found.peers["jax_sysid"]
    notes = (
        *(f"{p.rmse:g} {found.benchmark.unit}, {p.by}: {p.source}; {p.where}."
          for p in sorted(sources, key=lambda each: (each.by, each.rmse))),
        f"jax-sysid: {peer}" if isinstance(peer, str) else fitted_on(found.benchmark.name),
        *_warnings(found),
    )  # fmt: skip
    header, rows = score_rows(found)
    figures = [each for split in found.records.splits for each in _figures(found, split)]
    return Section(
        found.benchmark.title,
        (found.benchmark.description, RULES, *notes),
        (Table(header, rows, "Median [smallest to largest] over seeds."),),
        tuple(figures),
    )


def score_rows(found: Found) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Header and rows: each split's error, the best published one, the peer's; then fit times."""
    content, unit, peer = as_dict(found), found.benchmark.unit, found.peers["jax_sysid"]
    theirs: Mapping[str, Any] = {} if isinstance(peer, str) else peer
    rows = []
    for split in found.records.splits:
        own = content["splits"][split.name]
        best = split.published
        rows.append(
            (
                f"{split.name}, RMSE ({unit})",
                str(split.window),
                _span(own["rmse"]),
                "none" if best is None else f"{best.rmse:g} ({best.by})",
                _span(theirs["splits"][split.name]["rmse"]) if theirs else "not run",
            )
        )
    time = _span(theirs["fit_s"]) if theirs else "not run"
    rows.append(("fit (s)", "", _span(content["fit_s"]), "", time))
    header = ("", "first samples, not scored", "faultgauge", "best published", "jax-sysid")
    return header, tuple(rows)


def _span(values: Mapping[str, float | None]) -> str:
    shown = {key: "diverges" if x is None else f"{x:.3g}" for key, x in values.items()}
    return f"{shown['median']} [{shown['min']} to {shown['max']}]"


def _warnings(found: Found) -> tuple[str, ...]:
    said = dict.fromkeys(text for trial in found.trials for text in trial.warnings)
    return tuple(f"Warning: {text}." for text in said)


def _figures(found: Found, split: Split) -> list[Figure]:
    """Output and error of the first seed, whatever its rank; error over time of every seed."""
    scale, unit, name = found.benchmark.scale, found.benchmark.unit, found.benchmark.output
    (first, *_) = found.trials[0].predictions[split.name]
    drawn = free_run(
        first.t,
        scale * first.measured[:, 0],
        scale * first.predicted[:, 0],
        name=name,
        unit=unit,
        run=f"{split.name}, seed {found.trials[0].seed}",
        warmup=first.warmup,
    )
    return [drawn, *_error_over_time(found, split)]


def _error_over_time(found: Found, split: Split) -> list[Figure]:
    """RMS of the error over pieces of the test run, of the first seeds; none where all diverge."""
    scale, values, t = found.benchmark.scale, {}, np.zeros(0)
    for trial in found.trials[:4]:  # four curves still read well
        (run, *_) = trial.predictions[split.name]
        square = (scale * (run.measured[:, 0] - run.predicted[:, 0])) ** 2
        blocks = np.array_split(np.arange(run.warmup, len(run.t)), PIECES)
        t = np.array([run.t[block].mean() for block in blocks])
        rms = np.sqrt([square[block].mean() for block in blocks])
        if np.isfinite(rms).all():
            values[f"seed {trial.seed}"] = rms
    if not values:
        return []
    panel = Panel("RMS error", found.benchmark.unit, values)
    caption = f"RMS of the error over each {PIECES}th of the test run."
    return [panels(t, [panel], title=f"Error over time, {split.name}", caption=caption)]
