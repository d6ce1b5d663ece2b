"""Training samples: (x, u, dx, y) points of the equations dx = F(x, u), y = h(dx, x, u)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from faultgauge.errors import InputError
from faultgauge.plants.expression import Name, derivatives_used, names_used
from faultgauge.plants.signals import Signals
from faultgauge.plants.spec import PlantSpec
from faultgauge.telemetry import Run, as_sampled, segments
from faultgauge.telemetry.dead_time import delayed
from faultgauge.telemetry.derivatives import Kernel, choose_kernel, noise_sd
from faultgauge.telemetry.resampling import on_grid

__all__ = [
    "Channels",
    "Samples",
    "Stretch",
    "Unsmoothed",
    "channels",
    "collect",
    "column_names",
    "in_effect",
    "jumping",
    "slow_columns",
    "spread",
    "state_column",
]


class Samples(NamedTuple):
    """Points of the plant's equations, in plant units; NaN where a log has no such column."""

    x: Float[np.ndarray, "samples states"]
    u: Float[np.ndarray, "samples inputs"]
    dx: Float[np.ndarray, "samples states"]
    y: Float[np.ndarray, "samples outputs"]

    def take(self, index: np.ndarray) -> "Samples":
        return Samples(*(array[index] for array in self))


class Unsmoothed(NamedTuple):
    """What `kernel` made the samples of, from its half before the first to its half after the last;
    NaN for a state that is the derivative of a column. `dx`: means over the intervals between."""

    kernel: Kernel
    x: Float[np.ndarray, "grid states"]
    u: Float[np.ndarray, "grid inputs"]
    dx: Float[np.ndarray, "intervals states"]


@dataclass(frozen=True)
class Stretch:
    """A gap-free stretch of one run on a uniform grid.

    `samples[k]` is centred at `t[k]` and made of data up to `reach` samples away; `measured` holds
    the outputs as sampled at `t` (NaN where they were not), `applied` the inputs
    inside their limits, `references` the instruments through the samples' kernel, `unsmoothed` what
    the samples were made of (None where no kernel was needed).
    """

    run: str
    step: float
    reach: int
    t: Float[np.ndarray, "samples"]
    samples: Samples
    measured: Float[np.ndarray, "samples outputs"]
    applied: Float[np.ndarray, "samples inputs"]
    references: Float[np.ndarray, "samples references"]
    unsmoothed: Unsmoothed | None = None


