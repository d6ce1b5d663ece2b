"""Equations of fast states, fitted by two-stage least squares with what the model simulates.

What disturbs dx = F(x, u) for a while is in x as well, and least squares takes it for the state's
own: a lag looks too long, and the longer the more of its movements the smoothing has taken, which
may reach over many of its time constants. A state that is simulated from the inputs alone knows
neither disturbance nor noise. It and the inputs are the instruments (P. C. Young and A. J. Jakeman,
"Refined instrumental variable methods", Int. J. Control 29 to 31, 1979 and 1980), simulated anew
with what they find; the kernel is as wide as the equations' own time constant (the prefilter 1/A of
P. C. Young, Recursive Estimation and Time-Series Analysis, 2011, ch. 8). The states of other
equations are read as measured, and count as inputs.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from faultgauge.identification.equation.groups import (
    EquationResidual,
    Group,
    assemble,
    bounds_of,
    target_scales,
    units_of,
    vector_of,
)
from faultgauge.identification.equation.instruments import project, refit
from faultgauge.identification.equation.weak_form import weak_states
from faultgauge.identification.samples import Channels, Samples, Stretch
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.plant import Plant
from faultgauge.plants.signals import Input, Signals
from faultgauge.programs import program
from faultgauge.simulation.free_run import (
    RATE_STEP,
    bucket,
    fastest_rate,
    pad,
    simulate,
    substeps_for,
)
from faultgauge.telemetry.derivatives import WIDTHS, Kernel

__all__ = ["Freed", "freed_by_simulation"]

ROUNDS = 4  # simulations; from a start three times off, the last changes less than the error
NARROWEST, PAST_SAMPLES = Kernel(2, 1), 20_000  # for a start only
LOOKED_AT = 500  # samples, for the equations' rates


class Freed(NamedTuple):
    """A plant whose group was fitted with simulated instruments: the samples, and what of them the
    model simulates from the inputs; `along`: both at all samples of the stretches."""

    plant: GrayBoxPlant
    training: Samples
    exogenous: Samples
    along: tuple[Samples, Samples]


class Own(Plant):
    """The equations of some states of `plant`; its other states are inputs, after its own."""

    signals: Signals
    plant: GrayBoxPlant
    states: tuple[int, ...] = eqx.field(static=True)

    def derivative(
        self, x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Float[Array, "states"]:
        inputs = len(self.plant.signals.inputs)
        own = np.array(self.states)
        return self.plant.derivative(u[inputs:].at[own].set(x), u[:inputs])[own]

    def output(
        self, dx: Float[Array, "states"], x: Float[Array, "states"], u: Float[Array, "inputs"]
    ) -> Float[Array, "outputs"]:
        return jnp.zeros(0)


def freed_by_simulation(
    fitted: GrayBoxPlant,
    stated: GrayBoxPlant,
    how: Channels,
    group: Group,
    stretches: Sequence[Stretch],
    places: Int[np.ndarray, "samples"],
    training: Samples,
) -> Iterator[Freed]:
    """The group fitted anew at the `training` samples, the `places`-th of all `stretches`', from
    `fitted` and from what the inputs' past alone makes of the file's values, `stated`. None where
    its equations are slower than the kernel is wide, read what is not measured itself, or share an
    unknown with an output, or where there is no input.
    """
    spec = fitted.spec
    if not spec.signals.inputs or group.outputs or not group.states:
        return
    if weak_states(spec, how, group) != group.states:
        return
    if stretches[0].unsmoothed is None:
        return
    kernel, step = stretches[0].unsmoothed.kernel, stretches[0].step
    thinned = training.take(
        np.linspace(0, len(training.x) - 1, min(LOOKED_AT, len(training.x))).astype(int)
    )
    rates = [_rate(plant, group, thinned) for plant in (fitted, stated)]
    if kernel.order * kernel.width * step * max(rates) <= 1:
        return
    for plant in (_by_past_inputs(stated, group, stretches, places), fitted):
        found = None
        for _ in range(ROUNDS):
            rate = _rate(plant, group, thinned)
            own = _kernel(kernel, step, rate)
            x = _simulated(plant, group, stretches, rate)
            if not all(np.all(np.isfinite(each[:, list(group.states)])) for each in x):
                break
            measured = _samples(spec.signals, own, stretches, None)
            explained = _samples(spec.signals, own, stretches, x)
            samples, exogenous = measured.take(places), explained.take(places)
            plant = _refitted(plant, group, samples, exogenous)
            found = Freed(plant, samples, exogenous, (measured, explained))
        if found is not None:
            yield found


def _by_past_inputs(
    plant: GrayBoxPlant,
    group: Group,
    stretches: Sequence[Stretch],
    places: Int[np.ndarray, "samples"],
) -> GrayBoxPlant:
    """The group fitted with what a linear filter of the inputs predicts as instruments, which asks
    no model: what is simulated from values far off says little."""
    signals = plant.signals
    counts = [len(s.t) for s in stretches]
    fitted = np.isin(np.arange(sum(counts)), places)
    parts, masks, left = [], [], PAST_SAMPLES
    for stretch, mask in zip(stretches, np.split(fitted, np.cumsum(counts)[:-1]), strict=True):
        own = _samples(signals, NARROWEST, [stretch], None).take(np.arange(len(mask))[:left])
        parts.append(replace(stretch, samples=own, references=stretch.references[:left]))
        masks.append(mask[:left])
        left = max(left - len(mask), 0)
    parts, masks = zip(*((p, m) for p, m in zip(parts, masks, strict=True) if m.any()), strict=True)
    rows = [p.samples.take(np.flatnonzero(m)) for p, m in zip(parts, masks, strict=True)]
    samples = Samples(*(np.concatenate(arrays) for arrays in zip(*rows, strict=True)))
    return _refitted(plant, group, samples, project(signals, parts, masks)[0])


def _refitted(
    plant: GrayBoxPlant, group: Group, samples: Samples, exogenous: Samples
) -> GrayBoxPlant:
    """`plant` with its group by two-stage least squares."""
    units, scales = units_of(plant, group), target_scales(group, samples)
    residual = EquationResidual(plant, jnp.asarray(scales), jnp.asarray(units), group)
    start, bounds = vector_of(plant, group), bounds_of(plant, group)
    theta = refit(residual, start, samples, exogenous, bounds)
    return jax.tree.map(jnp.asarray, assemble(plant, group, jnp.asarray(theta), units))


def _own(plant: GrayBoxPlant, group: Group) -> Own:
    signals = plant.signals
    measured = tuple(Input(each.name, hold="linear") for each in signals.states)
    own = replace(
        signals,
        states=tuple(signals.states[i] for i in group.states),
        inputs=(*signals.inputs, *measured),
        outputs=(),
        faults=(),
    )
    return Own(own, plant, group.states)


def _rate(plant: GrayBoxPlant, group: Group, samples: Samples) -> float:
    """The fastest rate [1/s] of the group's equations."""
    u = np.concatenate([samples.u, samples.x], axis=1)
    return fastest_rate(_own(plant, group), samples.x[:, list(group.states)], u)


