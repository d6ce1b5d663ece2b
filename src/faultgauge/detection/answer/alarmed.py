"""`fit` refuses data under alarm: a fault that is fitted is a fault that is never found."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np

from faultgauge.detection.words import times_more
from faultgauge.errors import InputError
from faultgauge.plants.model import load_model
from faultgauge.telemetry import Run
from faultgauge.telemetry.logs import Source, open_logs

__all__ = ["refuse_alarms"]

STATUS_COLUMN = "status"  # the column that `estimate` writes
SHOWN = 3  # stretches that a refusal names

Stretches: TypeAlias = list[tuple[float, float]]


def refuse_alarms(
    runs: Sequence[Run],
    sources: Sequence[Source],
    time: str | None,
    maps: Iterable[str],
    where: str | None,
    before: Path | None,
    time_format: str | None = None,
) -> None:
    """Raises `InputError` where `runs`, read from `sources`, stand under alarm: by a column
    `status` of theirs, or judged by the calibrated model `before` that the fit would replace."""
    found = _by_column(sources, time, maps, where, time_format) if sources else {}
    said = f"column {STATUS_COLUMN!r} says FAULT"
    if not found and before is not None and before.is_file():
        found, said = _by_model(runs, before), f"{before}, which this fit would replace, alarms"
    if not found:
        return
    source, stretches = next(iter(found.items()))
    times = ", ".join(f"{a:.6g} s to {b:.6g} s" for a, b in stretches[:SHOWN])
    more = f" and {times_more(len(stretches) - SHOWN)}" if len(stretches) > SHOWN else ""
    raise InputError(
        f"{source}: {said} from {times}{more}, and a fault that is fitted is never found; cut "
        "these times out with --where, or give --despite-alarms if the log is sound."
    )


def _by_column(
    sources: Sequence[Source],
    time: str | None,
    maps: Iterable[str],
    where: str | None,
    time_format: str | None,
) -> dict[str, Stretches]:
    found = dict[str, Stretches]()
    for log in open_logs(sources, time, maps, where, time_format):
        cells = log.table.columns.get(STATUS_COLUMN)
        if cells is None:
            continue
        for samples in log.runs.values():
            alarm = np.array([str(cells[k]).strip() == "FAULT" for k in samples])
            edges = np.flatnonzero(np.diff(alarm, prepend=False, append=False)).reshape(-1, 2)
            t = log.t[samples]
            stretches = [(float(t[a]), float(t[b - 1])) for a, b in edges]
            if stretches:
                found.setdefault(log.table.source, []).extend(stretches)
    return found


def _by_model(runs: Sequence[Run], path: Path) -> dict[str, Stretches]:
    """Alarms of a calibrated model over `runs`; none where it cannot judge them."""
    try:
        model = load_model(path)
        if model.calibration is None:
            return {}
        # all of detection, which few fits need
        from faultgauge.detection.decisions import decide_runs
        from faultgauge.detection.posterior.events import pause, stretches

        decisions, bank = decide_runs(model, runs)
    except (InputError, KeyError):  # another plant's model, or no model at all
        return {}
    found = dict[str, Stretches]()
    for each in decisions:
        t, alarm = each.run.t, np.array(each.status) == "FAULT"
        edges = stretches(alarm, np.isfinite(each.posterior.healthy), pause(bank) if bank else 1)
        if edges:
            times = [(float(t[a]), float(t[b - 1])) for a, b in edges]
            found.setdefault(each.run.source, []).extend(times)
    return found