@dataclass(frozen=True)
class Channels:
    """How each state is obtained: (column, derivative order), None where it is hidden; and which
    outputs are scored."""

    states: tuple[tuple[str, int] | None, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    rates: tuple[str, ...]  # d_<state> columns that the logs hold
    hidden: tuple[str, ...] = ()
    references: tuple[str, ...] = ()  # instruments that the fit uses

    @property
    def sources(self) -> tuple[tuple[str, int], ...]:
        """`states` where none is hidden."""
        return tuple(source for source in self.states if source)

    @property
    def needed(self) -> list[str]:
        names = [column for column, _ in self.sources]
        return list(
            dict.fromkeys([*names, *self.inputs, *self.outputs, *self.rates, *self.references])
        )


def column_names(signals: Signals) -> tuple[list[str], list[str]]:
    """(required, optional) telemetry columns of a plant: inputs, and everything else."""
    rates = [f"d_{name}" for name in signals.state_names]
    optional = dict.fromkeys([*signals.state_names, *signals.output_names, *rates])
    return list(signals.input_names), list(optional)


def in_effect(signals: Signals, run: Run) -> Run:
    """`run` with its inputs as they act: what was commanded a dead time ago.

    NaN where that is not known. Raises `InputError` for a run no longer than a delay.
    """
    held = {each.name for each in signals.inputs if each.hold == "zero"}
    delays = {each.name: each.delay for each in signals.inputs if each.delay}
    return delayed(run, delays, held) if delays else run


def state_column(signals: Signals, state: str, columns: Sequence[str]) -> str | None:
    """The column that measures `state`: its own, or that of an output that is exactly it."""
    if state in columns:
        return state
    return next(
        (o.name for o in signals.outputs if o.measures == state and o.name in columns), None
    )


def channels(spec: PlantSpec, runs: Sequence[Run]) -> Channels:
    """Which column or derivative stands for each state, over all `runs`."""
    signals = spec.signals
    present = set.intersection(*(set(run.columns) for run in runs))
    sources: dict[str, tuple[str, int]] = {}
    for state in signals.state_names:
        column = state_column(signals, state, sorted(present))
        if column is not None:
            sources[state] = (column, 0)
    for _ in signals.states:  # chains: q measured, v = d(q), a = d(v)
        for state, derivative in zip(signals.state_names, spec.derivatives, strict=True):
            tree = derivative.tree
            if isinstance(tree, Name) and state in sources and tree.name not in sources:
                column, order = sources[state]
                sources[tree.name] = (column, order + 1)
    return Channels(
        states=tuple(sources.get(state) for state in signals.state_names),
        inputs=signals.input_names,
        outputs=tuple(name for name in signals.output_names if name in present),
        rates=tuple(f"d_{name}" for name in signals.state_names if f"d_{name}" in present),
        hidden=tuple(name for name in signals.state_names if name not in sources),
    )


def slow_columns(how: Channels, runs: Sequence[Run]) -> list[str]:
    """Measured columns that are slower than the rows of a run: what is between their samples is
    a straight line, whose slope is not the derivative that an equation asks for."""
    filled = set[str]().union(*(run.sampled for run in runs))
    apart = {*how.inputs, *how.references}
    return [name for name in how.needed if name in filled and name not in apart]


def spread(y: Float[np.ndarray, "samples outputs"]) -> Float[np.ndarray, "outputs"]:
    """Standard deviation of every output; 1 where it was not sampled or does not change."""
    sampled = [column[np.isfinite(column)] for column in y.T]
    found = np.array([np.std(column) if column.size else 0.0 for column in sampled])
    return np.where(found > 0, found, 1.0)


def collect(
    spec: PlantSpec, runs: Sequence[Run], how: Channels
) -> tuple[list[Stretch], dict[str, dict[str, float]]]:
    """Stretches of all runs, and what the smoothing left: per state the kernel's window [s],
    the noise of the measured column and the noise of the derivative (its unit and share)."""
    held = jumping(spec)
    grids = []
    for run in runs:
        for part in segments(run, how.needed):
            columns = {name: run.columns[name][part] for name in how.needed}
            for each in spec.signals.inputs:  # the actuator's limits act before any smoothing
                columns[each.name] = np.clip(columns[each.name], each.min, each.max)
            step, t, on = on_grid(run.t[part], columns, held)
            if len(t) >= 16:
                grids.append((run, step, t, on))
    kernel, noise = _kernel(spec, how, grids) if grids else (None, {})
    shortest = 16 + (2 * kernel.half if kernel else 0)
    grids = [grid for grid in grids if len(grid[2]) >= shortest]
    if not grids:
        raise InputError(
            f"{runs[0].source}: no stretch of {shortest} complete samples without a gap in "
            f"{', '.join(how.needed)}; look at it with `faultgauge inspect`."
        )
    return [_stretch(spec, how, kernel, held, *grid) for grid in grids], noise


def jumping(spec: PlantSpec) -> set[str]:
    """Signals that jump with a held input: the input itself and what it feeds straight into."""
    held = {each.name for each in spec.signals.inputs if each.hold == "zero"}
    if held:
        held |= {f"d_{name}" for name in spec.signals.state_names}
        for output, value in zip(spec.signals.outputs, spec.values, strict=True):
            if derivatives_used(value) or names_used(value) & held:
                held.add(output.name)
    return held


def _kernel(
    spec: PlantSpec, how: Channels, grids: list
) -> tuple[Kernel | None, dict[str, dict[str, float]]]:
    """One kernel for all signals: the widest that any derivative asks for."""
    if all(f"d_{name}" in how.rates for name in spec.signals.state_names):
        return None, {}
    step = grids[0][1]
    known = {output.measures or output.name: output.sigma for output in spec.signals.outputs}
    known |= {output.name: output.sigma for output in spec.signals.outputs if output.sigma}
    wanted, found = {}, []
    for state, (column, order) in zip(spec.signals.state_names, how.sources, strict=True):
        if f"d_{state}" in how.rates:
            continue
        signals = [on[column] for *_, on in grids]
        inputs = [[on[each.name] for each in spec.signals.inputs] for *_, on in grids]
        sigma = known.get(column) or max(
            noise_sd(x, u) for x, u in zip(signals, inputs, strict=True)
        )
        wanted[state] = (signals, order + 1, sigma)
        found.append(
            choose_kernel(signals, step, order + 1, sigma, [u for us in inputs for u in us])
        )
    order = max(k.order for k in found)
    width = max(k.width for k in found)
    order += (order * width) % 2
    kernel = Kernel(order, width)
    noise = {}
    for state, (signals, derivative, sigma) in wanted.items():
        left = sigma * kernel.noise_gain(derivative, step)
        usable = [x for x in signals if len(x) > 2 * kernel.half]
        slopes = [kernel.smooth(x, step, derivative=derivative) for x in usable]
        spread = float(np.std(np.concatenate(slopes))) if slopes else 0.0
        noise[state] = {
            "window_s": kernel.order * kernel.width * step,
            "column_noise": sigma,
            "derivative_noise": left,
            "derivative_noise_share": left / spread if spread > 0 else 0.0,
        }
    return kernel, noise


def _slopes(
    spec: PlantSpec, how: Channels, held: set[str], step: float, on: dict[str, np.ndarray]
) -> Float[np.ndarray, "intervals states"]:
    """The mean derivative of every state between two samples; NaN as in `Unsmoothed`."""
    found = []
    for state, (column, order) in zip(spec.signals.state_names, how.sources, strict=True):
        rate = f"d_{state}"
        if rate in how.rates:
            x = on[rate]
            found.append(x[:-1] if rate in held else (x[1:] + x[:-1]) / 2)
        else:
            found.append(np.diff(np.full(len(on[column]), np.nan) if order else on[column]) / step)
    return np.stack(found, axis=1)


def _stretch(
    spec: PlantSpec,
    how: Channels,
    kernel: Kernel | None,
    held: set[str],
    run: Run,
    step: float,
    t: np.ndarray,
    on: dict[str, np.ndarray],
) -> Stretch:
    half = kernel.half if kernel else 0
    inside = slice(half, len(t) - half)
    signals = spec.signals

    def mean(column: str | None, derivative: int = 0) -> np.ndarray:
        if column is None:
            return np.full(len(t), np.nan)[inside]
        if kernel is None:
            return on[column]
        return kernel.smooth(on[column], step, derivative=derivative, held=column in held)

    def table(columns: list[np.ndarray]) -> np.ndarray:
        return np.stack(columns, axis=1) if columns else np.zeros((len(t[inside]), 0))

    unsmoothed = kernel and Unsmoothed(
        kernel,
        np.stack([np.full(len(t), np.nan) if r else on[c] for c, r in how.sources], axis=1),
        np.array([on[name] for name in signals.input_names]).reshape(-1, len(t)).T,
        _slopes(spec, how, held, step, on),
    )
    rates = []
    for state, (column, order) in zip(signals.state_names, how.sources, strict=True):
        given = f"d_{state}" in how.rates
        rates.append(mean(f"d_{state}") if given else mean(column, order + 1))
    return Stretch(
        run=run.name,
        step=step,
        reach=half,
        t=t[inside],
        samples=Samples(
            x=table([mean(column, order) for column, order in how.sources]),
            u=table([mean(name) for name in signals.input_names]),
            dx=table(rates),
            y=table([mean(n if n in how.outputs else None) for n in signals.output_names]),
        ),
        measured=table(
            [
                as_sampled(run, n, t, on[n])[inside]
                if n in how.outputs
                else np.full(len(t[inside]), np.nan)
                for n in signals.output_names
            ]
        ),
        applied=table([on[name][inside] for name in signals.input_names]),
        references=table([mean(name) for name in how.references]),
        unsmoothed=unsmoothed,
    )
