"""The weak form of the equation error: F averaged over the kernel, not F of averages.

The kernel phi that smooths the samples is a test function with compact support, and integration by
parts takes the derivative off the state (J. Loeb and G. Cahen, "More about process identification",
IEEE Trans. Automatic Control 10, 1965; D. A. Messenger and D. M. Bortz, "Weak SINDy", Multiscale
Modeling and Simulation 19, 2021):

    integral phi(t - s) F(x(s), u(s)) ds = integral phi'(t - s) x(s) ds

The right side is the smoothed derivative. The filtered form writes F(mean x, mean u) on the left,
which is the same for F linear in x and u; for any other F it is wrong wherever x moves within the
kernel. The weak form takes F between every two samples as measured, at their mean, and half the
variance of their noise with it: where F bends within that, mean F is biased.

The right side is as much the mean of the differences between samples. So the weak form is the
equation error of every interval between two samples, averaged over the kernel, and an interval is
evaluated once for all samples whose kernels hold it (`Means`).

Equations that read a d(state), or a state that is itself the derivative of a column, stay filtered.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from faultgauge.identification.equation.groups import (
    Group,
    crowds,
    equation_errors,
    fit_group,
    scale_networks,
    target_scales,
)
from faultgauge.identification.optimise.algorithms import AlgorithmName
from faultgauge.identification.optimise.levenberg_marquardt import Solution
from faultgauge.identification.optimise.means import Means
from faultgauge.identification.samples import Channels, Samples, Stretch, Unsmoothed
from faultgauge.plants.expression import derivatives_used, names_used
from faultgauge.plants.gray_box import GrayBoxPlant
from faultgauge.plants.signals import Signals
from faultgauge.plants.spec import PlantSpec
from faultgauge.programs import program
from faultgauge.simulation.free_run import bucket, pad
from faultgauge.telemetry.derivatives import Kernel

__all__ = [
    "Points",
    "WeakErrors",
    "WeakSamples",
    "fit_weak",
    "gap",
    "weak_samples",
    "weak_states",
]


class Points(NamedTuple):
    """`between`: the middles of the intervals between two measurements, with the mean derivative of
    each; `at`: the smoothed sample that the kernel from this interval on makes."""

    between: Samples
    at: Samples


class WeakSamples(Means):
    """Means over `Points`; `at`: the smoothed samples. The `weights` are the kernel's, one row
    for the equations that are averaged: `of_group` has a row for each equation."""

    at: Samples

    @property
    def dx(self) -> Float[np.ndarray, "samples states"]:
        return self.at.dx

    @property
    def y(self) -> Float[np.ndarray, "samples outputs"]:
        return self.at.y

    def of_group(self, group: Group, states: tuple[int, ...]) -> "WeakSamples":
        """As the equations of `group` are averaged, `states` in the weak form; the others are taken
        at the smoothed sample alone."""
        weak = [i in states for i in group.states] + [False] * len(group.outputs)
        alone = np.eye(1, self.weights.shape[1])
        rows = np.concatenate([self.weights if each else alone for each in weak])
        return replace(self, weights=rows)


class WeakErrors(eqx.Module):
    """`equation_errors` at one of the `Points`: those of `states` between two measurements, whose
    means are the errors in the weak form."""

    states: tuple[int, ...] = eqx.field(static=True)

    def __call__(
        self, plant: GrayBoxPlant, group: Group, point: Points
    ) -> Float[Array, "equations"]:
        weak = equation_errors(plant, replace(group, states=self.states, outputs=()), point.between)
        if self.states == group.states and not group.outputs:
            return weak
        places = np.array([group.states.index(i) for i in self.states])
        return equation_errors(plant, group, point.at).at[places].set(weak)


def weak_states(spec: PlantSpec, how: Channels, group: Group) -> tuple[int, ...]:
    """States of `group` whose equations read states as measured and no d(state)."""
    names = zip(spec.signals.state_names, how.states, strict=True)
    derived = {name for name, source in names if source is None or source[1] > 0}
    return tuple(
        i
        for i in group.states
        if not derivatives_used(spec.derivatives[i])
        and not names_used(spec.derivatives[i]) & derived
    )


def interval_weights(kernel: Kernel) -> Float[np.ndarray, "intervals"]:
    """The weights of the kernel's mean over the intervals between its samples, from the left."""
    count = 2 * kernel.half
    impulse = np.zeros(2 * count + 1)
    impulse[count] = 1.0  # an input held over one interval: every mean holds one weight of it
    return kernel.smooth(impulse, 1.0, held=True)[:0:-1]