def _kernel(widest: Kernel, step: float, rate: float) -> Kernel:
    """The narrowest that is as wide as 1 / `rate`, and no wider than the `widest`."""
    for width in WIDTHS:
        found = Kernel(2, width)
        if found.half >= widest.half:
            break
        if 2 * width * step * rate >= 1:
            return found
    return widest


def _simulated(
    plant: GrayBoxPlant, group: Group, stretches: Sequence[Stretch], rate: float
) -> list[Float[np.ndarray, "grid states"]]:
    """The states of all stretches, those of the group from the first measured on."""
    parts = [s.unsmoothed for s in stretches if s.unsmoothed]
    own, states = _own(plant, group), list(group.states)
    length = bucket(max(len(part.x) for part in parts))
    u = np.stack([pad(np.concatenate([part.u, part.x], axis=1), length) for part in parts])
    dt = np.full((len(parts), length), stretches[0].step)
    substeps = substeps_for(stretches[0].step, RATE_STEP / rate if rate > 0 else 1e9)
    x0 = np.stack([part.x[0, states] for part in parts])
    x0, u, dt = (jnp.asarray(each) for each in (x0, u, dt))
    found = np.asarray(_free_runs(own, x0, u, dt, substeps))
    whole = []
    for part, path in zip(parts, found, strict=True):
        x = part.x.copy()
        x[:, states] = path[: len(x)]
        whole.append(x)
    return whole


@program
def _free_runs(
    own: Own,
    x0: Float[Array, "stretches states"],
    u: Float[Array, "stretches grid inputs"],
    dt: Float[Array, "stretches grid"],
    substeps: int,
) -> Float[Array, "stretches grid states"]:
    def one(x0: Array, u: Array, dt: Array) -> Array:
        return simulate(own, x0, u, dt, jnp.zeros((len(dt), 0)), substeps).x

    return jax.vmap(one)(x0, u, dt)


def _samples(
    signals: Signals,
    kernel: Kernel,
    stretches: Sequence[Stretch],
    x: Sequence[Float[np.ndarray, "grid states"]] | None,
) -> Samples:
    """Samples of `kernel` at the same times as those of the stretches; of the states `x`, or as
    measured."""
    held = [each.hold == "zero" for each in signals.inputs]
    found = []
    for k, stretch in enumerate(stretches):
        part = stretch.unsmoothed
        assert part is not None
        cut = slice(stretch.reach - kernel.half, stretch.reach - kernel.half + len(stretch.t))
        mean = partial(_means, kernel, stretch.step, cut)
        states = part.x if x is None else x[k]
        free = [False] * states.shape[1]
        y = np.full((len(stretch.t), len(signals.outputs)), np.nan)
        found.append(Samples(mean(states, free), mean(part.u, held), mean(states, free, 1), y))
    return Samples(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))


def _means(
    kernel: Kernel,
    step: float,
    cut: slice,
    columns: Float[np.ndarray, "grid columns"],
    held: Sequence[bool],
    derivative: int = 0,
) -> Float[np.ndarray, "samples columns"]:
    found = [
        kernel.smooth(column, step, derivative=derivative, held=each)[cut]
        for column, each in zip(columns.T, held, strict=True)
    ]
    return np.stack(found, axis=1) if found else np.zeros((cut.stop - cut.start, 0))
