"""Rows as figures. Those of one kind by its size are a rehearsal's."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from faultgauge.campaigns.outcome import (
    LEVELS,
    OTHERWISE,
    SILENT,
    SLOTS,
    SPLIT,
    UNDECIDED,
    Row,
    times_of,
    trial_of,
)
from faultgauge.campaigns.result import (
    Bin,
    Campaign,
    Curve,
    Isolation,
    KindResult,
    RunFigure,
    Separable,
)
from faultgauge.campaigns.right import Right
from faultgauge.campaigns.schema import HEALTHY, Kind, Plan, label
from faultgauge.detection.posterior.uncalibrated import level_in
from faultgauge.plants.model import Model
from faultgauge.rehearsal.judging import UNKNOWN, false_alarm_rate
from faultgauge.rehearsal.result import FaultResult, Trial
from faultgauge.rehearsal.scoring import fault_result, figures, smallest_size
from faultgauge.rehearsal.shares import over_runs, poisson, wilson

__all__ = ["scored"]

EDGES = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 1.0)  # of a reliability diagram
LEAST = 1e-9  # a probability whose logarithm is taken
ALL = "all"


def scored(
    plan: Plan,
    model: Model,
    right: Mapping[str, Right],
    rows: Sequence[Row],
    warnings: Sequence[str],
) -> Campaign:
    """All figures of a campaign."""
    names = (*model.plant.signals.fault_names, UNKNOWN)
    level = level_in(model).level
    faulty = [row for row in rows if row["kind"] != HEALTHY]
    kinds = tuple(_kind(plan, kinds, rows, right) for kinds in plan.kinds)
    hours = sum(row["healthy_hours"] for row in rows)
    real = [row for row in faulty if trial_of(row, right) is not None]
    answers = [each for row in real if (t := trial_of(row, right)) for each in t.answers]
    sized = [each for each in answers if each.size_covered is not None]
    dated = [each for each in answers if each.onset_covered is not None]
    pairs = [_pairs(row, right, names) for row in rows if row["p_healthy"] is not None]
    return Campaign(
        name=plan.name,
        plant=model.plant.spec.name,
        kinds=kinds,
        levels=LEVELS,
        level=level,
        false=tuple(
            poisson(sum(row[f"false_at_{level:g}"] for row in rows), hours) for level in LEVELS
        ),
        curves=_curves(plan, real),
        isolation=_isolation(plan, rows, names),
        reliability=_reliability(pairs),
        brier=_mean([float(np.sum((p - y) ** 2)) for p, y in pairs]),
        log_score=_mean([_log_score(p, y) for p, y in pairs]),
        size_covered=wilson(sum(bool(e.size_covered) for e in sized), len(sized)),
        onset_covered=wilson(sum(bool(e.onset_covered) for e in dated), len(dated)),
        covers=_covers(real),
        separable=_separable(real),
        false_alarms=poisson(sum(row["false_alarms"] for row in rows), hours),
        calibrated_rate=false_alarm_rate(model),
        warnings=tuple(warnings),
        rows=tuple(rows),
    )


def _kind(
    plan: Plan, kinds: Sequence[Kind], rows: Sequence[Row], right: Mapping[str, Right]
) -> KindResult:
    mine = [row for row in rows if row["kind"] == label(kinds)]
    trials = [trial for row in mine if (trial := trial_of(row, right)) is not None]
    found, smallest = _by_size(plan, kinds, mine, trials)
    delays = [np.inf if row.get("delay") is None else row["delay"] for row in mine]
    widths = [
        row["width"] / abs(row["size"]) for row in mine if row.get("width") and row.get("size")
    ]
    return KindResult(
        runs=len(mine),
        right=tuple(name for each in kinds for name in right[each.name].names),
        faults=found,
        smallest=smallest,
        covers=_covers(mine),
        width=_median(widths),
        delay=_median(delays if trials else []),
        trials=tuple(trials),
    )


def _by_size(
    plan: Plan, kinds: Sequence[Kind], rows: Sequence[Row], trials: Sequence[Trial]
) -> tuple[FaultResult, RunFigure]:
    """Figures over the size, and the one that was named 90 % of the time; of pairs, and of what is
    stuck or lost, over all runs."""
    if len(kinds) > 1 or not kinds[0].sized or not trials:
        whole = FaultResult(label(kinds), "", None, None, None, (), figures(trials), {})
        return whole, RunFigure(None, None, None)
    foretold = [np.inf if row["foretold"] is None else row["foretold"] for row in rows]
    usual = float(np.median(foretold))
    unit = kinds[0].schedule(plan.scenario, 1.0, plan.onset.values[0]).unit
    found = fault_result(kinds[0].name, unit, usual if np.isfinite(usual) else None, trials)
    sizes = np.array([abs(each.answers[0].size) for each in trials])
    named = np.array([each.found for each in trials])

    def least(drawn: Int[np.ndarray, "draws runs"]) -> Float[np.ndarray, "draws"]:
        each = (smallest_size(sizes[k], named[k]) for k in drawn)
        return np.array([np.inf if one is None else one.size for one in each])

    return found, _figure(len(trials), least)


def _curves(plan: Plan, rows: Sequence[Row]) -> tuple[Curve, ...]:
    """Of all runs with a fault, then of each kind."""
    groups = {ALL: rows} | {
        name: mine
        for kinds in plan.kinds
        if (mine := [row for row in rows if row["kind"] == (name := label(kinds))])
    }
    return tuple(_curve(name, mine) for name, mine in groups.items())


def _curve(name: str, rows: Sequence[Row]) -> Curve:
    found = []
    for level in LEVELS:
        cells = [row[f"alarm_after_at_{level:g}"] for row in rows]
        detected = wilson(sum(cell is not None for cell in cells), len(cells))
        found.append((detected, _median([np.inf if c is None else c for c in cells])))
    return Curve(name, tuple(d for d, _ in found), tuple(f for _, f in found))


def _isolation(plan: Plan, rows: Sequence[Row], names: Sequence[str]) -> Isolation:
    kinds = [label(each) for each in plan.kinds]
    if plan.healthy:
        kinds.append(HEALTHY)
    told = {kind: Counter(r["answer"] for r in rows if r["kind"] == kind) for kind in kinds}
    answers = (*names, *OTHERWISE)
    undecided = [row for row in rows if row["answer"] == UNDECIDED]
    sets: dict[str, dict[str, int]] = {}
    for row in undecided:
        own = sets.setdefault(row["kind"], {})
        possible = row["possible"].replace(SPLIT, " or ") or "healthy again"
        own[possible] = own.get(possible, 0) + 1
    counts = tuple(tuple(told[kind][each] for each in answers) for kind in kinds)
    return Isolation(tuple(kinds), answers, counts, sets)


def _pairs(
    row: Row, right: Mapping[str, Right], names: Sequence[str]
) -> tuple[Float[np.ndarray, "causes"], Float[np.ndarray, "causes"]]:
    """(probability, truth) of every cause and of health in one run; names that count as right for
    one fault are one cause."""
    kinds = [row[f"fault{suffix}"] for suffix in SLOTS if row.get(f"fault{suffix}") is not None]
    true = [right[kind].names for kind in kinds if right[kind].names]
    held = {name for each in true for name in each}
    p = [min(sum(row[f"p_{name}"] or 0.0 for name in each), 1.0) for each in true]
    p += [row[f"p_{name}"] or 0.0 for name in names if name not in held]
    y = [1.0] * len(true) + [0.0] * (len(p) - len(true))
    return np.array([*p, row["p_healthy"]]), np.array([*y, 0.0 if true else 1.0])


def _log_score(p: Float[np.ndarray, "causes"], y: Float[np.ndarray, "causes"]) -> float:
    """-ln of what was given to the truth, of each cause for itself."""
    return float(-np.sum(np.log(np.clip(np.where(y > 0, p, 1 - p), LEAST, 1.0))))


def _reliability(
    pairs: Sequence[tuple[Float[np.ndarray, "_"], Float[np.ndarray, "_"]]],
) -> tuple[Bin, ...]:
    p, y = (np.concatenate([each[k] for each in pairs] or [np.zeros(0)]) for k in (0, 1))
    at = np.clip(np.searchsorted(EDGES, p, side="right") - 1, 0, len(EDGES) - 2)
    return tuple(
        Bin(
            EDGES[k],
            EDGES[k + 1],
            float(p[at == k].mean()) if np.any(at == k) else None,
            wilson(int(y[at == k].sum()), int(np.sum(at == k))),
        )
        for k in range(len(EDGES) - 1)
    )


def _separable(rows: Sequence[Row]) -> Separable:
    below = [row for row in rows if not _foretold(row)]
    rest = [row for row in rows if _foretold(row)]
    undecided = [row for row in rest if row["answer"] == UNDECIDED]
    silent = [row for row in rest if row["answer"] == SILENT]
    judged = len(rest) - len(undecided) - len(silent)
    exact = sum(row["exact"] for row in rest)
    apart = len(below) + len(undecided) + len(silent)
    return Separable(
        wilson(exact, judged), wilson(apart, len(rows)), len(below), len(undecided), len(silent)
    )


def _foretold(row: Row) -> bool:
    """Whether all faults are of a size that the sheet foretold it would name."""
    present = [suffix for suffix in SLOTS if row.get(f"fault{suffix}") is not None]
    times = [times_of(row[f"size{suffix}"], row[f"foretold{suffix}"]) for suffix in present]
    return all(each is not None and each >= 1 for each in times)


def _covers(rows: Sequence[Row]) -> RunFigure:
    """The share of rows since a fault was named whose interval holds its size."""
    counts = np.array(
        [
            [row[f"rows_inside{s}"], row[f"rows{s}"]]
            for row in rows
            for s in SLOTS
            if row.get(f"rows{s}")
        ],
        float,
    ).reshape(-1, 2)
    inside, rows_of = counts.T
    return _figure(len(counts), lambda k: inside[k].sum(axis=1) / rows_of[k].sum(axis=1))


def _mean(values: Sequence[float]) -> RunFigure:
    every = np.array(values)
    return _figure(len(every), lambda k: every[k].mean(axis=1))


def _median(values: Sequence[float]) -> RunFigure:
    every = np.array(values)
    return _figure(len(every), lambda k: np.median(every[k], axis=1))


def _figure(
    count: int, of: Callable[[Int[np.ndarray, "draws runs"]], Float[np.ndarray, "draws"]]
) -> RunFigure:
    if not count:
        return RunFigure(None, None, None)
    lo, hi = over_runs(count, of)
    return RunFigure(_finite(float(of(np.arange(count)[None])[0])), _finite(lo), _finite(hi))


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
