"""Records: what a log says, as sampled, on even grids; and the windows that are cut from them."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from faultgauge.errors import InputError
from faultgauge.identification.samples import Channels, spread
from faultgauge.identification.simulation_error.drift import SlowWalk
from faultgauge.identification.simulation_error.window_fit import WindowBatch
from faultgauge.plants.signals import Signals
from faultgauge.simulation.intersample import intersample
from faultgauge.telemetry import Run, as_sampled, segments
from faultgauge.telemetry.derivatives import noise_sd
from faultgauge.telemetry.resampling import on_grid

__all__ = ["Piece", "Record", "cut_windows", "output_scale", "pieces_of", "records_of"]

SHORTEST = 16  # samples of a record
SLOPE_WINDOW = 25  # samples either side, for the first guess of an unmeasured speed


@dataclass(frozen=True)
class Record:
    """A stretch of one run without a gap in its inputs, on an even grid, nothing smoothed.

    `x` holds measured states as sampled, those that are derivatives of measured ones by a local
    polynomial, and NaN for hidden ones; `sd` says how well they are known. Empty cells of `y` are
    NaN: they weigh nothing. `u` is inside the actuators' limits.
    """

    run: str
    step: float
    t: Float[np.ndarray, "samples"]
    u: Float[np.ndarray, "samples inputs"]
    x: Float[np.ndarray, "samples states"]
    sd: Float[np.ndarray, "states"]
    y: Float[np.ndarray, "samples outputs"]


class Piece(NamedTuple):
    """Samples [start, stop) of a record."""

    record: int
    start: int
    stop: int


def records_of(signals: Signals, runs: Sequence[Run], how: Channels) -> list[Record]:
    """Records of all runs that are long enough. Raises `InputError` where none is."""
    records = []
    for run in runs:
        for part in segments(run, how.inputs):
            t = run.t[part]
            if len(t) < SHORTEST:
                continue
            records.append(_record(signals, run, part, how))
    if not records:
        raise InputError(
            f"{runs[0].source}: no {SHORTEST} samples in a row have all inputs "
            f"({', '.join(how.inputs)}); look at it with `faultgauge inspect`."
        )
    return records


def _record(signals: Signals, run: Run, part: slice, how: Channels) -> Record:
    names = dict.fromkeys([*how.inputs, *how.outputs, *(s[0] for s in how.states if s)])
    columns = {name: run.columns[name][part] for name in names}
    for each in signals.inputs:
        columns[each.name] = np.clip(columns[each.name], each.min, each.max)
    held = {each.name for each in signals.inputs if each.hold == "zero"}
    step, t, on = on_grid(run.t[part], columns, held)
    for name in on.keys() - how.inputs:  # an input acts between its samples, too
        on[name] = as_sampled(run, name, t, on[name])
    empty = np.full(len(t), np.nan)
    x, sd = [], []
    for source in how.states:
        guess, error = (empty, np.nan) if source is None else _guess(on[source[0]], source[1], step)
        x.append(guess)
        sd.append(error)
    return Record(
        run=run.name,
        step=step,
        t=t,
        u=np.stack([on[n] for n in how.inputs], 1) if how.inputs else np.zeros((len(t), 0)),
        x=np.stack(x, axis=1),
        sd=np.array(sd, float),
        y=np.stack([on[n] if n in how.outputs else empty for n in signals.output_names], 1),
    )


def _guess(
    column: Float[np.ndarray, "samples"], order: int, step: float
) -> tuple[Float[np.ndarray, "samples"], float]:
    """A state from the column that it is a derivative of (order 0: is), and how well."""
    known = np.isfinite(column)
    if known.sum() < SHORTEST // 2:
        return np.full(len(column), np.nan), np.nan
    filled = np.interp(np.arange(len(column)), np.flatnonzero(known), column[known])
    if order == 0:
        return filled, max(3 * noise_sd(column[known]), 1e-9 * float(np.ptp(filled)), 1e-12)
    from scipy.signal import savgol_filter  # half a second to load, which few commands need

    half = min(SLOPE_WINDOW, (len(column) - 1) // 2)
    degree = min(order + 1, 2 * half)
    smooth = np.asarray(savgol_filter(filled, 2 * half + 1, degree, deriv=order, delta=step))
    return smooth, max(float(np.std(smooth)), 1e-12)


def pieces_of(records: Sequence[Record], length: int, most: int | None = None) -> list[Piece]:
    """All records cut into pieces of about `length`; at most `most` of them, spread evenly."""
    pieces = []
    for k, record in enumerate(records):
        count = max(1, round(len(record.t) / length))
        edges = np.linspace(0, len(record.t), count + 1).astype(int)
        pieces += [Piece(k, int(a), int(b)) for a, b in itertools.pairwise(edges)]
    if most is not None and len(pieces) > most:
        kept = np.unique(np.linspace(0, len(pieces) - 1, most).round().astype(int))
        pieces = [pieces[k] for k in kept]
    return pieces


def cut_windows(
    signals: Signals,
    records: Sequence[Record],
    pieces: Sequence[Piece],
    masks: Sequence[Bool[np.ndarray, "_"]],
    guesses: Sequence[Float[np.ndarray, "_ states"]],
    sd: Float[np.ndarray, "states"],
    substeps: int,
    scale: Float[np.ndarray, "outputs"],
    drift: SlowWalk,
) -> WindowBatch:
    """Windows, one per piece, padded to one length; samples outside `masks` weigh nothing.

    Hidden states start at `guesses` (per record) with spread `sd`. `scale` normalises outputs.
    """
    length = -(-max(stop - start for _, start, stop in pieces) // 64) * 64
    stages = [
        np.asarray(intersample(signals, jnp.asarray(record.u), substeps)) for record in records
    ]
    rows = []
    for k, start, stop in pieces:
        record, cut = records[k], slice(start, stop)
        known = record.x[start]
        hidden = ~np.isfinite(known)
        dt = np.full(stop - start, record.step)
        dt[-1] = 0.0
        y = record.y[cut]
        weight = np.isfinite(y) * masks[k][cut, None] / scale
        rows.append(
            WindowBatch(
                center=np.where(hidden, guesses[k][start], known),
                sd=np.where(hidden | ~np.isfinite(record.sd), sd, record.sd),
                stages=_pad(stages[k][cut], length, edge=True),
                dt=_pad(dt, length),
                y=_pad(np.nan_to_num(y), length),
                weight=_pad(weight, length),
                walk=drift.walk(length),
            )
        )
    fields = ("center", "sd", "stages", "dt", "y", "weight", "walk")
    return WindowBatch(*(np.stack([getattr(row, field) for row in rows]) for field in fields))


def _pad(x: np.ndarray, length: int, *, edge: bool = False) -> np.ndarray:
    tail = np.repeat(x[-1:], length - len(x), axis=0)
    return np.concatenate([x, tail if edge else np.zeros_like(tail)])


def output_scale(records: Sequence[Record]) -> Float[np.ndarray, "outputs"]:
    """Spread of every output over all records."""
    return spread(np.concatenate([record.y for record in records]))
