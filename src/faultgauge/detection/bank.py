"""The bank beside a log: built from a calibrated model, run over every gap-free stretch."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from faultgauge.detection.judged import (
    measured_outputs,
    operating_points,
    record_arrays,
    start_from_samples,
)
from faultgauge.detection.levels import MEMORY, driven, levels_of, probes_of
from faultgauge.detection.noise import Noise, drifting_of, spread_of_start
from faultgauge.errors import InputError
from faultgauge.identification.samples import in_effect
from faultgauge.observers.interacting import BankState, InteractingModes, run_bank
from faultgauge.observers.modes import Levels, Set, hypotheses, links, mode_sets
from faultgauge.plants.model import Model
from faultgauge.simulation.free_run import substeps_for
from faultgauge.telemetry import Run, segments

__all__ = ["FaultBank", "Rows", "build_fault_bank", "run_over"]

BLOCK = 4096  # samples in one call
AT_START = 1e-3  # probability that a given fault is there when a log begins, at most
MARGIN = 0.1  # of the training envelope's range, beyond which a model is not trusted


@dataclass(frozen=True)
class FaultBank:
    """The modes of a model's faults, and the levels behind them; `known` is sd(n) of `levels`."""

    model: Model
    modes: InteractingModes
    sets: tuple[Set, ...]
    levels: Levels
    noise: Noise
    outputs: tuple[str, ...]
    step: float
    known: Float[np.ndarray, "times faults"]


@dataclass(frozen=True)
class Rows:
    """What the bank says about the samples `part` of a run.

    `p` of every mode, `f` and `sd` of its fault slots, `x` the posterior mean of [states,
    drifting parameters], `seen` whether a fault of that direction (down, up) would show,
    `inside` the training envelope.
    """

    part: slice
    p: Float[np.ndarray, "samples modes"]
    f: Float[np.ndarray, "samples modes slots"]
    sd: Float[np.ndarray, "samples modes slots"]
    x: Float[np.ndarray, "samples kept"]
    seen: Bool[np.ndarray, "samples faults two"]
    inside: Bool[np.ndarray, "samples"]


def build_fault_bank(model: Model, runs: Sequence[Run], noise: Noise) -> FaultBank:
    """The bank for `runs`. Raises `InputError` where the plant file declares no fault."""
    signals = model.plant.signals
    if not signals.faults:
        raise InputError(
            "the plant file declares no [faults], so the bank has nothing to tell apart; declare "
            "what may go wrong, or use --observer eso."
        )
    step = float(np.median([run.step for run in runs]))
    outputs = measured_outputs(model, runs)
    levels, known = levels_of(model, noise, step, outputs)
    sets = mode_sets(len(signals.faults), signals.max_simultaneous)
    probes = probes_of(model, levels)
    modes = InteractingModes(
        plant=driven(model),
        hypothesis=hypotheses(sets, levels),
        links=links(sets, len(signals.states), levels),
        probes=jnp.asarray(probes),
        memory=jnp.asarray(MEMORY * step),
        enough=jnp.asarray(-2 * np.log(levels.onset.min() * step)),
        drifting=drifting_of(model),
        substeps=substeps_for(step, model.max_step),
    )
    return FaultBank(model, modes, sets, levels, noise, outputs, step, known)


def run_over(bank: FaultBank, log: Run) -> Iterator[Rows]:
    """Blocks of samples in order; what lies between them was not sampled."""
    model = bank.model
    run = in_effect(model.plant.signals, log)
    for stretch in segments(run, model.plant.signals.input_names or bank.outputs):
        part = _from_first_sample(bank, run, stretch)
        if part is None:
            continue
        start = start_from_samples(model, run, part)
        modes = eqx.tree_at(
            lambda each: each.plant, bank.modes, driven(replace(model, plant=start.plant))
        )
        u, y = record_arrays(model, run, part)
        unused = [n not in bank.outputs for n in model.plant.signals.output_names]
        y[:, unused] = np.nan
        dt = np.diff(run.t[part], prepend=run.t[part.start])
        state = _first_state(bank, modes, start.x, u[0], list(run.columns))
        for first in range(0, len(dt), BLOCK):
            block = slice(first, min(first + BLOCK, len(dt)))
            state, rows = _block(bank, modes, state, u[block], y[block], dt[block])
            yield Rows(slice(part.start + block.start, part.start + block.stop), *rows)


def _from_first_sample(bank: FaultBank, run: Run, stretch: slice) -> slice | None:
    """`stretch` from the first sample on that has every output."""
    complete = np.all([np.isfinite(run.columns[n][stretch]) for n in bank.outputs], axis=0)
    found = np.flatnonzero(complete)
    if len(found) == 0 or stretch.stop - stretch.start - found[0] < 2:
        return None
    return slice(stretch.start + int(found[0]), stretch.stop)


def _first_state(
    bank: FaultBank,
    modes: InteractingModes,
    x: Float[np.ndarray, "states"],
    u: Float[np.ndarray, "inputs"],
    columns: list[str],
) -> BankState:
    sd, drifted = spread_of_start(bank.model, bank.noise, columns)
    single = np.minimum(bank.levels.onset * 3600, AT_START)
    unknown = np.minimum(bank.levels.unknown * 3600, AT_START)
    declared = [float(np.prod(single[list(each)])) for each in bank.sets]
    p = np.concatenate([declared, unknown])
    p[0] = 1 - p[1:].sum()
    return modes.init(*(jnp.asarray(each) for each in (x, sd, drifted, u, p)))


def _block(
    bank: FaultBank,
    modes: InteractingModes,
    state: BankState,
    u: Float[np.ndarray, "samples inputs"],
    y: Float[np.ndarray, "samples outputs"],
    dt: Float[np.ndarray, "samples"],
) -> tuple[BankState, tuple[np.ndarray, ...]]:
    count = len(dt)

    def padded(a: np.ndarray) -> np.ndarray:
        return np.concatenate([a, np.zeros((BLOCK - count, *a.shape[1:]))])

    arrays = (jnp.asarray(padded(a)) for a in (u, y, dt))
    state, info = run_bank(modes, state, jnp.asarray(count), *arrays)
    p, f, sd, x, seen = (np.asarray(each)[:count] for each in jax.device_get(info))
    silent = np.asarray(modes.probes) == 0.0
    points = operating_points(bank.model)
    inside = _inside(points.x, x[:, : points.x.shape[1]]) & _inside(points.u, u)
    return state, (p, f, sd, x, (seen >= 1.0) | silent, inside)


def _inside(
    points: Float[np.ndarray, "points n"], values: Float[np.ndarray, "samples n"]
) -> Bool[np.ndarray, "samples"]:
    low, high = points.min(axis=0), points.max(axis=0)
    room = MARGIN * (high - low) + 1e-9 * np.maximum(np.abs(low), np.abs(high))
    return np.all((values >= low - room) & (values <= high + room), axis=1)
