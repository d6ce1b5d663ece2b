"""What is odd about logs before anything is fitted: a sentence for each, none of them a refusal."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

from faultgauge.identification.samples import state_column
from faultgauge.plants.signals import Input, Signals, State
from faultgauge.telemetry import Run
from faultgauge.telemetry.oversampling import oversampled
from faultgauge.telemetry.stuck import stuck_stretches

__all__ = ["beyond_limits", "log_warnings", "other_units"]

MANY_EMPTY = 0.05  # of the cells of an output
OTHER_UNIT = 300.0  # times the declared range: prefixes are off by 1000, ranges by less
LITTLE = 0.05  # of the declared range of an input
ROUNDING = 1e-3  # of an input's spread: what a log may round a limit by
OVERSHOOT = 0.05  # of an input's range: that of the filter that brings logs to a lower rate
FEW = 3  # samples beyond a limit that are no slip of the log


def log_warnings(signals: Signals, runs: Sequence[Run]) -> list[str]:
    """Warnings about stuck sensors, empty cells, units and excitation in `runs`."""
    found = []
    for run in runs:
        for output in signals.outputs:
            if output.name in run.columns:
                found += _of_output(run, output.name)
    for state in signals.states:
        columns = [state_column(signals, state.name, list(run.columns)) for run in runs]
        values = [r.columns[c] for r, c in zip(runs, columns, strict=True) if c is not None]
        found += _of_range(state, values, f"state {state.name!r}")
    for each in signals.inputs:
        values = [run.columns[each.name] for run in runs]
        found += [text for run in runs for text in _of_input(run, each.name)]
        found += list(_of_range(each, values, f"input {each.name!r}")) or beyond_limits(each, runs)
    apart = {*signals.input_names, *signals.instruments}
    measured = dict.fromkeys(name for run in runs for name in run.columns if name not in apart)
    return found + other_units(runs) + oversampled(runs, measured)


def other_units(runs: Sequence[Run]) -> list[str]:
    """A sentence for every column that one run has in another unit than another one, as its spread
    and its level tell: a run at rest has less spread, but not on a level as much lower. Where the
    logs give units these are compared as they are read."""
    found = []
    for name in dict.fromkeys(name for run in runs for name in run.columns):
        extents = [(*_extent(run, name), run) for run in runs if name in run.columns]
        told = sorted((each for each in extents if each[0] > 0), key=lambda each: each[0])
        if len(told) < 2 or all(name in run.units for *_, run in told):
            continue
        (spread, level, low), (wide, high_level, high) = told[0], told[-1]
        if min(wide / spread, high_level / level) > OTHER_UNIT:
            found.append(
                f"column {name!r} spreads {wide / spread:.2g} times as far in run {high.name!r} as "
                f"in run {low.name!r}; is it in the same unit in both? If not, convert it in one "
                "of the files (--map serves all logs of a call)"
            )
    return found


def _extent(run: Run, name: str) -> tuple[float, float]:
    """(range of a column, its largest absolute value)"""
    values = run.columns[name][np.isfinite(run.columns[name])]
    return (float(np.ptp(values)), float(np.abs(values).max())) if values.size else (0.0, 0.0)


def beyond_limits(each: Input, runs: Sequence[Run]) -> list[str]:
    """A sentence if an input goes where its actuator cannot: the log holds the command."""
    u = np.concatenate([run.columns[each.name] for run in runs])
    u = u[np.isfinite(u)]
    over = np.maximum(u - each.max, each.min - u)
    lowered = any(run.resampled is not None for run in runs)
    outside = over > (OVERSHOOT * np.ptp(u) if lowered else ROUNDING * np.std(u))
    if np.count_nonzero(outside) < FEW:
        return []
    return [
        f"input {each.name!r} goes beyond its limits, {each.min:g} to {each.max:g}, in "
        f"{100 * np.mean(outside):.2f} % of the rows (as far as {u[np.argmax(over)]:.4g}): this "
        "is the command, not what was applied; log what the actuator did, or correct min and max"
    ]


def _of_output(run: Run, name: str) -> Iterator[str]:
    stretches = stuck_stretches(run, name)
    if stretches:
        first, last = stretches[0].start, stretches[0].stop - 1
        others = len(stretches) - 1
        more = (" and once more" if others == 1 else f" and {others} times more") if others else ""
        yield (
            f"output {name!r} is stuck at {run.columns[name][first]:.6g} from {run.t[first]:.6g} s "
            f"to {run.t[last]:.6g} s of run {run.name!r}{more} while other columns move; leave "
            "those rows out with --where"
        )
    empty = float(np.mean(np.isnan(run.columns[name])))
    if empty > MANY_EMPTY:
        yield (
            f"output {name!r} is empty in {100 * empty:.0f} % of the rows of run {run.name!r}; "
            "what is not sampled is neither fitted nor scored"
        )


def _of_input(run: Run, name: str) -> Iterator[str]:
    empty = float(np.mean(np.isnan(run.columns[name])))
    if empty > MANY_EMPTY:
        yield (
            f"input {name!r} is empty in {100 * empty:.0f} % of the rows of run {run.name!r}, "
            "and each empty cell cuts the run: short stretches tell little and may bias "
            "constants; fill in the file what the input held there"
        )


def _of_range(
    signal: State | Input, columns: Sequence[Float[np.ndarray, "_"]], what: str
) -> Iterator[str]:
    values = np.concatenate([*columns, np.zeros(0)])
    values = values[np.isfinite(values)]
    if not values.size:
        return
    if math.isfinite(signal.min) and math.isfinite(signal.max):
        share = float(np.ptp(values)) / (signal.max - signal.min)
        declared = f"its range from {signal.min:g} to {signal.max:g}"
    elif isinstance(signal, State) and signal.initial:
        share = float(np.median(np.abs(values))) / abs(signal.initial)
        declared = f"its initial value {signal.initial:g}"
    else:
        return
    if share > OTHER_UNIT or 0 < share < 1 / OTHER_UNIT:
        yield (
            f"{what} is {share:.2g} times {declared} in the logs; is its column in "
            f"{signal.unit or 'the unit of the plant file'}? If not, convert it with --map"
        )
    elif isinstance(signal, Input) and share < LITTLE:
        yield (
            f"{what} moves through {100 * share:.1f} % of {declared} only: the model will know "
            "nothing beyond; add a log in which it moves more"
        )
