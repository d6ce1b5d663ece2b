"""Inputs that outputs show a row late: rows that hold measurements before the command that answers.

An output that reads an input reads that of its own row. Many loops measure, answer and then write
one row, so that it shows the command of the row before, and the command of its own row holds its
noise: who takes that for what the output reads finds that the input explains the noise. Of

    dy(k) = b0 du(k) + b1 du(k - 1) + b2 du(k - 2) + ...,

over all inputs that y reads, by least squares, such rows have b1 + b2 clearly not 0 and b0 next to
nothing, or against it, as the loop's answer to noise in y is.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from faultgauge.plants.expression import derivatives_used, names_used
from faultgauge.plants.spec import PlantSpec
from faultgauge.telemetry import Run

__all__ = ["rows_late", "rows_late_warnings"]

ROWS = 3  # of changes of an input: its own row, and two in which it shows
LEAST = 100  # rows that tell
CLEAR = 5.0  # standard deviations
OWN = 0.1  # of what shows later: less of a change in its own row is nothing
EVEN = 0.01  # of a step: rows of one rate
ROUNDING = 1e-6  # of what shows in the own row: less in the others is none


def rows_late(spec: PlantSpec, runs: Sequence[Run]) -> dict[str, float]:
    """By how much [s] inputs whose `delay` is left open come late in the outputs that read them: a
    row, or they are not named. Rows of several rates tell nothing."""
    runs = [run for run in runs if len(run.t) > ROWS]
    if not runs:
        return {}
    step = float(f"{np.median([run.step for run in runs]):.9g}")
    if any(np.any(np.abs(np.diff(run.t) / step - 1) > EVEN) for run in runs):
        return {}
    late, early = set[str](), set[str]()
    for output, reads in zip(spec.signals.output_names, _read(spec), strict=True):
        measured = [run for run in runs if {output, *reads} <= {*run.columns}]
        if not reads or not measured:
            continue
        for name, own in zip(reads, _late(measured, output, reads), strict=True):
            (late if own else early).add(name)
    return {name: step for name in spec.open_delays if name in late - early}


def rows_late_warnings(spec: PlantSpec, delays: Mapping[str, float]) -> list[str]:
    """A sentence for the inputs that come a row late."""
    if not delays:
        return []
    reads = dict(zip(spec.signals.output_names, _read(spec), strict=True))
    shown = [output for output, names in reads.items() if {*names} & {*delays}]
    names, step = ", ".join(delays), next(iter(delays.values()))
    return [
        f"{', '.join(shown)}: in its own row nothing of a change of {names} shows, as in rows that "
        "hold measurements before the command that answers them, so the model takes "
        f"delay = {step:.4g} (a row) in [inputs.NAME]; say delay = 0 there if a row's command acts "
        "before its outputs are read"
    ]


def _read(spec: PlantSpec) -> list[list[str]]:
    """The inputs that each output reads at its own time."""
    states = dict(zip(spec.signals.state_names, spec.derivatives, strict=True))
    found = []
    for value in spec.values:
        read = set(names_used(value))
        for state in derivatives_used(value):
            read |= names_used(states[state])
        found.append([name for name in spec.signals.input_names if name in read])
    return found


def _late(runs: Sequence[Run], output: str, reads: Sequence[str]) -> list[bool]:
    """Whether `output` shows a change of each input that it `reads` in later rows alone."""
    rows = [_rows(run, output, reads) for run in runs]
    X, dy = (np.concatenate(each) for each in zip(*rows, strict=True))
    told = np.isfinite(X).all(axis=1) & np.isfinite(dy)
    X, dy = X[told], dy[told]
    if len(dy) < LEAST:
        return [False] * len(reads)
    inverse = np.linalg.pinv(X.T @ X, hermitian=True)
    b = inverse @ X.T @ dy
    covariance = np.mean((dy - X @ b) ** 2) * inverse
    found = []
    for k in range(0, ROWS * len(reads), ROWS):
        own, later = np.eye(len(b))[k], np.eye(len(b))[k + 1 : k + ROWS].sum(axis=0)
        sign = np.sign(later @ b) or 1.0
        sd = np.sqrt([each @ covariance @ each for each in (own, later)])
        shown = sign * (later @ b) > max(CLEAR * sd[1], ROUNDING * abs(own @ b))
        found.append(bool(shown and sign * (own @ b) + sd[0] < OWN * sign * (later @ b)))
    return found


def _rows(
    run: Run, output: str, reads: Sequence[str]
) -> tuple[Float[np.ndarray, "rows changes"], Float[np.ndarray, "rows"]]:
    """(du(k), du(k - 1), ... of each input, dy(k)) of the rows of a run that have them."""
    du = [np.diff(run.columns[name]) for name in reads]
    count = len(run.t) - ROWS
    X = [each[ROWS - 1 - lag :][:count] for each in du for lag in range(ROWS)]
    return np.stack(X, axis=1), np.diff(run.columns[output])[ROWS - 1 :]