def weak_samples(
    signals: Signals,
    stretches: Sequence[Stretch],
    places: Int[np.ndarray, "samples"],
    at: Samples,
) -> WeakSamples:
    """The points under the kernel of the samples `at`, the `places`-th of all stretches'."""
    kernel = next(s.unsmoothed.kernel for s in stretches if s.unsmoothed)
    under = 2 * kernel.half
    parts = [_points(signals, s.unsmoothed, s.samples) for s in stretches if s.unsmoothed]
    points = jax.tree.map(lambda *arrays: np.concatenate(arrays), *parts)
    stretch = np.searchsorted(np.cumsum([len(s.t) for s in stretches]), places, side="right")
    first = places + (under - 1) * stretch
    used = np.unique(first[:, None] + np.arange(under))
    # few lengths, so that few programs are compiled
    length = min(bucket(len(used)), len(first) * under, len(points.at.x))
    points = jax.tree.map(lambda array: pad(array[used], length), points)
    return WeakSamples(points, np.searchsorted(used, first), interval_weights(kernel)[None], at)


def _points(signals: Signals, part: Unsmoothed, samples: Samples) -> Points:
    """Those of a stretch. Over [k, k+1) held inputs stay at u_k, while x goes from x_k to x_(k+1):
    the midpoint rule takes F at the mean of the two, half the variance of their noise with it."""
    held = np.array([each.hold == "zero" for each in signals.inputs], bool)
    x, u = ((array[1:] + array[:-1]) / 2 for array in (part.x, part.u))
    y = np.full((len(x), len(signals.outputs)), np.nan)
    at = Samples(*(pad(array, len(x)) for array in samples))
    return Points(Samples(x, np.where(held, part.u[:-1], u), part.dx, y), at)


def gap(plant: GrayBoxPlant, group: Group, states: tuple[int, ...], samples: WeakSamples) -> float:
    """rms of mean F - F(mean), as a share of the derivative's spread: the largest of `states`; NaN
    where F is not defined between every two samples as measured."""
    given = jax.tree.map(jnp.asarray, samples.of_group(group, states))
    found = np.asarray(_differences(plant, given, group, WeakErrors(states)))
    shares = np.sqrt(np.mean(found**2, axis=0)) / target_scales(group, samples)
    return float(np.max(shares))


@program
def _differences(
    plant: GrayBoxPlant, samples: WeakSamples, group: Group, errors: WeakErrors
) -> Float[Array, "samples equations"]:
    weak = jax.vmap(lambda each: errors(plant, group, each))(samples.points)
    filtered = jax.vmap(lambda each: equation_errors(plant, group, each))(samples.at)
    return samples.of(weak.T).T - filtered


def fit_weak(
    plant: GrayBoxPlant,
    group: Group,
    states: tuple[int, ...],
    training: WeakSamples,
    validation: WeakSamples,
    rngs: Sequence[np.random.Generator],
    algorithm: AlgorithmName,
) -> tuple[list[GrayBoxPlant], Solution]:
    """`fit_group` with the equations of `states` in the weak form."""
    reached = _reached(training)
    scaled = scale_networks(plant, group, reached)
    return fit_group(
        scaled,
        group,
        training.of_group(group, states),
        validation.of_group(group, states),
        rngs,
        algorithm=algorithm,
        errors=WeakErrors(states),
        crowded=crowds(scaled, group, reached),
    )


def _reached(samples: WeakSamples) -> Samples:
    """Every sample, smoothed and between measurements: networks are to span them all."""
    pairs = zip(samples.at, samples.points.between, strict=True)
    return Samples(*(np.concatenate(pair) for pair in pairs))
